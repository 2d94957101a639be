"""The camera of a take: views are keyed at frames, dragged on a track of the timeline, looked through, and filmed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from runtime.errors import SportError
from runtime.pose import FPS, Pose
from runtime.session.session import LIVE, Take
from runtime.takes.camera_keys import MAX_KEYS, CameraKey, view_at, with_key
from runtime.terrain.height_map import Terrain
from viewer.editor import Editor
from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.render.camera import looked_at
from viewer.scene.camera_control import CameraControl
from viewer.session.takes import Takes


@dataclass
class CameraKeys:
    editor: Editor
    takes: Takes
    control: CameraControl
    through: bool = False  # the view follows the keys while the take plays

    @property
    def take(self) -> Take | None:
        return self.takes.played

    @property
    def keys(self) -> tuple[CameraKey, ...]:
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

    def remove(self, key: CameraKey) -> None:
        if self.take is not None:
            kept = tuple(one for one in self.keys if one is not key)
            self._put(f"removal of a camera key of {self.take.title}", kept)

    def move(self, key: CameraKey, frame: int) -> None:
        """Put a key, as it was when the mouse took it, to another frame; a frame that has a key keeps its own."""
        playback, before = self.takes.playback, self.editor.history.present.session
        take = None if playback is None else before.take(playback.number)
        if take is None or playback is None:
            return
        fps, others = playback.clip.fps, [one for one in take.cameras if one is not key]
        if frame not in {round(one.seconds * fps) for one in others}:
            keys = with_key(others, replace(key, seconds=frame / fps), fps)
            self._put(f"move of a camera key of {take.title}", keys, held=True)
            playback.seek(frame)

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
        if imgui.selectable("Camera view##key", False)[0]:
            self.add()
        if self.keys and widgets.item("Look through the keys", chosen=self.through):
            self.through = not self.through
