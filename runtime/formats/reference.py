"""Retargeting of another skeleton's motion to ours, as a reference: rotations relative to its rest pose, scaled by leg length."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.character.guess import JointGuess, NotUpright, guess_skeleton
from runtime.character.joint_map import joint_map_path, saved_joint_map
from runtime.character.joints import align, canonical_axes
from runtime.character.read import MOTIONS
from runtime.character.tree import JointTree
from runtime.errors import FileError
from runtime.formats.bvh import BvhMotion, read_bvh
from runtime.formats.bvh_clip import OtherSkeleton, clip_of_motion, nearest_unit
from runtime.formats.gltf_motion import read_gltf_motion
from runtime.formats.sidecar import clip_fields
from runtime.pose import MAX_FPS, video_rate
from runtime.safe_read import printable
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON, J
from runtime.takes.clip import MAX_DISTANCE_M, Clip
from runtime.takes.own_skeleton import MAX_POINTS, OwnSkeleton

UPRIGHT_FRACTION = 0.3  # of a body's extent: minimum height of its head above the feet in the rest pose
BELOW_GROUND_FRACTION = 0.05  # of the frames: those whose lowest foot may be below the ground
LEGS = ("LeftUpLeg", "RightUpLeg")
SOLES = ("LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase")


@dataclass(frozen=True)
class ReferenceMotion:
    """A motion retargeted from another skeleton to ours, on flat ground; `scale` is metres per unit of the file."""

    clip: Clip
    own: OwnSkeleton  # as in the file
    joints: int  # of ours that were found
    origin: str  # how they were found
    scale: float

    def describe(self) -> str:
        """Return a phrase for the user: how many joints were found, and how."""
        return f", another skeleton: {self.joints} of {J} joints by {self.origin}, retargeted as a reference"


@dataclass(frozen=True)
class _Rest:
    guess: JointGuess
    world: Array  # (K, 4) rotations of the file's joints
    points: Array  # (N, 3)


@dataclass(frozen=True)
class OpenedTake:
    """A take read from a file, its unit (a key of `UNITS_PER_METRE`), and a note for the user."""

    clip: Clip
    unit: str
    reference: ReferenceMotion | None = None
    note: str = ""  # if it is damaged or has several animations
    animations: tuple[str, ...] = ()  # of the file


def open_take(path: Path, animation: str = "") -> OpenedTake:
    """Read a motion file as a clip, retargeted if it has another skeleton with two legs. Raises FileError.

    Reads BVH, glTF, VRMA or FBX; `animation` chooses one by name, else the first that moves a body.
    """
    motion = read_bvh(path) if is_bvh(path) else read_gltf_motion(path, animation)
    reference = None
    try:
        clip, unit = clip_of_motion(motion, path)
    except OtherSkeleton:
        reference = _reference(motion, path)
        clip, unit = reference.clip, nearest_unit(reference.scale)
    unit = unit if is_bvh(path) else "cm"  # other formats have a unit of their own
    clip = replace(clip, name=printable(animation)) if animation else clip
    return OpenedTake(clip, unit, reference, motion.note, motion.animations)


def is_bvh(path: Path) -> bool:
    """Return whether a file is read as BVH, which is the default for unknown endings."""
    return path.suffix.lower() not in MOTIONS[1:]


def _reference(motion: BvhMotion, path: Path) -> ReferenceMotion:
    """Return a clip with the file's world motion: from the origin on, or on the ground that one of our own files names.

    Joints come from `guess_skeleton` and `FILE.joints.json` next to it. FileError.
    """
    fps = video_rate(motion.fps)
    if not 0.0 < fps <= MAX_FPS:
        raise FileError(f"{path}: {fps:g} frames per second; expected at most {MAX_FPS:.0f}.", "Resample it.")
    positions, world = motion.world()
    rest = _rest(motion, positions, world, path)
    with np.errstate(all="ignore"):  # the results are checked
        hips, local, scale, axes, start = _retarget(rest, motion.skeleton.parents, positions, world)
        if motion.metadata:
            hips, start = hips + start, np.zeros(3)
        own = _own(motion, positions, world, axes, scale, start)
    finite = np.isfinite(local).all() and np.isfinite(own.points).all()
    if not finite or not np.all(np.abs(hips) <= MAX_DISTANCE_M):
        raise FileError(f"{path}: its legs have no length, or it is too far away.", "Choose another file.")
    known = clip_fields(motion.metadata, path, fps, len(hips))
    clip = Clip(printable(path.stem), fps, hips.astype(np.float32), local.astype(np.float32), **known)
    return ReferenceMotion(clip, own, len(rest.guess.found), rest.guess.origin, scale)


def _rest(motion: BvhMotion, positions: Array, world: Array, path: Path) -> _Rest:
    """Return the file's rest pose if it is an upright body, else the first frame, which is one in many files."""
    skeleton, joint_map = motion.skeleton, saved_joint_map(path)
    standing = np.zeros((len(skeleton), 3))
    for k, parent in enumerate(skeleton.parents):
        standing[k] = skeleton.offsets[k] + (standing[parent] if parent >= 0 else 0.0)
    still = rotations.identity((len(skeleton),)).astype(np.float64)
    first = rotations.normalize(world[0].astype(np.float64))
    local = rotations.normalize(skeleton.local_rotations(world.astype(np.float64)))
    turning = rotations.angle_between(local[:1], local).max(axis=0)
    problems = []
    for at, turns in ((standing, still), (positions[0].astype(np.float64), first)):
        ends = [at[k] + rotations.rotate(turns[k], end) for k, end in motion.end_offsets.items()]
        points = np.concatenate([at, np.array(ends).reshape(-1, 3)])
        tree = JointTree(skeleton.parents, at)
        try:
            guess = guess_skeleton(path, skeleton.names, tree, points, joint_map, turning)
        except NotUpright:  # an all-zero rest pose may look so: use the first frame
            problems.append("it stands on four legs")
            continue
        if not guess.missing and _stands(guess.found, at):
            return _Rest(guess, turns, points)
        missing = f"no joints found for {', '.join(guess.missing)}"
        problems.append(missing if guess.missing else "neither rest pose nor first frame is upright")
    raise FileError(
        f"{path}: a motion of another skeleton, and {problems[-1]}: it cannot be retargeted.",
        f"Name its joints in {joint_map_path(path).name} next to it, or export it with a T-pose as rest pose.",
    )


