"""BVH files: a bounded parser for any hierarchy and channel order, and a pure writer (a clip in, text out)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sport.runtime import rotations
from sport.runtime.errors import FileError
from sport.runtime.skeleton import Skeleton

Array = NDArray[np.floating]

MAX_FILE_BYTES = 512 * 1024 * 1024
MAX_JOINTS = 1024
MAX_FRAMES = 2_000_000
_REMEDY = "Export the clip again as BVH, or choose another file."


@dataclass(frozen=True)
class BvhMotion:
    """A parsed BVH in the file's own unit of length.

    `positions` `(T, J, 3)` are local translations: the joint's OFFSET unless it has position channels.
    `local_rotations` `(T, J, 4)`. `end_offsets` maps a leaf joint to its End Site offset.
    """

    skeleton: Skeleton
    positions: Array
    local_rotations: Array
    frame_seconds: float
    end_offsets: dict[int, Array]

    @property
    def fps(self) -> float:
        """Frames per second."""
        return 1.0 / self.frame_seconds

    def world(self) -> tuple[Array, Array]:
        """World positions `(T, J, 3)` and rotations `(T, J, 4)`, honouring per-joint translations."""
        positions = np.empty_like(self.positions)
        world = np.empty_like(self.local_rotations)
        for j, parent in enumerate(self.skeleton.parents):
            if parent < 0:
                positions[:, j] = self.positions[:, j]
                world[:, j] = self.local_rotations[:, j]
            else:
                world[:, j] = rotations.multiply(world[:, parent], self.local_rotations[:, j])
                positions[:, j] = positions[:, parent] + rotations.rotate(
                    world[:, parent], self.positions[:, j]
                )
        return positions, world


@dataclass
class _Hierarchy:
    names: list[str]
    parents: list[int]
    offsets: list[list[float]]
    channels: list[list[str]]
    end_offsets: dict[int, Array]


def read_bvh(path: str | Path) -> BvhMotion:
    """Parse a BVH file; FileError names the file, the line and what was expected."""
    path = Path(path)
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise FileError(f"{path}: larger than {MAX_FILE_BYTES >> 20} MB.", "Split the clip.")
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}.", "Check the path.") from error
    return parse_bvh(text, str(path))


def parse_bvh(text: str, name: str = "BVH") -> BvhMotion:
    """Parse BVH text; `name` stands in error messages."""
    head, separator, motion = text.partition("MOTION")
    if not separator or not head.lstrip().startswith("HIERARCHY"):
        raise FileError(f"{name}: expected HIERARCHY and MOTION sections.", _REMEDY)
    hierarchy = _parse_hierarchy(head, name)
    frames, frame_seconds = _parse_motion(motion, sum(map(len, hierarchy.channels)), name)
    return _assemble(hierarchy, frames, frame_seconds, name)


def _numbers(tokens: list[str], count: int, line: int, name: str) -> list[float]:
    try:
        values = [float(t) for t in tokens[:count]]
    except ValueError as error:
        raise FileError(f"{name}, line {line}: expected {count} numbers.", _REMEDY) from error
    if len(values) != count or not np.all(np.isfinite(values)):
        raise FileError(f"{name}, line {line}: expected {count} finite numbers.", _REMEDY)
    return values


def _parse_hierarchy(head: str, name: str) -> _Hierarchy:
    result = _Hierarchy([], [], [], [], {})
    stack: list[int] = []
    current, in_end_site = -1, False
    for number, line in enumerate(head.splitlines(), 1):
        tokens = line.split()
        if not tokens or tokens[0] == "HIERARCHY":
            continue
        keyword = tokens[0]
        if keyword in ("ROOT", "JOINT") and len(tokens) >= 2:
            if len(result.names) >= MAX_JOINTS:
                raise FileError(f"{name}: more than {MAX_JOINTS} joints.", _REMEDY)
            result.names.append("_".join(tokens[1:]))
            result.parents.append(stack[-1] if stack else -1)
            result.offsets.append([0.0, 0.0, 0.0])
            result.channels.append([])
            current = len(result.names) - 1
        elif keyword == "End":
            in_end_site = True
        elif keyword == "{":
            stack.append(current)
        elif keyword == "}":
            if not stack:
                raise FileError(f"{name}, line {number}: unexpected '}}'.", _REMEDY)
            stack.pop()
            in_end_site = False
        elif keyword == "OFFSET" and current >= 0:
            offset = _numbers(tokens[1:], 3, number, name)
            if in_end_site:
                result.end_offsets[current] = np.array(offset, np.float32)
            else:
                result.offsets[current] = offset
        elif keyword == "CHANNELS" and current >= 0:
            result.channels[current] = [c.lower() for c in tokens[2:]]
            _check_channels(result.channels[current], tokens, number, name)
        else:
            raise FileError(f"{name}, line {number}: unexpected '{keyword[:40]}'.", _REMEDY)
    if stack or not result.names or sum(p < 0 for p in result.parents) != 1:
        raise FileError(f"{name}: expected one closed hierarchy with one ROOT.", _REMEDY)
    return result


def _check_channels(channels: list[str], tokens: list[str], line: int, name: str) -> None:
    known = {a + kind for a in "xyz" for kind in ("position", "rotation")}
    if not tokens[1].isdigit() or int(tokens[1]) != len(channels) or not set(channels) <= known:
        raise FileError(f"{name}, line {line}: CHANNELS count or names are wrong.", _REMEDY)


def _parse_motion(motion: str, width: int, name: str) -> tuple[Array, float]:
    lines = motion.lstrip().split("\n", 2)
    try:
        count = int(lines[0].split(":")[1])
        frame_seconds = float(lines[1].split(":")[1])
    except (IndexError, ValueError) as error:
        raise FileError(f"{name}: expected 'Frames:' and 'Frame Time:'.", _REMEDY) from error
    if not 0 < count <= MAX_FRAMES or not 1e-4 <= frame_seconds <= 10.0:
        raise FileError(
            f"{name}: {count} frames of {frame_seconds} s; expected 1 to {MAX_FRAMES} frames"
            " of 0.0001 to 10 s.",
            _REMEDY,
        )
    try:
        values = np.array(lines[2].split() if len(lines) > 2 else [], np.float64)
    except ValueError as error:
        raise FileError(f"{name}: a MOTION value is not a number.", _REMEDY) from error
    if values.size != count * width:
        raise FileError(
            f"{name}: {values.size} MOTION values; expected {count} frames x {width} channels.",
            _REMEDY,
        )
    if not np.all(np.isfinite(values)):
        raise FileError(f"{name}: MOTION holds values that are not finite.", _REMEDY)
    return values.reshape(count, width), frame_seconds


def _assemble(h: _Hierarchy, frames: Array, frame_seconds: float, name: str) -> BvhMotion:
    offsets = np.array(h.offsets, np.float32)
    skeleton = Skeleton(tuple(h.names), tuple(h.parents), offsets)
    positions = np.repeat(offsets[None].astype(np.float64), len(frames), axis=0)
    local = np.zeros((len(frames), len(h.names), 4))
    local[..., 0] = 1.0
    column = 0
    for j, channels in enumerate(h.channels):
        values = frames[:, column : column + len(channels)]
        column += len(channels)
        order = "".join(c[0].upper() for c in channels if c.endswith("rotation"))
        for k, channel in enumerate(channels):
            if channel.endswith("position"):
                positions[:, j, "xyz".index(channel[0])] = values[:, k]
        if order:
            angles = values[:, [k for k, c in enumerate(channels) if c.endswith("rotation")]]
            local[:, j] = rotations.from_euler(np.deg2rad(angles), order)
    return BvhMotion(
        skeleton,
        positions.astype(np.float32),
        local.astype(np.float32),
        frame_seconds,
        h.end_offsets,
    )


def format_bvh(
    skeleton: Skeleton,
    hips_positions: Array,
    local_rotations: Array,
    fps: float,
    *,
    units_per_metre: float = 100.0,
    order: str = "ZYX",
    end_offsets: dict[int, Array] | None = None,
) -> str:
    """BVH text of a motion: `hips_positions` `(T, 3)` in metres, `local_rotations` `(T, J, 4)`."""
    lines = ["HIERARCHY"]
    joints: list[int] = []
    _write_joint(skeleton, 0, 0, lines, joints, units_per_metre, order, end_offsets or {})
    local = rotations.continuous(np.asarray(local_rotations, np.float64))[:, joints]
    angles = np.rad2deg(np.unwrap(rotations.to_euler(local, order), axis=0))
    rows = np.concatenate(
        [np.asarray(hips_positions) * units_per_metre, angles.reshape(len(angles), -1)], axis=1
    )
    lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1.0 / fps:.10f}"]
    lines += [" ".join(f"{v:.5f}" for v in row) for row in rows]
    return "\n".join(lines) + "\n"


def _write_joint(
    skeleton: Skeleton,
    j: int,
    depth: int,
    lines: list[str],
    joints: list[int],
    scale: float,
    order: str,
    end_offsets: dict[int, Array],
) -> None:
    pad = "  " * depth
    joints.append(j)
    x, y, z = (float(v) * scale for v in skeleton.offsets[j])
    rotation_channels = " ".join(f"{axis}rotation" for axis in order.upper())
    lines += [f"{pad}{'JOINT' if depth else 'ROOT'} {skeleton.names[j]}", f"{pad}{{"]
    lines += [f"{pad}  OFFSET {x:.5f} {y:.5f} {z:.5f}"]
    position_channels = "" if depth else "Xposition Yposition Zposition "
    lines += [f"{pad}  CHANNELS {3 if depth else 6} {position_channels}{rotation_channels}"]
    for child in skeleton.children[j]:
        _write_joint(skeleton, child, depth + 1, lines, joints, scale, order, end_offsets)
    if not skeleton.children[j]:
        x, y, z = (float(v) * scale for v in end_offsets.get(j, np.zeros(3)))
        lines += [f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {x:.5f} {y:.5f} {z:.5f}"]
        lines += [f"{pad}  }}"]
    lines += [f"{pad}}}"]
