"""Paths drawn on the ground with the mouse: the live character walks them, a take is resimulated along them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from runtime.controls import Controls, Gait
from runtime.errors import SportError
from runtime.motion.control_scripts import MAX_POINTS, PathWalk, PlanarPose, PointPath, Waypoint
from runtime.session.motion import Motion
from runtime.session.session import LIVE, Session, Take
from runtime.takes.take_path import path_of
from runtime.terrain.height_map import Terrain
from viewer.edit.handles import Handles, ground_under
from viewer.edit.pins import MIN_VIEW_PX, WIDTH_PX
from viewer.edit.resimulation import Resimulation
from viewer.editor import Editor
from viewer.gl_bindings import imgui
from viewer.gui import panels, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.render.camera import Camera
from viewer.render.overlays import PathOverlay
from viewer.scene.scene import Scene

DRAWN_M = 0.7  # between two points of a path drawn by dragging
DRAW_HINT = (
    "A drag on the ground draws the path, a click adds a point. Drag a point to move it, Delete removes it."
)
TAKE_HINT = "The path of the take: drag its points, choose speed and gait of each leg, delete the last ones to end there"
WALK_HINT = "Starts where the character stands; any key stops it"
GAITS = [(gait, gait.label.capitalize()) for gait in (Gait.WALK, Gait.JOG, Gait.CROUCH)]


@dataclass
class PathTool:
    """Draws and edits a path: the live character walks it, a playing take is resimulated along it."""

    editor: Editor
    editing: Resimulation
    scene: Scene
    active: bool = False  # clicks on the ground add points
    selected: int = -1
    walk: PathWalk | None = None
    _begun: bool = False  # since the last `walk_began`
    _time_s: float = 0.0
    _handles: Handles = field(default_factory=Handles)
    _drawing: bool = False  # the drag began with a new point and adds more
    _subject: int = LIVE  # the take to which `selected` refers
    _of_motion: tuple[Motion, tuple[Waypoint, ...]] | None = None

    def __post_init__(self) -> None:
        self.editor.followers.append(self.follow)

    @property
    def take(self) -> Take:
        return self.editing.take or self.editor.session.live

    @property
    def of_take(self) -> bool:
        """Whether the path belongs to a take that can be resimulated."""
        return self.editing.take is not None and (not self.editing.fixed or self.editing.busy)

    @property
    def points(self) -> tuple[Waypoint, ...]:
        """The path's points; while the tool is open, those of the take's own path if none are drawn."""
        take = self.take
        if take.path or take.motion is None or not (self.active and self.of_take):
            return take.path
        if self._of_motion is None or self._of_motion[0] is not take.motion:
            self._of_motion = take.motion, self._path_of(take.motion)
        return self._of_motion[1]

    def _path_of(self, motion: Motion) -> tuple[Waypoint, ...]:
        try:
            return () if motion.inputs is None else path_of(motion.clip, motion.inputs)
        except SportError as error:
            self.editor.messages.error(error)
            return ()

    def follow(self, before: Session, now: Session) -> None:
        """End the walk if the path has changed."""
        if before.live.path != now.live.path:
            self.walk = None

    def poll(self) -> None:
        """Keep the selection valid for the take that is shown; call once per frame."""
        number = self.take.number
        if number != self._subject:
            self._subject, self.active, self.selected = number, False, -1
        if self.active or self.selected >= 0:
            last = len(self.points) - 1
            if self.selected > last or (self.active and self.selected < 0):
                self.selected = last

    def overlay(self) -> PathOverlay | None:
        if not (self.active or self.walk is not None) or not self.points:
            return None
        return PathOverlay(np.array([(p.x, p.z) for p in self.points]), self.selected if self.active else -1)

    # --- points

    def _put(self, label: str, points: tuple[Waypoint, ...], held: bool = False) -> None:
        number = self.take.number
        name = "" if number == LIVE else f" of {self.take.title}"
        self.editor.put(f"{label}{name}", number, held, path=points)

    def add(self, x: float, z: float, held: bool = False) -> None:
        """Append a point with the speed and gait of the previous one."""
        points = self.points
        if len(points) < MAX_POINTS:
            before = points[-1] if points else Waypoint(x, z)
            self._put("points of the path", (*points, replace(before, x=x, z=z)), held)
            self.selected = len(points)

    def change(self, **values: float | Gait) -> None:
        """Change position, speed or gait of the selected point during a drag."""
        points, i = self.points, self.selected
        if 0 <= i < len(points):
            made = replace(points[i], **values)  # type: ignore[arg-type]
            self._put("point of the path", (*points[:i], made, *points[i + 1 :]), held=True)

    def delete(self) -> None:
        """Delete the selected point and select the one before."""
        points, i = self.points, self.selected
        if 0 <= i < len(points):
            self._put("removal of a point of the path", points[:i] + points[i + 1 :])
            self.selected = max(i - 1, 0) if len(points) > 1 else -1

    def clear(self) -> None:
        self._put("removal of the path", ())
        self.selected = -1

    def resimulate(self) -> None:
        """Resimulate the playing take along the path."""
        self.editor.finish_drag()
        self.editing.walk(self.points)

    # --- mouse

    def use_mouse(self, camera: Camera, terrain: Terrain) -> bool:
        """Add, select and drag points with the mouse; return whether the tool uses the left button."""
        io, handles = imgui.get_io(), self._handles
        if not self.active:
            return False
        if imgui.is_key_pressed(imgui.Key.delete) and not io.want_text_input:
            self.delete()
        points = np.array([(p.x, float(terrain.height(p.x, p.z)), p.z) for p in self.points])
        moves = handles.use_mouse(self.editor, camera, points)
        if not (handles.pressed or moves):
            return True
        place = ground_under(camera, terrain, io.mouse_pos, io.display_size)
        if handles.pressed:
            self._press(place)
        elif place is not None:
            self._drag_to(*place)
        return True

    def _press(self, place: tuple[float, float] | None) -> None:
        """Take the point under the mouse, or start drawing with a new one."""
        handles = self._handles
        self._drawing = handles.held < 0 and place is not None
        if handles.held >= 0:
            self.selected = handles.held
        elif place is not None:
            self.add(*place, held=True)
            handles.held = self.selected

    def _drag_to(self, x: float, z: float) -> None:
        if not self._drawing:
            self.change(x=x, z=z)
            return
        last = self.points[-1]
        if math.hypot(x - last.x, z - last.z) >= DRAWN_M:
            self.add(x, z, held=True)

    # --- walking

    def start(self) -> None:
        """Start walking the path from the character's place."""
        if self.points:
            self.walk = PointPath(self.points).walk_from(self._place)
            self._time_s, self._begun = 0.0, True

    def stop(self) -> None:
        self.walk = None

    def close(self) -> None:
        """Stop drawing."""
        self.active = False

    def walk_began(self) -> bool:
        begun, self._begun = self._begun, False
        return begun

    @property
    def _place(self) -> PlanarPose:
        pose = self.scene.simulation.current
        return PlanarPose(float(pose.root_position[0]), float(pose.root_position[2]), pose.root_yaw)

    def controls(self, own: Controls, dt: float) -> Controls:
        """Return the controls for walking the path; moving the stick ends the walk."""
        walk = self.walk
        if walk is None or any(own.move):
            self.walk = None
            return own
        stick = walk(self._time_s, self._place)
        self._time_s += dt
        if walk.ended:
            self.walk = None
            said = "Path completed." if walk.arrived else "Path crosses unwalkable ground."
            self.editor.messages.note(said)
        return stick

    # --- part of the scene panel

    def draw(self, draw_pins: Callable[[float], None]) -> None:
        """Draw the buttons to edit and walk the path; `draw_pins(width)` fills the end of the row."""
        third = widgets.column_width(3)
        of_take = self.of_take
        text, hint = ("Edit its path", TAKE_HINT) if of_take else ("Draw a path", DRAW_HINT)
        self.active = widgets.toggle(text, self.active, third, hint)
        widgets.same_line()
        enabled = self.points and (self.active or not of_take)
        if of_take:
            hint = "Resimulate the take along these points"
            if widgets.button("Resimulate###drive path", third, hint, enabled=enabled):
                self.resimulate()
        elif self.walk is not None:
            if widgets.button(
                f"{ICON.stop} Stop###walk path", third, "Stop and use the stick", enabled=enabled
            ):
                self.stop()
        elif widgets.button(f"{ICON.walk} Walk it###walk path", third, WALK_HINT, enabled=enabled):
            self.start()
        widgets.same_line()
        draw_pins(third)

    def panel(self) -> Panel:
        """Return the card of the selected point, shown while drawing; Escape ends drawing."""
        return Panel("Point", PanelPlace.VIEW, self._draw_card, shown=lambda: self.active, close=self.close)

    def _draw_card(self, view: Rect) -> None:
        if view.width < px(MIN_VIEW_PX):
            return
        with panels.card("Point", view, WIDTH_PX, right=True):
            if panels.card_title("Path", "path"):
                self.close()
            if 0 <= self.selected < len(self.points):
                self._draw_selected(self.points[self.selected])
            else:
                widgets.muted("Click on the ground to set points.", wrap=True)

    def _draw_selected(self, point: Waypoint) -> None:
        gait = widgets.segmented("path gait", GAITS, point.gait)
        widgets.full_width()
        text = f"to point {self.selected + 1}: %.0f %%"
        moved, speed = widgets.slider("##path speed", point.speed * 100.0, 10.0, 100.0, text)
        widgets.tooltip("Stick deflection on the way to this point")
        if gait != point.gait or moved:
            self.change(gait=gait, speed=speed / 100.0)
        widgets.buttons(
            ("Delete", "Remove this point (Delete)", self.delete), ("Clear", "Remove every point", self.clear)
        )
