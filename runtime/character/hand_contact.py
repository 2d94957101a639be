"""Keeps hands outside the character's own body: a hand that would enter trunk or head is moved to the surface by IK."""

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.character.body_surface import BodySurface
from runtime.character.skinned_mesh import SkinnedMesh
from runtime.character.two_bones import bend
from runtime.easing import smoothstep
from runtime.skeleton import SPORT_SKELETON

ANCHORS = tuple(SPORT_SKELETON.index(name) for name in ("Hips", "Spine1", "Head"))
# Our own body in metres: half width and depth of the trunk, from below the hips to the neck; the head around its centre.
TRUNK_WIDTH_M, TRUNK_DEPTH_M, TRUNK_LOW_M, TRUNK_HIGH_M = 0.16, 0.11, -0.06, 0.5
HEAD_RADIUS_M, HEAD_UP_M = 0.13, 0.08
NEAR_M, FAR_M = 0.06, 0.14  # surface to wrist: in contact, and free
BENT_ELBOW_RAD, STRAIGHT_ELBOW_RAD = np.radians((75.0, 40.0))  # elbow flexion


def touching(positions: AnyArray, world_rotations: AnyArray, arm: tuple[int, ...]) -> AnyArray:
    """Return how closely a hand touches trunk or head, `(...)`: 0 free, 1 in contact. `arm` are SPORT joints."""
    wrist = positions[..., arm[2], :]
    seen = rotations.rotate(rotations.inverse(world_rotations[..., 0, :]), wrist - positions[..., 0, :])
    over = np.maximum(np.maximum(TRUNK_LOW_M - seen[..., 1], seen[..., 1] - TRUNK_HIGH_M), 0.0)
    widths = np.hypot(seen[..., 0] / TRUNK_WIDTH_M, seen[..., 2] / TRUNK_DEPTH_M)
    aside = np.hypot(seen[..., 0], seen[..., 2]) * (1.0 - 1.0 / np.maximum(widths, 1.0))
    trunk = np.hypot(aside, over)
    middle = positions[..., ANCHORS[2], :] + np.array([0.0, HEAD_UP_M, 0.0])
    head = np.maximum(np.linalg.norm(wrist - middle, axis=-1) - HEAD_RADIUS_M, 0.0)
    upper, fore = (positions[..., arm[k + 1], :] - positions[..., arm[k], :] for k in (0, 1))
    cosine = np.sum(upper * fore, axis=-1) / np.linalg.norm(upper, axis=-1) / np.linalg.norm(fore, axis=-1)
    bent = np.arccos(np.clip(cosine, -1.0, 1.0))
    return ramp(np.minimum(trunk, head), FAR_M, NEAR_M) * ramp(bent, STRAIGHT_ELBOW_RAD, BENT_ELBOW_RAD)


def reach(positions: AnyArray, anchors: AnyArray, arm: tuple[int, ...]) -> AnyArray:
    """Return the wrist position `(..., 3)` that keeps its offsets from the character's own anchor joints.

    `anchors` `(..., 3, 3)` are the positions of `ANCHORS`; nearer anchors weigh more. Trunks must have the same orientation.
    """
    away = positions[..., arm[2], None, :] - positions[..., ANCHORS, :]
    weight = 1.0 / np.maximum(np.sum(away * away, axis=-1, keepdims=True), 1e-4)
    place: AnyArray = ((anchors + away) * weight).sum(axis=-2) / weight.sum(axis=-2)
    return place


def ramp(value: AnyArray, none: float, full: float) -> AnyArray:
    """Return a smooth weight that is 0 at `none` and 1 at `full`."""
    return smoothstep((value - none) / (full - none))


