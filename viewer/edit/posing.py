"""Posing by hand: a joint picked in the view is rotated or moved by a gizmo, which keys the take's pose layer."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.errors import SportError
from runtime.pose import Pose
from runtime.takes.pose_layer import (
    POSE_CURVES,
    Curve,
    PoseKey,
    PoseLayer,
    Tangent,
    dragged,
    mirrored_pose,
    pose_as_key,
    posed_by,
    turned,
)
from viewer.edit.handles import Handles, Rings, on_screen
from viewer.edit.handles import dragged as handles_moved
from viewer.edit.pins import MIN_VIEW_PX, SMALL_WIDTH_PX, WIDTH_PX, Pins
from viewer.editor import Editor
from viewer.gl_bindings import im_guizmo, imgui
from viewer.gui import panels, theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.widgets import px
from viewer.render.camera import Camera
from viewer.scene.camera_control import CameraControl
from viewer.session.playback import Playback
from viewer.session.takes import Takes

_SIDES = (("Left", 0, 0), ("Right", 5, 7))  # with the index offsets of its leg and arm joints
_LEG, _ARM = (
    ((2, "hip"), (3, "knee"), (4, "foot"), (5, "toes")),
    ((18, "shoulder"), (19, "elbow"), (20, "hand")),
)
# joints that can be picked; the others coincide with these
NAMES = {0: "Hips", 12: "Waist", 13: "Chest", 15: "Neck", 16: "Head"} | {
    joint + more: f"{side} {name}"
    for side, leg, arm in _SIDES
    for names, more in ((_LEG, leg), (_ARM, arm))
    for joint, name in names
}
JOINTS = tuple(NAMES)
ARROWS_WIDTH_FRACTION = 0.1  # approximate fraction of the view's width
NARROW_PX, LOW_PX = 520.0, 330.0  # in a narrower view the card is small, in a lower one it has no curves
STILL_M = 1e-6


@dataclass
class Posing:
    """The posing tool: whether it is open, the picked joint, and the gizmo's mode."""

    editor: Editor
    takes: Takes
    camera: CameraControl
    pins: Pins
    open_curves: Callable[[], None]
    open: bool = False
    joint: int = -1  # of the skeleton; -1 for none
    moves: bool = False  # the gizmo moves the joint; else it turns it
    world: bool = True  # the gizmo's axes are those of the world; else the joint's own
    _copied: tuple[Array, Array] | None = None  # hips and local rotations
    _handles: Handles = field(default_factory=Handles)
    rings: Rings = field(default_factory=Rings)

    @property
    def shown(self) -> bool:
        """Whether a take can be posed now."""
        return self._posed is not None

    @property
    def _posed(self) -> Playback | None:
        free = self.open and self.pins.pin is None and not self.pins.fixed
        return self.takes.playback if free else None

    @property
    def place(self) -> Array | None:
        """Position `(3,)` of the picked joint, or None."""
        playback = self.takes.playback
        return None if playback is None or self.joint < 0 else playback.pose().positions[self.joint]

    @property
    def layer(self) -> PoseLayer:
        """The pose layer of the playing take."""
        return PoseLayer() if self.takes.playback is None else self.takes.playback.take.poses.layer

    @property
    def key(self) -> PoseKey | None:
        """The pose key at the frame shown, or None."""
        playback = self.takes.playback
        return None if playback is None else self.layer.key_at(playback.frame, playback.clip.fps)

    def toggle(self) -> None:
        """Open or close the tool."""
        self.open = not self.open
        if self.open:
            self.pins.close()
            if self.takes.playback is not None:
                self.takes.playback.seek(self.takes.playback.frame)

    def close(self) -> None:
        """Deselect the joint, or close the tool if none is picked."""
        self.open, self.joint = self.joint >= 0 and self.open, -1

    # --- edits

    def edit(self, label: str, change: Callable[[PoseKey], PoseKey], held: bool = False) -> None:
        """Key the pose that `change` makes of the shown one; `held` while the gizmo is dragged."""
        playback = self.takes.playback
        if playback is not None:
            fps = playback.clip.fps
            self.put(label, lambda layer: layer.edited(playback.frame, fps, change), held)

    def put(self, label: str, change: Callable[[PoseLayer], PoseLayer], held: bool = False) -> None:
        playback = self.takes.playback
        if playback is None or self.pins.fixed:
            return
        take = playback.take
        try:
            poses = replace(take.poses, layer=change(take.poses.layer))
        except SportError as error:
            self.editor.messages.error(error)
            return
        self.editor.put(f"{label} of {take.title}", take.number, held, poses=poses)

    def set_key(self, release: bool = False) -> None:
        """Key the picked joint as it is, or `release` it: from this key on it follows the motion again."""
        joint, playback = self.joint, self.takes.playback
        if joint < 0 or playback is None:
            return
        seconds, fps = playback.frame / playback.clip.fps, playback.clip.fps

        def change(layer: PoseLayer) -> PoseLayer:
            key, shown = layer.key_at(playback.frame, fps) or PoseKey(seconds), layer.between(seconds)
            gain = 0.0 if release else 1.0
            for one in posed_by(joint):
                for curve in POSE_CURVES:
                    picked = curve is Curve.TURN and one == joint and not release
                    if picked or one in layer.joints(curve):
                        key = key.with_value(curve, one, gain * shown.value(curve, one))
            return layer.with_key(key, fps)

        self.put(f"{'release' if release else 'key'} of the {NAMES[joint].lower()}", change)

    def remove_joint(self) -> None:
        """Remove the picked joint from the key at the frame shown; an empty key is deleted."""
        key, joint, playback = self.key, self.joint, self.takes.playback
        if key is not None and playback is not None:
            left = key
            for one in posed_by(joint) if joint >= 0 else ():
                left = left.without(one)
            self.put(
                f"removal of the {NAMES[joint].lower()}'s key" if joint >= 0 else "removal of a pose key",
                lambda layer: (
                    layer.with_key(left, playback.clip.fps) if left and joint >= 0 else layer.without_key(key)
                ),
            )

    def set_tangent(self, tangent: Tangent) -> None:
        """Set the tangent mode of the key at the frame shown."""
        key, playback = self.key, self.takes.playback
        if key is not None and playback is not None and key.tangent is not tangent:
            made = replace(key, tangent=tangent)
            self.put("tangent of a pose key", lambda layer: layer.with_key(made, playback.clip.fps))

    # --- poses

    def copy(self) -> None:
        """Copy the shown pose."""
        playback = self.takes.playback
        if playback is not None:
            pose = playback.pose()
            self._copied = np.array(pose.hips_position), np.array(pose.local_rotations)
            self.editor.messages.note("Pose copied. Paste it at another frame, or into another take.")

    def paste(self, mirror: bool = False) -> None:
        """Key the copied pose, or its mirror image, at the frame shown."""
        playback = self.takes.playback
        if playback is None or self._copied is None:
            self.editor.messages.note("Copy a pose first.")
            return
        hips, local = self._copied
        local = mirrored_pose(local) if mirror else local
        key = pose_as_key(hips, local, playback.take.below_layer, playback.frame)
        self.put("pasted pose", lambda layer: layer.with_key(key, playback.clip.fps))

    # --- in the view

    def use_mouse(self, camera: Camera) -> bool:
        """Pick a joint with the mouse; return whether the left button is in use."""
        playback = self._posed
        if playback is None:
            return False
        pose, handles = playback.pose(), self._handles
        drawn = self.joint >= 0 and handles.held < 0  # otherwise its state is outdated
        over = im_guizmo.get_hovered_handle_type() is not im_guizmo.MOVETYPE.mt_none
        if drawn and (over or im_guizmo.is_using_any() if self.moves else self.rings.used):
            return True
        moves = handles.use_mouse(self.editor, camera, pose.positions[list(JOINTS)])
        if handles.held < 0:
            return False
        if handles.pressed:
            self.joint = JOINTS[handles.held]
            playback.seek(playback.frame)
        if moves:
            place = pose.positions[self.joint].astype(float)
            self._move(pose, handles_moved(camera, place) - place)
        return True

    def panel(self) -> Panel:
        """Return the tool's card, with joint dots and gizmo in the view; Escape deselects the joint, then closes."""
        return Panel("Pose", PanelPlace.VIEW, self._draw, shown=lambda: self.shown, close=self.close)

    def _draw(self, view: Rect) -> None:
        playback = self.takes.playback
        if playback is None:
            return
        pose = playback.pose()
        self._draw_joints(pose)
        if self.joint >= 0 and self._handles.held < 0:
            self._gizmo(pose)
        if view.width >= px(MIN_VIEW_PX):
            _draw_card(self, view)

    def _draw_joints(self, pose: Pose) -> None:
        drawing, size = imgui.get_background_draw_list(), imgui.get_io().display_size
        held = {value.joint for key in self.layer.keys for value in (*key.turns, *key.moves)}
        for joint in JOINTS:
            place = on_screen(self.camera.current, pose.positions[joint], size)
            if place is not None:
                tint = theme.ACCENT if joint == self.joint or joint in held else theme.TEXT
                radius = px(5.5 if joint == self.joint else 3.5)
                drawing.add_circle_filled(imgui.ImVec2(*place), radius + px(1), widgets.packed(theme.PANEL))
                drawing.add_circle_filled(imgui.ImVec2(*place), radius, widgets.packed(tint))

    def _gizmo(self, pose: Pose) -> None:
        """Draw the gizmo of the picked joint, and key its changes."""
        joint, place = self.joint, pose.positions[self.joint].astype(float)
        world = pose.world_rotations.astype(float)
        axes = np.eye(3) if self.world else rotations.to_matrix(world[joint])
        if self.moves:
            by = _moved_by(self.camera.current, place, axes)
            if np.abs(by).max() > STILL_M:
                self._move(pose, by)
            return
        turn = self.rings.turn(self.camera.current, place, axes)
        if turn is not None:
            label = f"turn of the {NAMES[joint].lower()}"
            self.edit(label, lambda key: turned(key, joint, world, turn), held=True)

    def _move(self, pose: Pose, by: Array) -> None:
        """Key the picked joint moved by a world vector `(3,)` in metres, during a drag."""
        joint, positions, world = self.joint, pose.positions.astype(float), pose.world_rotations.astype(float)
        label = f"move of the {NAMES[joint].lower()}"
        self.edit(label, lambda key: dragged(key, joint, positions, world, by), held=True)


