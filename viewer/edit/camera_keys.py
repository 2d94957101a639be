"""The camera of a take: keyed views, shown on a track of the timeline, looked through, and filmed."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from runtime.errors import SportError
from runtime.pose import FPS, Pose
from runtime.takes.camera_keys import CameraKey, view_at, with_key
from runtime.terrain.height_map import Terrain
from viewer.editor import Editor
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.widgets import px
from viewer.input.bindings import Action
from viewer.render.camera import FOV_Y_RAD, looked_at
from viewer.scene.camera_control import CameraControl
from viewer.session.takes import Takes

FILM_VIEW_FRACTION = 0.96  # of the free view that the film covers, so that its edges are visible


@dataclass
class CameraKeys:
    editor: Editor
    takes: Takes
    control: CameraControl
    # its size as "width x height", and its field of view in degrees (0 for the default)
    film: Callable[[], tuple[str, float]]
    _frame: tuple[int, int] = (-1, -1)  # take and frame last looked at

    @property
    def keys(self) -> tuple[CameraKey, ...]:
        return () if self.takes.played is None else self.takes.played.cameras

    @property
    def through(self) -> bool:
        """Whether the view follows the camera keys of the playing take."""
        return self.control.keyed and bool(self.keys)

    def toggle(self) -> None:
        """Look through the camera keys, or stop with the view where it is."""
        if not self.keys:
            self.editor.messages.note("No camera keys: add one with “+ Pin”, Camera key.")
        self.control.keyed, self._frame = not self.through, (-1, -1)

    def add(self) -> None:
        """Key the current view at the frame shown; keys of the live character go into the recording."""
        playback, take = self.takes.playback, self.takes.played or self.editor.session.live
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
            keys = with_key(take.cameras, key, fps)
        except SportError as error:
            self.editor.messages.error(error)
            return
        self.editor.put(f"camera key of {take.title}", take.number, cameras=keys)
        self.control.keyed = playback is not None and len(keys) > 1
        self.editor.messages.note(
            f"{take.title}: {len(keys)} camera key{'s' * (len(keys) > 1)}."
            " Films with the camera “keyed” use them."
        )

    def look(self, pose: Pose, terrain: Terrain) -> None:
        """Move the view along the keys while the take plays or is scrubbed; call once per frame before drawing."""
        playback = self.takes.playback
        if playback is None or not self.through:
            return
        before, self._frame = self._frame, (playback.number, playback.frame)
        if not playback.playing and before == self._frame:
            return
        key, camera = view_at(self.keys, playback.time_s), self.control.current
        camera.yaw, camera.pitch, camera.distance = key.yaw, key.pitch, key.distance
        if self.control.mode == "orbit":
            camera.target = looked_at(pose.hips_position, terrain) + np.array([key.x, key.y, key.z])

    def panel(self) -> Panel:
        """Return the panel that marks the edges of the film in the view."""
        actions = {Action.KEYED_CAMERA: self.toggle}
        return Panel(
            "Film", PanelPlace.SIGN, lambda _: self._draw(), shown=lambda: self.through, actions=actions
        )

    def fit(self, most: float, aspect: float) -> float:
        """Return the height of the view, as a fraction, in which the whole film fits into a view of this `aspect`."""
        usual = math.tan(FOV_Y_RAD / 2) / self._half_height
        return FILM_VIEW_FRACTION * usual * min(most, aspect / self._aspect)

    @property
    def _aspect(self) -> float:
        width, height = (int(side) for side in self.film()[0].split("x"))
        return width / height

    @property
    def _half_height(self) -> float:
        """Half the height of a film, at distance 1."""
        return math.tan((math.radians(self.film()[1]) or FOV_Y_RAD) / 2)

    def _draw(self) -> None:
        camera, shown = self.control.current, imgui.get_io().display_size
        half = self._half_height / camera.half_height * shown.y / 2
        across, x = half * self._aspect, (0.5 + 0.5 * camera.shift) * shown.x
        y = (0.5 - 0.5 * camera.shift_up) * shown.y
        left, top, right, bottom = x - across, y - half, x + across, y + half
        drawing, shade = imgui.get_background_draw_list(), widgets.packed((0.0, 0.0, 0.0, 0.35))
        for box in (
            (0.0, 0.0, left, shown.y), (right, 0.0, shown.x, shown.y), (left, 0.0, right, top), (left, bottom, right, shown.y),
        ):  # fmt: skip
            drawing.add_rect_filled(imgui.ImVec2(*box[:2]), imgui.ImVec2(*box[2:]), shade)
        corner = imgui.ImVec2(left, top)
        drawing.add_rect(corner, imgui.ImVec2(right, bottom), widgets.packed(theme.TEXT), 0.0, px(1))

    def menu(self) -> None:
        if imgui.selectable("Camera key##key", False)[0]:
            self.add()
        if self.keys and widgets.item("Look through the keys", chosen=self.through):
            self.toggle()