def _stands(found: dict[str, int], at: Array) -> bool:
    """Return whether a pose is upright: head far from the feet, hips between them."""
    up = at[found["Head"]] - at[found["Hips"]]
    down = at[[found["LeftFoot"], found["RightFoot"]]].mean(axis=0) - at[found["Hips"]]
    size = float(np.linalg.norm(np.ptp(at[list(found.values())], axis=0)))
    apart = float(np.linalg.norm(at[found["LeftUpLeg"]] - at[found["RightUpLeg"]]))
    stretched = np.linalg.norm(up - down) > UPRIGHT_FRACTION * size and up @ down < 0.0
    return bool(stretched and apart > 0.01 * size and size > 0.0)


def _retarget(
    rest: _Rest, parents: tuple[int, ...], positions: Array, world: Array
) -> tuple[Array, Array, float, Array, Array]:
    """Return hips `(T, 3)` in metres, local rotations `(T, 31, 4)`, metres per file unit, axes and start of the file.

    The start was subtracted, in our axes, so that the motion begins at the origin on the ground.
    """
    found, at = rest.guess.found, rest.guess.positions
    heading = _heading(found, at)  # a first frame may face anywhere
    matrices = np.tile(np.eye(4), (len(at), 1, 1))
    matrices[:, :3, 3] = rotations.rotate(heading, at)
    points = rotations.rotate(heading, rest.points)
    alignment = align(found, parents, matrices, points)
    scaled = alignment.basis[0]  # of a rest matrix without rotation: scale and axes alone
    scale = float(np.cbrt(np.linalg.det(scaled)))
    axes = rotations.multiply(rotations.from_matrix(scaled / scale), heading)
    upright = _upright(rotations.rotate(axes, positions.astype(np.float64)), found)
    ours: Array = np.empty((len(world), J, 4))
    for j in range(J):
        k = found.get(SPORT_SKELETON.names[j], -1)
        if k < 0:
            ours[:, j] = ours[:, SPORT_SKELETON.parents[j]]
            continue
        turned = rotations.multiply(world[:, k].astype(np.float64), rotations.inverse(rest.world[k]))
        turned = rotations.multiply(rotations.multiply(axes, turned), rotations.inverse(axes))
        turned = rotations.multiply(upright, turned)
        ours[:, j] = rotations.multiply(turned, rotations.inverse(alignment.turns[k]))
    axes = rotations.multiply(upright, axes)
    # the rotation about +Y for which `axes` only changes the up axis: the motion faces as in its file
    up = rotations.rotate(rotations.inverse(axes), np.array([0.0, 1.0, 0.0]))
    plain = rotations.between(np.round(up), np.array([0.0, 1.0, 0.0]))
    back = rotations.multiply(plain, rotations.inverse(axes))
    back = rotations.normalize(back * np.array([1.0, 0.0, 1.0, 0.0]))
    ours = np.asarray(rotations.multiply(back, ours))
    axes = rotations.multiply(back, axes)
    local = rotations.normalize(SPORT_SKELETON.local_rotations(ours))
    legs = positions[:, [found[name] for name in LEGS]].astype(np.float64).mean(axis=1)
    hips, start = _placed(rotations.rotate(axes, legs) * scale, local)
    return hips, local, scale, axes, start


