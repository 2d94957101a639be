"""A take as BVH of the 31-joint skeleton: written with metadata in JSON next to it, and read back."""

import math
from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.atomic import write_atomic, write_new, write_together
from runtime.errors import FileError
from runtime.formats.bvh import BvhMotion, check_size, format_bvh, read_bvh
from runtime.formats.engines import ENGINES
from runtime.formats.options import UNITS_PER_METRE, ExportOptions
from runtime.formats.prepare import Check, PreparedTake
from runtime.formats.sidecar import clip_fields, format_metadata, read_sidecar, sidecar_path
from runtime.pose import MAX_FPS, video_rate
from runtime.safe_read import printable
from runtime.skeleton import SPORT_SKELETON, J, Skeleton
from runtime.takes.clip import MAX_DISTANCE_M, Clip
from runtime.takes.root import RootTrack

ROOT = "Root"
MAX_OFF_PLACE_M = 0.01  # tolerance of a rest joint's position, within which it is our skeleton
_OWN_BVH = "Open a BVH that this program has written."
# ends of leaf bones, metres, by which readers draw and measure them
_ENDS_M = {
    "LeftToeBase": (0.0, 0.0, 0.06), "LeftHandIndex1": (0.04, 0.0, 0.0), "LThumb": (0.03, 0.0, 0.03),
    "RightToeBase": (0.0, 0.0, 0.06), "RightHandIndex1": (-0.04, 0.0, 0.0), "RThumb": (-0.03, 0.0, 0.03),
    "Head": (0.0, 0.18, 0.02),
}  # fmt: skip
END_OFFSETS = {SPORT_SKELETON.index(name): np.array(end, np.float32) for name, end in _ENDS_M.items()}


class OtherSkeleton(FileError):
    """Raised if a BVH is valid but does not have the SPORT skeleton."""


def check_bvh_length(seconds: float, fps: float) -> None:
    """Raise UsageError if a clip of `seconds` at `fps` is too long for `load_clip_bvh`."""
    frames = min(seconds * fps, 1e12)  # infinite lengths are refused when a clip is made
    check_size(J, math.ceil(frames) if frames >= 0.0 else 0, f"{seconds:g} s at {fps:g} frames per second")


def save_bvh(
    clip: Clip,
    path: str | Path,
    fps: float = 60.0,
    unit: str = "cm",
    order: str | None = None,
    new: bool = False,
) -> Path:
    """Write a BVH and its `sidecar_path`, completely or not at all, and return the BVH's path.

    With `new`, no file is replaced: a taken name becomes name-2, name-3, …. `fps` resamples the clip, `unit` is "cm" or
    "m", `order` is one of `ROTATION_ORDERS` for all joints, or None as in `format_bvh`. Raises UsageError, FileError.
    """
    ExportOptions(fps=fps, unit=unit, euler_order=order).check()
    check_bvh_length(clip.seconds, fps)
    at_rate = clip.resampled(fps)
    return _write(at_rate, Path(path), _text(at_rate, unit, order), new)


def save_take_bvh(
    take: PreparedTake, path: Path, options: ExportOptions, terrain: object, check: Check
) -> None:
    """Write a prepared take as BVH; with a ground root the hips also get position channels. Raises FileError."""
    root = take.root if options.ground_root else None
    text = _text(take.clip, options.unit, options.euler_order, root)
    check()
    _write(take.clip, path, text)


def _write(clip: Clip, path: Path, text: str, new: bool = False) -> Path:
    if not new:
        write_together({path: text, sidecar_path(path): format_metadata(clip, text)})
        return path
    path = write_new(path, text)
    try:
        write_atomic(sidecar_path(path), format_metadata(clip, text))
    except FileError:
        path.unlink(missing_ok=True)
        raise
    return path


def _text(clip: Clip, unit: str, order: str | None, root: RootTrack | None = None) -> str:
    """Return the BVH text; `root` adds a joint on the ground above the hips."""
    skeleton, local, above = SPORT_SKELETON, clip.local_rotations, 0
    places = {0: clip.hips_positions}
    if root is not None:
        skeleton = Skeleton(
            (ROOT, *SPORT_SKELETON.names),
            (-1, *(parent + 1 for parent in SPORT_SKELETON.parents)),
            np.concatenate([np.zeros((1, 3), np.float32), SPORT_SKELETON.offsets]),
        )
        turn = rotations.from_yaw(root.yaw)
        back = rotations.inverse(turn)
        local = np.concatenate([turn[:, None], clip.local_rotations], axis=1)
        local[:, 1] = rotations.multiply(back, clip.local_rotations[:, 0])
        above = 1
        places = {0: root.positions, 1: rotations.rotate(back, clip.hips_positions - root.positions)}
    ends = {joint + above: offset for joint, offset in END_OFFSETS.items()}
    scale = UNITS_PER_METRE[unit] * clip.size
    return format_bvh(skeleton, places, local, clip.fps, units_per_metre=scale, order=order, end_offsets=ends)


