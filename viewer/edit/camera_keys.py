"""The camera of a take: views are keyed at frames, dragged on a track of the timeline, looked through, and filmed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from runtime.errors import SportError
from runtime.pose import FPS, Pose
from runtime.session.session import LIVE, Take
from runtime.takes.camera_keys import MAX_KEYS, CameraKey, view_at, with_key
from runtime.terrain.height_map import Terrain
from viewer.edit.track_drawing import draw_rect, new_row, take_mouse
from viewer.editor import Editor
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.widgets import px
from viewer.render.camera import looked_at
from viewer.scene.camera_control import CameraControl
from viewer.session.playback import Playback
from viewer.session.takes import Takes

GRAB = 6.0  # pixels at scale 1 from a key
_HINT = "Views of the camera, for a film by “keyed”.\nDrag a key; right-click removes it"


@dataclass
class CameraKeys:
    """Actions on the keys of the take that plays."""

    editor: Editor
    takes: Takes
    control: CameraControl
    through: bool = False  # the view follows the keys while the take plays
    _dragged: int = -1

    @property
    def take(self) -> Take | None:
        """The take that plays."""
        return self.takes.played

    @property
    def keys(self) -> tuple[CameraKey, ...]:
        """Its keys."""
        return () if self.take is None else self.take.cameras

    def add(self) -> None:
        """Key the view as it is at the frame shown, or now: keys of the live character go into what is recorded."""
        playback, take = self.takes.playback, self.take or self.editor.session.live
        if len(take.cameras) >= MAX_KEYS:
            return
        scene = self.takes.scene
        if playback is None:
            seconds, fps, pose, terrain = scene.now, float(FPS), scene.simulation.current, scene.terrain
        else:
            fps, pose, terrain = playback.clip.fps, playback.pose(), playback.terrain
            seconds = playback.frame / fps
        camera, offset = self.control.current, np.zeros(3)
        if self.control.mode == "orbit":
            offset = np.asarray(camera.target) - looked_at(pose.hips_position, terrain)
        x, y, z = (float(v) for v in offset)
        try:
            key = CameraKey(seconds, camera.yaw, camera.pitch, camera.distance, x, y, z)
        except SportError as error:
            self.editor.messages.error(error)
            return
        keys = with_key(take.cameras, key, fps)
        self._put(f"camera key of {take.title}", keys)
        self.through = playback is not None and len(keys) > 1
        self.editor.messages.note(
            f"{take.title}: {len(keys)} camera key{'s' * (len(keys) > 1)}."
            " A film with the camera “keyed” looks through them."
        )

    def _put(self, label: str, keys: tuple[CameraKey, ...], held: bool = False) -> None:
        number = LIVE if self.take is None else self.take.number
        change = self.editor.drag if held else self.editor.do
        change(label, lambda session: session.with_take(number, cameras=keys))

    def remove(self, index: int) -> None:
        """Take a key away."""
        if self.take is not None and 0 <= index < len(self.keys):
            kept = tuple(key for i, key in enumerate(self.keys) if i != index)
            self._put(f"removal of a camera key of {self.take.title}", kept)

    def move(self, index: int, frame: int) -> None:
        """Put a key to another frame, while the mouse holds it; a frame that has a key keeps its own."""
        take, playback = self.take, self.takes.playback
        if take is None or playback is None or not 0 <= index < len(take.cameras):
            return
        fps, others = playback.clip.fps, [key for i, key in enumerate(take.cameras) if i != index]
        if frame in {round(key.seconds * fps) for key in others}:
            return
        key = replace(take.cameras[index], seconds=frame / fps)
        keys = with_key(others, key, fps)
        self._put(f"move of a camera key of {take.title}", keys, held=True)
        self._dragged = keys.index(key)

    def look(self, pose: Pose, terrain: Terrain) -> None:
        """Let the view follow the keys while the take plays; call once a frame before it is drawn."""
        playback = self.takes.playback
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
