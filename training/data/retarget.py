"""Retargeting of source BVH to the SPORT skeleton at 60 Hz: rotations by calibrated rest poses, feet by two-bone IK."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.easing import smoothstep
from runtime.feet.ik import solve_legs
from runtime.formats.bvh import BvhMotion
from runtime.motion.features import FPS
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT
from training.data.source_skeletons import SourceJoint, SourceSkeleton

FOOT_OFFSET = SPORT_SKELETON.offsets[5].astype(np.float64)  # ankle to toe in the rest pose
MAX_FLATTER, MAX_STEEPER = np.deg2rad(20.0), np.deg2rad(30.0)
_LATERAL, _AHEAD = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def heel_rise(hip: Array, toe: Array, foot: Array, length: Array) -> Array:
    """Return the pitch in radians of feet `(..., 4)` over standing toes `(..., 3)` (positive: the heel rises).

    It brings the ankle to `length` `(...)` metres from `hip` `(..., 3)`, or as near as possible, within the range of a
    foot. Otherwise feet longer or shorter than the source's would change knee flexion in every push-off, or overstretch
    the leg.
    """
    arm = -rotations.rotate(foot, FOOT_OFFSET)  # toe to ankle
    across = rotations.rotate(foot, _LATERAL)
    to_hip = hip - toe
    # |arm(d) - to_hip| = length, where arm(d) . to_hip = a cos d + b sin d
    a, b = np.sum(arm * to_hip, axis=-1), np.sum(np.cross(across, arm) * to_hip, axis=-1)
    wanted = 0.5 * (np.sum(arm * arm, axis=-1) + np.sum(to_hip * to_hip, axis=-1) - length * length)
    most = np.arctan2(b, a)  # the pitch of the shortest leg
    away = np.arccos(np.clip(wanted / np.maximum(np.hypot(a, b), 1e-9), -1.0, 1.0))
    first, second = _wrapped(most - away), _wrapped(most + away)
    nearest = np.where(np.abs(first) < np.abs(second), first, second)
    return np.clip(nearest, -MAX_FLATTER, MAX_STEEPER)


def pitched(foot: Array, angle: Array | float) -> Array:
    """Rotations `(..., 4)` turned about their own lateral axis so that +Z (toes, face) sinks by `angle`."""
    return rotations.multiply(foot, rotations.from_axis_angle(_LATERAL, np.asarray(angle)))


def _wrapped(angle: Array) -> Array:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


LEG_LENGTH = float(-(SPORT_SKELETON.offsets[3][1] + SPORT_SKELETON.offsets[4][1]))
# from the hips joint to the midpoint of the hip joints
HIP_CENTRE = np.array([0.0, *SPORT_SKELETON.offsets[2][1:]], np.float64)
COLLAR_LENGTH = float(np.linalg.norm(SPORT_SKELETON.offsets[18]))
TRUNK = SPORT_SKELETON.offsets[12:14].astype(np.float64)  # hips to Spine, Spine to the base of the neck
STANCE_SPEED = 0.25  # m/s
TOE_DOWN_M, TOE_UP_M = 0.02, 0.06  # above its lowest height nearby: of a planted and of a swinging toe
TOE_REACH_SECONDS = 0.3  # for "nearby"
TOE_FLEX_LIMIT = np.deg2rad(50.0)
_SIDES = ("Left", "Right")
# of the tilt that levels the gaze, spread over both joints to avoid a kink in the neck
_HEAD_LIFT_PARTS = {SPORT_SKELETON.index("Neck1"): 1 / 3, SPORT_SKELETON.index("Head"): 2 / 3}
_MIRROR_TURN = np.array([1.0, 1.0, -1.0, -1.0])  # of a quaternion under reflection at the plane X = 0


@dataclass(frozen=True)
class SourceMotion:
    """World-space motion of a source at 60 Hz, scaled to our leg length, with rest-pose corrections applied.

    `rotations` holds our world rotation `(T, 4)` per driven joint. `hip_joints`, `ankles` and `toes` `(T, 2, 3)` are
    metres in the source's own height over the ground; `trunk` `(T, 3)` points from its hips joint to the base of its neck.
    `collar_fraction`: factor on our collar bone's rotation that moves the shoulder as far as the source's. `head_lift`:
    upward tilt of the face, radians.
    """

    rotations: dict[str, Array]
    hip_joints: Array
    ankles: Array
    toes: Array
    trunk: Array
    collar_fraction: float = 1.0
    head_lift: float = 0.0

    @property
    def hip_centre(self) -> Array:
        """Midpoint of the hip joints `(T, 3)`."""
        return self.hip_joints.mean(1)


@dataclass(frozen=True)
class FootCalibration:
    """Constants of one source skeleton, measured where its feet stand flat.

    `foot_turn`, `toe_turn` `(2, 4)`: rotations that bring a flat foot's frame to our rest pose (sole level, +Z towards the
    toe); `toe_offset` `(2, 3)`: difference of its ankle-toe vector from ours, in the frame of the flat foot;
    `ankle_height`: scaled metres.
    """

    foot_turn: Array
    toe_turn: Array
    toe_offset: Array
    ankle_height: float


def load_source(
    motion: BvhMotion, skeleton: SourceSkeleton, first_frame: int = 0, reference: BvhMotion | None = None
) -> SourceMotion:
    """Return the world motion of `motion` from `first_frame` on, resampled to 60 Hz and scaled to our legs.

    `reference` is the take that `skeleton.reference` names.
    """
    positions, world = motion.world()
    positions, world = positions[first_frame:].astype(np.float64), world[first_frame:].astype(np.float64)
    corrections = skeleton.corrections(reference or motion)
    index = motion.skeleton.index
    thighs, shins, feet = (
        [index(skeleton.joints[side + part].name) for side in _SIDES] for part in ("UpLeg", "Leg", "Foot")
    )
    leg = np.mean(np.linalg.norm(motion.skeleton.offsets[shins + feet], axis=-1)) * 2.0
    scale = skeleton.fixed_scale or LEG_LENGTH / leg
    toes = _toes(motion, skeleton, feet, positions, world)
    times = sample_times(len(positions), motion.fps)

    def driven(joint: SourceJoint, correction: Array) -> Array:
        q = world[:, index(joint.name)]
        if joint.towards:
            q = rotations.slerp(q, world[:, index(joint.towards)], joint.blend)
        return resample_rotations(rotations.multiply(q, correction), times)

    arms = [index(skeleton.joints[side + "Arm"].name) for side in _SIDES]
    collar = np.linalg.norm(motion.skeleton.offsets[arms], axis=-1).mean() * scale
    trunk = positions[:, index(skeleton.neck_base)] - positions[:, index(skeleton.joints["Hips"].name)]
    return SourceMotion(
        {target: driven(joint, corrections[target]) for target, joint in skeleton.joints.items()},
        resample_positions(positions[:, thighs] * scale, times),
        resample_positions(positions[:, feet] * scale, times),
        resample_positions(toes * scale, times),
        resample_positions(trunk * scale, times),
        float(min(1.0, collar / COLLAR_LENGTH)),
        float(np.deg2rad(skeleton.head_lift_degrees)),
    )


def _toes(
    motion: BvhMotion, skeleton: SourceSkeleton, feet: list[int], positions: Array, world: Array
) -> Array:
    """Return toes `(T, 2, 3)`: joints, or end sites of the feet."""
    if skeleton.toe_is_end_site:
        ends = np.stack([motion.end_offsets[j] for j in feet])
        return positions[:, feet] + rotations.rotate(world[:, feet], ends)
    index = motion.skeleton.index
    return positions[:, [index(skeleton.joints[side + "ToeBase"].name) for side in _SIDES]]


def sample_times(frames: int, fps: float) -> Array:
    """Return fractional source frames at 60 Hz; integers if the source has 60 Hz."""
    if abs(fps - FPS) < 0.6:
        return np.arange(frames, dtype=np.float64)
    return np.arange(int((frames - 1) * FPS / fps + 1e-6) + 1) * (fps / FPS)


def resample_rotations(q: Array, times: Array) -> Array:
    """Interpolate quaternions `(T, ..., 4)` at fractional frames by slerp, with continuous sign."""
    low = np.clip(times.astype(np.int64), 0, max(len(q) - 2, 0))
    high = np.minimum(low + 1, len(q) - 1)
    fraction = (times - low).reshape(-1, *([1] * (q.ndim - 2)))
    if not np.any(fraction):
        return rotations.continuous(q[low])
    return rotations.continuous(rotations.slerp(q[low], q[high], fraction))


def resample_positions(p: Array, times: Array) -> Array:
    """Interpolate positions `(T, ..., 3)` at fractional frames by cubic splines."""
    from scipy.interpolate import CubicSpline

    if len(times) == len(p) or len(p) < 4:
        return p[np.clip(np.round(times).astype(np.int64), 0, len(p) - 1)]
    return CubicSpline(np.arange(len(p)), p, axis=0)(times)


def speed(p: Array) -> Array:
    """Return the speed in m/s `(T, ...)` of positions `(T, ..., 3)` at 60 Hz, by central differences."""
    if len(p) < 3:
        return np.zeros(p.shape[:-1])
    return np.linalg.norm(np.gradient(p, axis=0), axis=-1) * FPS


def _elevation(q: Array) -> Array:
    """Return the elevation of local +Z, radians."""
    return np.arcsin(np.clip(rotations.rotate(q, _AHEAD)[..., 1], -1.0, 1.0))


def _yaw(q: Array) -> Array:
    forward = rotations.rotate(q, _AHEAD)
    return rotations.from_yaw(np.arctan2(forward[..., 0], forward[..., 2]))


def calibrate_feet(clips: list[SourceMotion]) -> FootCalibration:
    """Calibrate feet on frames where they stand flat: slow, and at their usual height in the clip."""
    left, right = (_calibrate_foot(clips, side) for side in range(2))
    # source rigs are symmetric: differences between the sides are posture and noise
    turns = []
    for one, other in zip(left[:2], right[:2], strict=True):
        both = rotations.slerp(one, other * _MIRROR_TURN, 0.5)
        turns.append(np.stack([both, both * _MIRROR_TURN]))
    return FootCalibration(
        turns[0], turns[1], np.stack([left[2], right[2]]), float(np.mean([left[3], right[3]]))
    )


def _calibrate_foot(clips: list[SourceMotion], side: int) -> tuple[Array, Array, Array, float]:
    """Return foot turn, toe turn, toe offset and ankle height of one side; clips count equally, however long their idles."""
    stances = [(clip, mask) for clip in clips if (mask := _flat_stance(clip, side)).sum() >= 10]
    if not stances:
        identity = rotations.identity().astype(np.float64)
        return identity, identity, np.zeros(3), ANKLE_HEIGHT
    name, toe = _SIDES[side] + "Foot", _SIDES[side] + "ToeBase"
    up = np.array([0.0, 1.0, 0.0])

    def vote(measured: Callable[[SourceMotion, NDArray[np.bool_]], Array]) -> Array:
        return np.median(np.stack([np.median(measured(c, m), axis=0) for c, m in stances]), axis=0)

    def foot(c: SourceMotion, m: NDArray[np.bool_]) -> Array:
        return rotations.multiply(c.rotations[name][m], turn)

    def bone(c: SourceMotion, m: NDArray[np.bool_]) -> Array:
        return c.toes[m, side] - c.ankles[m, side]

    def under_toe(c: SourceMotion, m: NDArray[np.bool_]) -> Array:
        relative = rotations.multiply(rotations.inverse(c.rotations[toe][m]), foot(c, m))
        return relative * np.sign(relative[:, :1])

    turn = rotations.between(up, rotations.normalize(vote(lambda c, m: _into(c.rotations[name][m], up))))
    ahead = vote(lambda c, m: _into(foot(c, m), bone(c, m)))
    turn = rotations.multiply(turn, rotations.from_yaw(np.arctan2(ahead[0], ahead[2])))
    reach = vote(lambda c, m: _into(_yaw(foot(c, m)), bone(c, m)))
    toe_turn: Array = rotations.identity().astype(np.float64)
    if toe in stances[0][0].rotations:
        toe_turn = rotations.normalize(vote(under_toe))
    height = vote(lambda c, m: c.ankles[m, side, 1:2])
    return turn, toe_turn, reach - FOOT_OFFSET, float(height[0])


def _flat_stance(clip: SourceMotion, side: int) -> NDArray[np.bool_]:
    height = clip.ankles[:, side, 1]
    still = np.maximum(speed(clip.ankles[:, side]), speed(clip.toes[:, side])) < 0.5 * STANCE_SPEED
    if not still.any():
        return still
    return still & (np.abs(height - np.percentile(height[still], 30)) < 0.012)


def _into(frame: Array, v: Array) -> Array:
    """Transform world vectors into the frame of rotations `(T, 4)`."""
    return rotations.rotate(rotations.inverse(frame), v)


def retarget(
    source: SourceMotion, feet: FootCalibration, height_offset: float | None, flex_toes: bool
) -> tuple[Array, Array]:
    """Return hips `(T, 3)` and local rotations `(T, 31, 4)` of the SPORT skeleton at 60 Hz.

    `height_offset`, metres, lifts it; None puts the feet on y = 0. `flex_toes` bends toes on the ground, for sources with rigid toes.
    """
    world = _world_rotations(source, feet)
    foot = np.stack([world[:, 4], world[:, 9]], axis=1)
    shift = _hip_joint_shift(source, world[:, 0])
    ankles, foot = _ankle_targets(source, feet, foot)
    world[:, [4, 9]] = foot
    toes = ankles + rotations.rotate(foot, FOOT_OFFSET)
    if height_offset is None:
        height_offset = _ground_offset(ankles, toes)
    lift = np.array([0.0, height_offset, 0.0])
    hips = source.hip_centre + lift - rotations.rotate(world[:, 0], HIP_CENTRE)
    local = SPORT_SKELETON.local_rotations(world)
    local = solve_legs(hips, local, ankles + lift + shift, foot)
    if flex_toes:
        flex = np.clip(-_elevation(foot), 0.0, TOE_FLEX_LIMIT)
        near = np.clip((0.09 - (toes[..., 1] + height_offset)) / 0.05, 0.0, 1.0)
        local[:, [5, 10]] = pitched(np.broadcast_to([1.0, 0, 0, 0], foot.shape), -flex * near)
    for joint, part in _HEAD_LIFT_PARTS.items():
        local[:, joint] = pitched(local[:, joint], -part * source.head_lift)
    local = rotations.continuous(rotations.normalize(local))
    return hips.astype(np.float32), local.astype(np.float32)


def _world_rotations(source: SourceMotion, feet: FootCalibration) -> Array:
    """Return our world rotations `(T, 31, 4)`; joints without a source follow their parent."""
    names, parents = SPORT_SKELETON.names, SPORT_SKELETON.parents
    given = dict(source.rotations)
    if "LowerBack" not in given:
        given["LowerBack"] = rotations.slerp(given["Hips"], given["Spine"], 0.5)
    for side, name in enumerate(_SIDES):
        given[name + "Shoulder"] = rotations.slerp(
            given["Spine1"], given[name + "Shoulder"], source.collar_fraction
        )
        given[name + "Foot"] = rotations.multiply(given[name + "Foot"], feet.foot_turn[side])
        if name + "ToeBase" in given:
            given[name + "ToeBase"] = rotations.multiply(given[name + "ToeBase"], feet.toe_turn[side])
    world = np.empty((len(source.hip_centre), len(names), 4))
    for j, name in enumerate(names):
        world[:, j] = given[name] if name in given else world[:, parents[j]]
    _align_trunk(world, source.trunk)
    return world


def _hip_joint_shift(source: SourceMotion, pelvis: Array) -> Array:
    """Return the offset `(T, 2, 3)` of our hip joints from the source's: legs shifted by it keep their joint angles."""
    ours = np.stack([SPORT_SKELETON.offsets[j].astype(np.float64) - HIP_CENTRE for j in (2, 7)])
    ours = rotations.rotate(pelvis[:, None], ours)
    return ours - (source.hip_joints - source.hip_centre[:, None])