def load_clip_bvh(path: str | Path) -> Clip:
    """Read a BVH of the SPORT skeleton as a clip; see `clip_of_motion`. Raises FileError."""
    path = Path(path)
    return clip_of_motion(read_bvh(path), path)[0]


def clip_of_motion(motion: BvhMotion, path: Path) -> tuple[Clip, str]:
    """Convert a motion of the SPORT skeleton, in any unit and order, to a clip; also return its unit (key of `UNITS_PER_METRE`).

    Raises FileError for missing joints, a different rest pose or an invalid rate. Contacts, prompts and origin come
    from the file itself or the JSON next to it; otherwise contacts are zero.
    """
    fps = video_rate(motion.fps)
    if not 0.0 < fps <= MAX_FPS:
        raise FileError(f"{path}: {fps:g} frames per second; expected at most {MAX_FPS:.0f}.", _OWN_BVH)
    order = _joint_order(motion, path)
    scale = _metres_per_unit(motion, order, path)  # of the body, whatever its size
    hips, local = _in_world(motion, order, path)
    hips = hips * scale
    if not np.abs(hips).max() <= MAX_DISTANCE_M:
        raise FileError(f"{path}: the hips are further than {MAX_DISTANCE_M / 1000:.0f} km away.", _OWN_BVH)
    known = clip_fields(motion.metadata or read_sidecar(path), path, fps, len(hips))
    clip = Clip(printable(path.stem), fps, hips.astype(np.float32), local, **known)
    return clip, nearest_unit(scale)


def nearest_unit(metres_per_unit: float) -> str:
    """Return the key of `UNITS_PER_METRE` closest to a file's unit."""
    return min(UNITS_PER_METRE, key=lambda unit: abs(math.log(metres_per_unit * UNITS_PER_METRE[unit])))


def _joint_order(motion: BvhMotion, path: Path) -> list[int]:
    """Return the index in the file of each joint of the SPORT skeleton; FileError names missing joints."""
    for bones in [{}, *(engine.bones for engine in ENGINES.values())]:  # our own files for an engine
        ours = {bone: name for name, bone in bones.items()}
        names = [ours.get(name, name) for name in motion.skeleton.names]
        if set(SPORT_SKELETON.names).issubset(names):
            return [names.index(name) for name in SPORT_SKELETON.names]
    missing = [name for name in SPORT_SKELETON.names if name not in motion.skeleton.names]
    more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
    raise OtherSkeleton(f"{path}: joint {', '.join(missing[:4])}{more} is missing.", _OWN_BVH)


def _in_world(motion: BvhMotion, order: list[int], path: Path) -> tuple[Array, Array]:
    """Return hips `(T, 3)` in the file's unit and local rotations `(T, 31, 4)`, with the transform of a root joint applied."""
    hips, local = motion.positions[:, order[0]], motion.local_rotations
    if order != list(range(len(motion.skeleton))):
        local = local[:, order]
    above = motion.skeleton.parents[order[0]]
    if above < 0:
        return hips, local
    if motion.skeleton.parents[above] >= 0:
        raise OtherSkeleton(f"{path}: expected the joint Hips as ROOT, or one joint above it.", _OWN_BVH)
    turn = motion.local_rotations[:, above]
    hips = motion.positions[:, above] + rotations.rotate(turn, hips)
    local[:, 0] = rotations.multiply(turn, local[:, 0])
    return hips, local


def _metres_per_unit(motion: BvhMotion, order: list[int], path: Path) -> float:
    """Return the scale of a file whose rest pose differs from the SPORT skeleton's in its unit only."""
    for name, j, ours in zip(SPORT_SKELETON.names, order, SPORT_SKELETON.parents, strict=True):
        if ours >= 0 and motion.skeleton.parents[j] != order[ours]:
            problem = f"{path}: joint {name} is not a child of {SPORT_SKELETON.names[ours]}."
            raise OtherSkeleton(problem, _OWN_BVH)
    theirs = motion.skeleton.offsets[order].astype(np.float64)
    wanted = SPORT_SKELETON.offsets.astype(np.float64)
    theirs[0] = wanted[0] = 0.0
    total = float(np.sum(theirs * theirs))
    scale = float(np.sum(theirs * wanted)) / total if total > 0.0 else 0.0
    difference = np.linalg.norm(theirs * scale - wanted, axis=-1)
    worst = int(np.argmax(difference))
    if scale <= 0.0 or difference[worst] > MAX_OFF_PLACE_M:
        joint, away_cm = SPORT_SKELETON.names[worst], 100.0 * difference[worst]
        problem = f"{path}: joint {joint} rests {away_cm:.0f} cm from its place in the SPORT skeleton."
        raise OtherSkeleton(problem, _OWN_BVH)
    for unit in UNITS_PER_METRE.values():  # the file rounds offsets, but not the unit
        if abs(scale * unit - 1.0) < 1e-3:
            return 1.0 / unit
    return scale