# of a motion: limit of a hand's change of offset per frame, relative to its fastest step nearby; range of such frames
STEP_FRACTION, NEAR_FRAMES = (0.25, 30)
MAX_TURN_STEP_RAD = 0.1  # per frame, of a hand in its wrist
PUSH_ROUNDS = 4  # of turning and pushing: moving out of one part may move into the next
MAX_WRIST_TURN_RAD = 1.2  # limit of the wrist's rotation
NECK_M, WAIST_M = 0.1, 0.25  # below the shoulder: a hand at neck or head does not turn, as it would flutter
FORWARD_WEIGHT = 0.4  # weight with which a hand pointing straight into the body turns forward, as on the hip
_ELBOW = np.array([0.0, -1.0, -0.5])  # direction in which a straight arm bends
ARM = {
    side: tuple(SPORT_SKELETON.index(side + bone) for bone in ("Arm", "ForeArm", "Hand"))
    for side in ("Left", "Right")
}
BELOW = {
    side: tuple(SPORT_SKELETON.index(name) for name in (f"{side}Hand", f"{side}FingerBase", f"{side}HandIndex1", f"{side[0]}Thumb"))
    for side in ("Left", "Right")
}  # fmt: skip


Joints = tuple[AnyArray, AnyArray]  # positions (..., 31, 3) and world rotations (..., 31, 4) of a pose


def clear_hands(
    mesh: SkinnedMesh,
    body: BodySurface | None,
    positions: AnyArray,
    world_rotations: AnyArray,
    frames: bool = False,
) -> Joints:
    """Move hands that sink into the surface `body` of `mesh` onto it, in a SPORT pose of any leading shape.

    The wrist turns first, so that the fingers lie along the body; then shoulder and elbow move the hand out. Poses with
    free hands are unchanged. With `frames`, poses are a motion `(T, ...)`, and a hand that passes through the body
    keeps its speed instead of jumping from one side to the other.
    """
    if body is None:
        return positions, world_rotations
    pivots, _ = mesh.joint_transforms(positions, world_rotations)
    if not mesh.alignment.native:
        pivots, world_rotations = _placed(mesh, body.sides, pivots, (positions, world_rotations), frames)
    seen = _Seen(mesh, body, pivots, world_rotations)
    if seen.free:
        return positions, world_rotations
    turns = seen.turns()
    way = seen.way_out(turns)
    if frames:
        turns = rotations.from_rotation_vector(
            without_jumps(rotations.to_rotation_vector(turns), np.full(turns.shape[:-1], MAX_TURN_STEP_RAD))
        )
        way = without_jumps(way, _steps(seen.wrists))
    pose = positions, world_rotations
    for k, side in enumerate(body.sides):
        if np.any(turns[..., k, 1:]):
            pose = _turned(mesh, side, turns[..., k, :], pose)
        if np.any(way[..., k, :]):
            pose = _bent(mesh, side, way[..., k, :], pivots, pose)
    return pose


def _joint(mesh: SkinnedMesh, side: str, bone: int) -> int:
    return int(np.flatnonzero(mesh.alignment.source == ARM[side][bone])[0])


def _placed(
    mesh: SkinnedMesh, sides: tuple[str, ...], pivots: AnyArray, pose: Joints, frames: bool
) -> tuple[AnyArray, AnyArray]:
    """Return pivots and rotations with touching hands at the corresponding place of this body."""
    source, (positions, world_rotations) = mesh.alignment.source, pose
    if not all(np.any(source == j) for j in ANCHORS):
        return pivots, world_rotations
    anchors = pivots[..., [int(np.flatnonzero(source == j)[0]) for j in ANCHORS], :]
    placed = world_rotations
    for side in sides:
        touch = touching(positions, world_rotations, ARM[side])
        if np.any(touch):
            wrist = pivots[..., _joint(mesh, side, 2), :]
            way = touch[..., None] * (reach(positions, anchors, ARM[side]) - wrist)
            way = without_jumps(way, _steps(wrist)) if frames else way
            _, placed = _bent(mesh, side, way, pivots, (positions, placed))
    if placed is world_rotations:
        return pivots, placed
    return mesh.joint_transforms(positions, placed)[0], placed