def _moved_by(camera: Camera, place: Array, axes: Array) -> Array:
    """Draw arrows at a joint along `axes`, and return the world vector `(3,)` (metres) of the drag."""
    size, before = imgui.get_io().display_size, np.eye(4)
    before[:3, :3], before[:3, 3] = axes, place
    matrix = _matrix(before)
    im_guizmo.begin_frame()
    im_guizmo.set_rect(0.0, 0.0, size.x, size.y)
    im_guizmo.set_gizmo_size_clip_space(ARROWS_WIDTH_FRACTION)
    im_guizmo.manipulate(
        _matrix(camera.view_matrix()),
        _matrix(camera.projection_matrix(size.x / max(size.y, 1.0))),
        im_guizmo.OPERATION.translate,
        im_guizmo.MODE.local,
        matrix,
    )
    after = np.array(matrix.values, float).reshape(4, 4).T
    return after[:3, 3] - place if im_guizmo.is_using_any() else np.zeros(3)


def _matrix(values: Array) -> im_guizmo.Matrix16:
    return im_guizmo.Matrix16([float(value) for value in np.asarray(values).T.ravel()])


def _draw_card(posing: Posing, view: Rect) -> None:
    with panels.card("Pose", view, SMALL_WIDTH_PX if view.width < px(NARROW_PX) else WIDTH_PX, right=True):
        if panels.card_title(NAMES.get(posing.joint, "Click a joint"), "pose"):
            posing.open, posing.joint = False, -1
        half = widgets.column_width(2)
        posing.moves = widgets.segmented("gizmo", ((False, "Turn"), (True, "Move")), posing.moves)
        posing.world = widgets.segmented("axes", ((True, "World"), (False, "Local")), posing.world)
        imgui.begin_disabled(posing.joint < 0)
        widgets.buttons(
            ("Key##pose", "Key the joint as it is at this frame", posing.set_key),
            ("Free##pose", "From here on the joint follows the motion", lambda: posing.set_key(release=True)),
            ("Del##pose", "Remove the joint from the key at this frame", posing.remove_joint),
        )
        imgui.end_disabled()
        mirror = partial(posing.paste, mirror=True)
        widgets.buttons(
            ("Copy##pose", "Copy the whole pose", posing.copy),
            ("Paste##pose", "Key the copied pose here", posing.paste),
            ("Mirror##pose", "Key the mirror image of the copied pose here", mirror),
        )
        if view.height < px(LOW_PX):
            return
        _draw_layer(posing, half)


def _draw_layer(posing: Posing, half: float) -> None:
    layer, key = posing.layer, posing.key
    if widgets.button("Curves##pose", half, "Curves of the keys, their tangents and eases"):
        posing.open_curves()
    widgets.same_line()
    hint = "The last key of each joint holds to the end of the take"
    if widgets.toggle("Hold last", layer.keeps, half, hint) != layer.keeps:
        posing.put("keeping of the pose layer", lambda layer: replace(layer, keeps=not layer.keeps))
    with widgets.disabled(key is None):
        widgets.full_width()
        options = [(tangent, str(tangent).capitalize()) for tangent in Tangent]
        chosen = widgets.combo("##tangent", options, Tangent.SMOOTH if key is None else key.tangent)
        widgets.tooltip("Tangent of this key")
    if key is not None and isinstance(chosen, Tangent):
        posing.set_tangent(chosen)
