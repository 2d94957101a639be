"""The camera of a take: views are keyed at frames, dragged on a track of the timeline, looked through, and filmed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from runtime.errors import SportError
from runtime.pose import Pose
from runtime.takes.camera_keys import MAX_KEYS, CameraKey, view_at, with_key
from runtime.terrain.height_map import Terrain
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.widgets import px
from viewer.messages import Messages
from viewer.render.camera import looked_at
from viewer.stage.camera_control import CameraControl
from viewer.takes.playback import Playback
from viewer.takes.state import ClipItem, TakesState
from viewer.takes.track_drawing import draw_rect, new_row, take_mouse

GRAB = 6.0  # pixels at scale 1 from a key
_HINT = "Views of the camera, for a film by “keyed”.\nDrag a key; right-click removes it"


@dataclass
class TakeCamera:
    """Actions on the keys of the take that plays."""

    state: TakesState
    control: CameraControl
    messages: Messages
    through: bool = False  # the view follows the keys while the take plays
    _dragged: int = -1

    @property
    def item(self) -> ClipItem | None:
        """The take that plays."""
        return self.state.played

    @property
    def keys(self) -> tuple[CameraKey, ...]:
        """Its keys."""
        return () if self.item is None else self.item.camera

    def add(self) -> None:
        """Key the view as it is at the frame shown."""
        item, playback = self.item, self.state.playback
        if item is None or playback is None or len(item.camera) >= MAX_KEYS:
            return
        camera, pose = self.control.current, playback.pose()
        beside = np.zeros(3)
        if self.control.mode == "orbit":
            beside = np.asarray(camera.target) - looked_at(pose.hips_position, playback.terrain)
        x, y, z = (float(v) for v in beside)
        try:
            key = CameraKey(
                playback.frame / playback.clip.fps, camera.yaw, camera.pitch, camera.distance, x, y, z
            )
        except SportError as error:
            self.messages.error(error)
            return
        item.camera = with_key(item.camera, key, playback.clip.fps)
        self.through = len(item.camera) > 1
        self.messages.note(
            f"{item.name}: {len(item.camera)} camera key{'s' * (len(item.camera) > 1)}."
            " A film with the camera “keyed” looks through them."
        )

    def remove(self, index: int) -> None:
        """Take a key away."""
        item = self.item
        if item is not None and 0 <= index < len(item.camera):
            item.camera = tuple(key for i, key in enumerate(item.camera) if i != index)

    def move(self, index: int, frame: int) -> None:
        """Put a key to another frame."""
        item = self.item
        if item is None or not 0 <= index < len(item.camera):
            return
        key = replace(item.camera[index], seconds=frame / item.clip.fps)
        item.camera = with_key([k for i, k in enumerate(item.camera) if i != index], key, item.clip.fps)
        self._dragged = item.camera.index(key)

    def look(self, pose: Pose, terrain: Terrain) -> None:
        """Let the view follow the keys while the take plays; call once a frame before it is drawn."""
        playback = self.state.playback
        if playback is None or not self.through or not playback.playing or not self.keys:
            return
        key, camera = view_at(self.keys, playback.time_s), self.control.current
        camera.yaw, camera.pitch, camera.distance = key.yaw, key.pitch, key.distance
        if self.control.mode == "orbit":
            camera.target = looked_at(pose.hips_position, terrain) + np.array([key.x, key.y, key.z])

    def menu(self) -> None:
        """Its part of the menu that adds to a take."""
        if imgui.selectable("Camera view##key", False)[0]:
            self.add()
        if self.keys and imgui.menu_item("Look through the keys", "", self.through)[0]:
            self.through = not self.through

    def draw_track(self, height: float, playback: Playback) -> None:
        """A mark at each key."""
        row = new_row("Camera", height, playback.frames)
        take_mouse("camera", row)
        draw_rect(row.left, row.top, row.left + row.width, row.top + row.height, theme.FIELD, px(3))
        mouse, fps, half = imgui.get_io().mouse_pos, playback.clip.fps, row.height / 2
        places = [row.x(key.seconds * fps) for key in self.keys]
        over = next((i for i, x in enumerate(places) if abs(x - mouse.x) <= px(GRAB)), -1)
        if imgui.is_item_activated():
            self._dragged = over
            playback.seek(row.frame_at(mouse.x) if over < 0 else round(self.keys[over].seconds * fps))
        if imgui.is_item_active() and self._dragged >= 0:
            frame = row.frame_at(mouse.x)
            if abs(mouse.x - places[self._dragged]) > 1.0:
                self.move(self._dragged, frame)
                playback.seek(frame)
        elif imgui.is_item_hovered():
            widgets.tooltip(_HINT)
            if over >= 0 and imgui.is_mouse_clicked(1):
                self.remove(over)
        drawing = imgui.get_window_draw_list()
        for i, x in enumerate(places):
            tint = widgets.packed(theme.TEXT if i == over else theme.ACCENT)
            drawing.add_ngon_filled(imgui.ImVec2(x, row.top + half), half * 0.95, tint, 4)