def _align_trunk(world: Array, trunk: Array) -> None:
    """Turn LowerBack and Spine so that the base of our neck lies in the direction of the source's, in place.

    With other bone lengths and rest poses the same angles give another lean: 3 degrees off for a straight back, 9 for a
    bent one. The chest keeps its rotation.
    """
    lower, upper = SPORT_SKELETON.index("LowerBack"), SPORT_SKELETON.index("Spine")
    ours = np.zeros_like(trunk)
    for j, o in zip((lower, upper), TRUNK, strict=True):
        ours += rotations.rotate(world[:, j], o)
    turn = rotations.between(rotations.normalize(ours), rotations.normalize(trunk))
    for j in (lower, upper):
        world[:, j] = rotations.multiply(turn, world[:, j])


def _ankle_targets(source: SourceMotion, feet: FootCalibration, foot: Array) -> tuple[Array, Array]:
    """Return ankle positions `(T, 2, 3)` and feet `(T, 2, 4)`: the source's, but pivoting over its toes while they bear weight.

    Our feet have another length. Both rules give the same ankle on a flat foot, so the change between them is continuous:
    heels strike where the source's do, and toes stay planted in the push-off, where the heel rises until the leg is as
    long as the source's. In the swing the ankle is the source's, which keeps knee flexion and ground clearance.
    """
    carries = _toes_carry(source.toes[..., 1])
    elevation = _elevation(foot)
    pivot = source.toes - rotations.rotate(_yaw(foot), feet.toe_offset)
    length = np.linalg.norm(source.ankles - source.hip_joints, axis=-1)
    rise = heel_rise(source.hip_joints, pivot, foot, length)
    weight = carries * np.clip(0.5 - elevation / np.deg2rad(6.0), 0.0, 1.0)
    foot = pitched(foot, weight * rise)
    by_toe = pivot - rotations.rotate(foot, FOOT_OFFSET)
    return source.ankles + weight[..., None] * (by_toe - source.ankles), foot


def _toes_carry(height: Array) -> Array:
    """Return 1 where toes `(T, 2)` are at their lowest height nearby, 0 where they swing."""
    from scipy.ndimage import gaussian_filter1d, minimum_filter1d

    raised = height - minimum_filter1d(height, 2 * round(TOE_REACH_SECONDS * FPS) + 1, axis=0)
    return gaussian_filter1d(smoothstep((TOE_UP_M - raised) / (TOE_UP_M - TOE_DOWN_M)), 1.5, axis=0)


def _ground_offset(ankles: Array, toes: Array) -> float:
    """Return the height offset in metres that puts standing feet on y = 0."""
    clearance = np.minimum(ankles[..., 1] - ANKLE_HEIGHT, toes[..., 1] - TOE_HEIGHT)
    low = clearance < np.percentile(clearance, 60)
    stance = (np.minimum(speed(ankles), speed(toes)) < STANCE_SPEED) & low
    if stance.sum() < 15:  # a dash touches the ground too briefly for a speed threshold
        return float(-np.percentile(clearance, 8))
    return float(-np.median(clearance[stance]))