def _steps(wrists: AnyArray) -> AnyArray:
    """Return the largest change (metres, `(T, ...)`) of a hand offset to the next frame: a fraction of the fastest wrist step nearby.

    `wrists` `(T, ..., 3)` in each frame.
    """
    steps = np.linalg.norm(np.diff(wrists, axis=0, append=wrists[-1:]), axis=-1)
    ends = [(NEAR_FRAMES, NEAR_FRAMES)] + [(0, 0)] * (steps.ndim - 1)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(steps, ends, "edge"), 2 * NEAR_FRAMES + 1, axis=0)
    return np.asarray(STEP_FRACTION * near.max(-1))


def without_jumps(values: AnyArray, steps: AnyArray) -> AnyArray:
    """Limit the change of values `(T, ..., n)` between frames to `steps` `(T, ...)`.

    The result is the mean of a forward and a backward pass, so that a jump becomes a ramp about its middle.
    """
    change = np.linalg.norm(np.diff(values, axis=0), axis=-1)
    if not np.any(change > steps[:-1]):
        return values
    later = _followed(values, steps[:-1])
    before = _followed(values[::-1], steps[-2::-1])[::-1]
    return np.asarray(0.5 * (later + before))


def _followed(values: AnyArray, steps: AnyArray) -> AnyArray:
    """Follow values `(T, ..., n)`, changing by at most `steps` `(T - 1, ...)` per frame."""
    found = np.array(values, np.float64)
    for side in np.ndindex(values.shape[1:-1]):
        every = (slice(None), *side)
        own, wanted, limits = found[every], values[every], steps[every]
        for first in np.flatnonzero(np.linalg.norm(np.diff(wanted, axis=0), axis=-1) > limits):
            for t in range(first + 1, len(wanted)):
                gap = wanted[t] - own[t - 1]
                length = float(np.linalg.norm(gap))
                if length <= limits[t - 1]:
                    own[t] = wanted[t]
                    break
                own[t] = own[t - 1] + gap * (limits[t - 1] / length)
    return found