def _own(
    motion: BvhMotion, positions: Array, world: Array, axes: Array, scale: float, start: Array
) -> OwnSkeleton:
    """Return joints and bone ends placed with the clip, on the ground by their own feet."""
    ends = [(k, end) for k, end in motion.end_offsets.items() if np.any(np.asarray(end) != 0.0)]
    parents = (*motion.skeleton.parents, *(k for k, _ in ends))
    tips = [positions[:, k] + rotations.rotate(world[:, k], np.asarray(end)) for k, end in ends]
    points = np.concatenate([positions, *(tip[:, None] for tip in tips)], axis=1).astype(np.float64)
    points = rotations.rotate(axes, points) * scale - start
    if not motion.metadata:
        points[..., 1] -= np.quantile(points[..., 1].min(axis=1), BELOW_GROUND_FRACTION)
    return OwnSkeleton(tuple(parents)[:MAX_POINTS], points[:, :MAX_POINTS].astype(np.float32))


def _heading(found: dict[str, int], at: Array) -> Array:
    """Return the rotation about the body's upright axis that aligns its left with an axis; identity if it already is."""
    axes = canonical_axes(found, at)
    left = axes @ (at[found["LeftUpLeg"]] - at[found["RightUpLeg"]])
    return rotations.from_axis_angle(axes[1], np.arctan2(left[2], left[0]))


def _upright(positions: Array, found: dict[str, int]) -> Array:
    """Return the quarter turn that brings the heads of all frames up; identity unless the up axis differs."""
    up = np.mean(positions[:, found["Head"]] - positions[:, found["Hips"]], axis=0)
    axis = int(np.argmax(np.abs(up)))
    if axis == 1 and up[1] > 0.0:
        return rotations.identity().astype(np.float64)
    toward = np.zeros(3)
    toward[axis] = np.sign(up[axis])
    return rotations.between(toward, np.array([0.0, 1.0, 0.0]))


def _placed(legs: Array, local: Array) -> tuple[Array, Array]:
    """Return hips that place the middle of our legs at theirs, starting at the origin, with the lowest foot on the ground.

    Also returns the subtracted start position.
    """
    at, _ = SPORT_SKELETON.forward_kinematics(np.zeros((len(legs), 3)), local)
    hips = legs - at[:, [SPORT_SKELETON.index(name) for name in LEGS]].mean(axis=1)
    soles = [SPORT_SKELETON.index(name) for name in SOLES]
    above = SPORT_SKELETON.rest_positions[soles, 1] + REST_HIPS_HEIGHT  # of a sole on the ground
    lowest = (hips[:, 1, None] + at[:, soles, 1] - above).min(axis=1)
    start = np.array([hips[0, 0], float(np.quantile(lowest, BELOW_GROUND_FRACTION)), hips[0, 2]])
    return np.asarray(hips - start), start