class _Seen:
    """The hands relative to the joints of the surface tables; any leading shape `...`, S sides and T tables."""

    def __init__(
        self, mesh: SkinnedMesh, body: BodySurface, pivots: AnyArray, world_rotations: AnyArray
    ) -> None:
        self.body = body
        self.wrists = pivots[..., [_joint(mesh, side, 2) for side in body.sides], :]
        shoulders = pivots[..., [_joint(mesh, side, 0) for side in body.sides], 1]
        self.low = ramp(shoulders - self.wrists[..., 1], NECK_M, WAIST_M)
        turned = world_rotations[..., [ARM[side][2] for side in body.sides], :]
        self.hands = rotations.rotate(turned[..., None, :], body.hands)  # (..., S, n, 3) about the wrists
        self.axes = rotations.to_matrix(world_rotations[..., body.sources, :])  # (..., T, 3, 3)
        self.places = pivots[..., body.joints, :]
        self.ahead = rotations.to_matrix(world_rotations[..., :1, :])[..., 2]  # (..., 1, 3)

    def _depth(self, hands: AnyArray, way: AnyArray | float = 0.0) -> tuple[AnyArray, AnyArray]:
        """Return the maximum depth `(..., S, T)` of hands moved by `way`, and the directions out `(..., S, T, 3)`."""
        points = (self.wrists + way)[..., None, :] + hands
        # not of the fingers alone, which may be beyond an axis
        middle = 0.5 * (points.mean(axis=-2) + self.wrists + way)
        axes = self.axes[..., None, :, :, :]
        points = (points[..., :, None, :, :] - self.places[..., None, :, None, :]) @ axes
        middle = middle[..., :, None, :] - self.places[..., None, :, :]
        middle = (middle[..., None, :] @ axes)[..., 0, :]
        out = (axes @ self.body.outward(middle)[..., None])[..., 0]
        return self.body.depth(points).max(axis=-1)[..., None], out

    @property
    def free(self) -> bool:
        """Return whether both hands are outside the body."""
        return not np.any(self._depth(self.hands)[0])

    def turns(self) -> AnyArray:
        """Return wrist rotations `(..., S, 4)` that lay the hands along the surface, outwards and forwards."""
        turns = np.zeros((*self.wrists.shape[:-1], 4))
        turns[..., 0] = 1.0
        left = MAX_WRIST_TURN_RAD * self.low
        for _ in range(PUSH_ROUNDS):
            hands = rotations.rotate(turns[..., None, :], self.hands)
            deep, out = self._depth(hands)
            if not np.any(deep):
                break
            way = rotations.normalize((deep * out).sum(axis=-2))
            aside = 1.0 - np.sum(way * self.ahead, axis=-1, keepdims=True) ** 2
            way = way + FORWARD_WEIGHT * aside * self.ahead
            reach = hands.mean(axis=-2)
            axis = np.cross(reach, way)
            angle = self.low * deep.max(axis=(-2, -1)) / np.linalg.norm(hands, axis=-1).max(axis=-1)
            angle = np.minimum(angle, left)
            left = left - angle
            turns = rotations.multiply(rotations.from_axis_angle(rotations.normalize(axis), angle), turns)
        return turns

    def way_out(self, turns: AnyArray) -> AnyArray:
        """Return shifts `(..., S, 3)` that bring all points of the turned hands out of trunk and head."""
        hands = rotations.rotate(turns[..., None, :], self.hands)
        way: AnyArray = np.zeros(self.wrists.shape, np.float64)
        for _ in range(PUSH_ROUNDS):
            deep, out = self._depth(hands, way)
            if not np.any(deep):
                break
            # weighted by depth, so that the shift is continuous from one part to another
            way = way + (deep * deep * out).sum(axis=-2) / np.maximum(deep.sum(axis=-2), 1e-9)
        return way


def _turned(mesh: SkinnedMesh, side: str, turn: AnyArray, pose: Joints) -> Joints:
    """Return the pose with a hand rotated about its wrist."""
    positions, world_rotations = pose
    world, at, below = np.array(world_rotations), np.array(positions), list(BELOW[side])
    free = ~np.any(turn[..., 1:], axis=-1)[..., None, None]
    turned = rotations.multiply(turn[..., None, :], world_rotations[..., below, :])
    world[..., below, :] = np.where(free, world_rotations[..., below, :], turned)
    if mesh.alignment.native:
        wrist = positions[..., below[:1], :]
        moved = wrist + rotations.rotate(turn[..., None, :], positions[..., below, :] - wrist)
        at[..., below, :] = np.where(free, positions[..., below, :], moved)
    return at, world


def _bent(mesh: SkinnedMesh, side: str, way: AnyArray, pivots: AnyArray, pose: Joints) -> Joints:
    """Return the pose with an arm bent so that its hand moves by `way`, in the plane of its elbow."""
    positions, world_rotations = pose
    shoulder, elbow, hand = (pivots[..., _joint(mesh, side, bone), :] for bone in range(3))
    upper, lower, moved = bend(shoulder, elbow, hand, hand + way, _ELBOW)
    world, arm = np.array(world_rotations), ARM[side]
    free = ~np.any(way, axis=-1)[..., None]  # stays bit-identical
    for j, turn in ((arm[0], upper), (arm[1], lower)):
        turned = rotations.multiply(turn, world_rotations[..., j, :])
        world[..., j, :] = np.where(free, world_rotations[..., j, :], turned)
    at = np.array(positions)
    if mesh.alignment.native:
        bent = shoulder + rotations.rotate(upper, elbow - shoulder)
        at[..., arm[1], :] = np.where(free, at[..., arm[1], :], bent)
        for j in BELOW[side]:
            at[..., j, :] = np.where(free, at[..., j, :], at[..., j, :] + moved - hand)
    return at, world
