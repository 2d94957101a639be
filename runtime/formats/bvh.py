"""BVH files: a bounded parser for any hierarchy and channel order, and a pure writer (a clip in, text out)."""

import itertools
import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.errors import FileError, UsageError
from runtime.safe_read import decode_text, read_bounded
from runtime.skeleton import Skeleton

MAX_FILE_BYTES = 512 * 1024 * 1024
MAX_HEAD_BYTES = 4 * 1024 * 1024
MAX_JOINTS = 1024
MAX_FRAMES = 2_000_000
MAX_JOINT_FRAMES = 14_000_000  # of 28 bytes each: an hour of 31 joints at 120 Hz
MAX_VALUE = 1e9  # of a length in the file's unit, or an angle in degrees
NO_OFFSETS: dict[int, Array] = {}
MOVING_ORDER, JOINT_ORDER = "YXZ", "ZYX"  # heading first where a joint may face anywhere
_CHUNK_BYTES = 1 << 20  # bytes of numbers parsed at once
_WRITTEN_FRAMES = 4096  # frames formatted at once
_BRACES = re.compile(r"((?<!\S)[{}](?!\S)|[{}](?=[\s{}]*$))")  # standing alone, or at the end of a line
_MOTION = re.compile(rb"(?i)(?<![^\s}])MOTION(?!\S)")
# frame time, as a number or a fraction
_FRAMES = re.compile(
    rb"(?i)\s*Frames\s*:\s*(-?\d+)\s+Frame\s*Time\s*:\s*([\d.,eE+-]+)(?:\s*/\s*([\d.,]+))?[ \t]*(?=\s|$)"
)
_CHANNELS = frozenset(axis + kind for axis in "xyz" for kind in ("position", "rotation"))
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
    note: str = ""  # how it was read, for the user
    metadata: Any = None  # the take's metadata within the file, unparsed
    animations: tuple[str, ...] = ()  # names, if the file has several

    @property
    def fps(self) -> float:
        """Frames per second."""
        return 1.0 / self.frame_seconds

    def world(self) -> tuple[Array, Array]:
        """Return world positions `(T, J, 3)` and rotations `(T, J, 4)`, honouring per-joint translations."""
        positions, world = self.positions.copy(), self.local_rotations.copy()
        for j, parent in enumerate(self.skeleton.parents):
            if parent >= 0:
                positions[:, j] = positions[:, parent] + rotations.rotate(world[:, parent], positions[:, j])
                world[:, j] = rotations.multiply(world[:, parent], world[:, j])
        return positions, world


def read_bvh(path: str | Path) -> BvhMotion:
    """Parse a BVH file; FileError names the file, the line and what was expected."""
    return parse_bvh(read_bounded(path, MAX_FILE_BYTES, "Split the clip."), str(path))


def parse_bvh(data: bytes | str, name: str = "BVH") -> BvhMotion:
    """Parse BVH text, as bytes in UTF-8 or Latin-1; `name` is used in error messages."""
    data = data.encode("utf-8", "replace") if isinstance(data, str) else data
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = decode_text(data).encode("utf-8", "replace")
    if b"\r" in data[:MAX_HEAD_BYTES]:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    motion = _MOTION.search(data)
    head = decode_text(data[: motion.start()]) if motion else ""
    if motion is None or not head.lstrip().upper().startswith("HIERARCHY"):
        raise FileError(f"{name}: expected HIERARCHY and MOTION sections.", _REMEDY)
    if motion.start() > MAX_HEAD_BYTES:
        raise FileError(f"{name}: HIERARCHY is larger than {MAX_HEAD_BYTES >> 20} MB.", _REMEDY)
    return _read_motion(_Hierarchy(head, name), data, motion.end(), name)


def check_size(joints: int, frames: int, name: str) -> None:
    """Raise UsageError if a clip of this size is too large for `read_bvh`."""
    if frames > MAX_FRAMES or joints * frames > MAX_JOINT_FRAMES:
        most = min(MAX_FRAMES, MAX_JOINT_FRAMES // joints)
        problem = f"{name}: {frames} frames of {joints} joints; a BVH may have {most}."
        raise UsageError(problem, "Choose fewer seconds or fewer frames per second.")


class _Hierarchy:
    """The joints of a HIERARCHY section, read line by line; FileError names the line."""

    def __init__(self, head: str, name: str) -> None:
        self.names: list[str] = []
        self.parents: list[int] = []
        self.offsets: list[list[float]] = []
        self.channels: list[list[str]] = []
        self.end_offsets: dict[int, Array] = {}
        self._name, self._stack, self._in_end_site = name, list[int](), False
        keywords = {
            "ROOT": self._joint, "JOINT": self._joint, "END": self._end, "{": self._open, "}": self._close,
            "OFFSET": self._offset, "CHANNELS": self._channels, "HIERARCHY": lambda tokens: 1,
        }  # fmt: skip
        for self._line, line in enumerate(head.split("\n"), 1):
            for part in _BRACES.split(line):
                tokens = part.split()
                while tokens:
                    read = keywords.get(tokens[0].upper())
                    used = read(tokens) if read else 0
                    if not used:
                        raise self._error(f"unexpected '{tokens[0][:40]}'")
                    tokens = tokens[used:]
        if self._stack or not self.names or sum(p < 0 for p in self.parents) != 1:
            raise FileError(f"{name}: expected one closed hierarchy with one ROOT.", _REMEDY)

    def _error(self, problem: str) -> FileError:
        return FileError(f"{self._name}, line {self._line}: {problem}.", _REMEDY)

    # per keyword: its handler with the line's tokens, and their number; 0 if it varies
    def _joint(self, tokens: list[str]) -> int:
        if len(self.names) >= MAX_JOINTS:
            raise FileError(f"{self._name}: more than {MAX_JOINTS} joints.", _REMEDY)
        self.names.append("_".join(tokens[1:]))
        self.parents.append(self._stack[-1] if self._stack else -1)
        self.offsets.append([0.0, 0.0, 0.0])
        self.channels.append([])
        return len(tokens) if len(tokens) > 1 else 0

    def _end(self, tokens: list[str]) -> int:
        self._in_end_site = True
        return len(tokens)

    def _open(self, tokens: list[str]) -> int:
        self._stack.append(len(self.names) - 1)
        return 1

    def _close(self, tokens: list[str]) -> int:
        self._in_end_site = False
        return int(bool(self._stack) and self._stack.pop() is not None)

    def _offset(self, tokens: list[str]) -> int:
        if not self.names:
            return 0
        try:
            offset = [float(token.replace(",", ".")) for token in tokens[1:4]]
        except ValueError as error:
            raise self._error("expected 3 numbers") from error
        if len(offset) != 3 or not all(abs(value) <= MAX_VALUE for value in offset):
            raise self._error(f"expected 3 finite numbers within {MAX_VALUE:.0e}")
        if self._in_end_site:
            self.end_offsets[len(self.names) - 1] = np.array(offset, np.float32)
        else:
            self.offsets[-1] = offset
        return 4

    def _channels(self, tokens: list[str]) -> int:
        if not self.names:
            return 0
        channels = [*itertools.takewhile(_CHANNELS.__contains__, map(str.lower, tokens[2:]))]
        if tokens[1:2] != [str(len(channels))]:
            raise self._error("CHANNELS count or names are wrong")
        if len(set(channels)) != len(channels):
            raise self._error("a channel occurs twice in CHANNELS")
        self.channels[-1] = channels
        return 2 + len(channels)


def _read_motion(h: _Hierarchy, data: bytes, at: int, name: str) -> BvhMotion:
    """Parse the motion whose section begins at `at` in blocks of frames, so that its text is not held twice."""
    count, frame_seconds, at = _parse_frames(data, at, name)
    width = sum(map(len, h.channels))
    if width == 0:
        raise FileError(f"{name}: no joint has channels.", _REMEDY)
    # a value takes at least a digit and a space
    rows = max(min(count, (len(data) - at + 1) // 2 // width), 1)
    motion, found = _read_rows(h, data, at, name, rows, frame_seconds)
    if found == count * width:
        return motion
    rest = _uneven_end(data, at, width, name)
    rows = found // width
    if rows == 0:
        raise FileError(f"{name}: too few MOTION values for a frame of {width} channels.", _REMEDY)
    if rows != len(motion.positions):
        motion, _ = _read_rows(h, data, at, name, rows, frame_seconds)
    cut = " and a partial one, which is ignored" if rest else ""
    return replace(motion, note=f"{name}: the file says {str(count)[:20]} frames and has {rows}{cut}.")


def _read_rows(
    h: _Hierarchy, data: bytes, at: int, name: str, rows: int, frame_seconds: float
) -> tuple[BvhMotion, int]:
    """Parse `rows` frames; also return the total number of values. FileError if there are too many."""
    if rows > MAX_FRAMES or rows * len(h.names) > MAX_JOINT_FRAMES:
        problem = f"{rows} frames x {len(h.names)} joints; expected at most {MAX_JOINT_FRAMES}"
        raise FileError(f"{name}: {problem}.", "Split the clip.")
    width = sum(map(len, h.channels))
    skeleton = Skeleton(tuple(h.names), tuple(h.parents), np.array(h.offsets, np.float32))
    places, turns = (np.empty((rows, len(skeleton), n), np.float32) for n in (3, 4))
    motion = BvhMotion(skeleton, places, turns, frame_seconds, h.end_offsets)
    found, filled = 0, 0
    rest: NDArray[np.float64] = np.zeros(0)
    for block in _number_blocks(data, at, name):
        found += len(block)
        values = np.concatenate([rest, block])
        frames = values[: min(len(values) // width, rows - filled) * width].reshape(-1, width)
        _fill(motion, h.channels, frames, filled)
        filled += len(frames)
        rest = values[len(frames) * width :] if filled < rows else np.zeros(0)
    return motion, found


def _uneven_end(data: bytes, at: int, width: int, name: str) -> bool:
    """Return whether the last line is part of a frame; FileError names any other line without `width` values."""
    lines = [(k, len(text.split())) for k, text in enumerate(data[at:].splitlines())]
    uneven = [(k, values) for k, values in lines if values not in (0, width)]
    last = max((k for k, values in lines if values), default=0)
    if uneven and (uneven[0][0] != last or uneven[0][1] > width):
        line = _line_of(data, at) + uneven[0][0]
        raise FileError(f"{name}, line {line}: {uneven[0][1]} values; expected {width} channels.", _REMEDY)
    return bool(uneven)


def _line_of(data: bytes, at: int) -> int:
    """Return the line number of an offset in the file."""
    return data.count(b"\n", 0, at) + 1


def _parse_frames(data: bytes, at: int, name: str) -> tuple[int, float, int]:
    """Return the number of frames, the frame time, and the offset of their values."""
    head = _FRAMES.match(data[at : at + 1000])
    try:
        if head is None:
            raise ValueError("no such lines")
        seconds, parts = (float(part.replace(b",", b".")) for part in (head[2], head[3] or b"1"))
        frame_seconds = seconds / parts
    except (ValueError, ZeroDivisionError) as error:
        raise FileError(
            f"{name}, line {_line_of(data, at)}: after MOTION expected a line 'Frames: 120' and a line 'Frame Time: 0.0333'.",
            _REMEDY,
        ) from error
    if not 1e-4 <= frame_seconds <= 10.0:
        raise FileError(f"{name}: a frame of {frame_seconds} s; expected 0.0001 to 10 s.", _REMEDY)
    if not data[at + head.end() :].strip():
        raise FileError(f"{name}: it has no frames.", _REMEDY)
    return int(head[1]), frame_seconds, at + head.end()


def _number_blocks(data: bytes, at: int, name: str) -> Iterator[NDArray[np.float64]]:
    """Yield the numbers from `at` on in blocks of some MB; FileError names the line of an invalid, infinite or too large one."""
    while at < len(data):
        end = min(at + _CHUNK_BYTES, len(data))
        if end < len(data):
            cuts = [data.rfind(space, at, end) for space in (b" ", b"\n", b"\t", b"\r")]
            end = max(cuts) if max(cuts) > at else len(data)
        try:
            values = np.array(data[at:end].replace(b",", b".").split(), np.float64)
            usable = bool(np.all(np.abs(values) <= MAX_VALUE))
        except ValueError:
            usable = False
        if not usable:
            raise _unreadable(data, at, end, name)
        yield values
        at = end


def _unreadable(data: bytes, at: int, end: int, name: str) -> FileError:
    """Return the error that names the first invalid value of a block."""
    for match in re.finditer(rb"\S+", data[at:end]):
        try:
            if not abs(float(match[0].replace(b",", b"."))) <= MAX_VALUE:
                break
        except ValueError:
            break
    line, text = _line_of(data, at + match.start()), match[0][:40].decode("utf-8", "replace")
    return FileError(
        f"{name}, line {line}: '{text}' in MOTION; expected finite numbers within {MAX_VALUE:.0e}.", _REMEDY
    )


def _fill(motion: BvhMotion, channels: list[list[str]], frames: Array, first: int) -> None:
    """Write the channel values `(F, channels)` of frames `first` on into the motion's arrays."""
    rows = slice(first, first + len(frames))
    motion.positions[rows] = motion.skeleton.offsets
    motion.local_rotations[rows] = (1.0, 0.0, 0.0, 0.0)
    column = 0
    for j, names in enumerate(channels):
        values = frames[:, column : column + len(names)]
        column += len(names)
        for k, channel in enumerate(names):
            if channel.endswith("position"):
                motion.positions[rows, j, "xyz".index(channel[0])] = values[:, k]
        turning = [k for k, c in enumerate(names) if c.endswith("rotation")]
        if turning:
            order = "".join(names[k][0] for k in turning)
            motion.local_rotations[rows, j] = rotations.from_euler(np.deg2rad(values[:, turning]), order)


def format_bvh(
    skeleton: Skeleton,
    places: Mapping[int, Array],
    local_rotations: Array,
    fps: float,
    *,
    units_per_metre: float = 100.0,
    order: str | None = None,
    end_offsets: dict[int, Array] = NO_OFFSETS,
) -> str:
    """Write a motion as BVH text: `local_rotations` `(T, J, 4)`, and `places` of the joints that have position channels.

    `places` maps a joint to its positions `(T, 3)` relative to its parent, in metres. `order` is the rotation order of all
    joints; None uses `MOVING_ORDER` for joints with positions, which may have any heading, and `JOINT_ORDER` for others.
    """
    orders = [order or (MOVING_ORDER if j in places else JOINT_ORDER) for j in range(len(skeleton))]
    lines, joints = _hierarchy(skeleton, units_per_metre, orders, end_offsets, places)
    lines += ["MOTION", f"Frames: {len(local_rotations)}", f"Frame Time: {1.0 / fps:.10f}", ""]
    before: Array = np.zeros((0, len(joints), 3))  # angles that the next block continues
    blocks = ["\n".join(lines)]
    for first in range(0, len(local_rotations), _WRITTEN_FRAMES):
        rows = slice(first, first + _WRITTEN_FRAMES)
        local: Array = np.asarray(local_rotations[rows], np.float64)
        angles: Array = np.stack([rotations.to_euler(local[:, j], orders[j]) for j in joints], axis=1)
        angles = rotations.continuous_euler(np.concatenate([before, angles]))
        angles, before = angles[-len(local) :], angles[-1:]
        columns: list[Array] = []
        for k, j in enumerate(joints):  # position channels, if any, then angles
            columns += [places[j][rows] * units_per_metre] if j in places else []
            columns.append(np.rad2deg(angles[:, k]))
        for row in np.concatenate(columns, axis=1).tolist():
            blocks.append(" ".join(f"{v:.5f}" for v in row) + "\n")
    return "".join(blocks)


def _hierarchy(
    skeleton: Skeleton, scale: float, orders: list[str], end_offsets: dict[int, Array], moving: Container[int]
) -> tuple[list[str], list[int]]:
    """Return the lines of the hierarchy, and the joints in order."""
    lines, joints = ["HIERARCHY"], []

    def offset(values: Array, pad: str) -> str:
        return f"{pad}  OFFSET " + " ".join(f"{float(v) * scale:.5f}" for v in values)

    def joint(j: int, pad: str) -> None:
        joints.append(j)
        turning = " ".join(f"{axis}rotation" for axis in orders[j].upper())
        channels = f"6 Xposition Yposition Zposition {turning}" if j in moving else f"3 {turning}"
        lines.extend((f"{pad}{'JOINT' if pad else 'ROOT'} {skeleton.names[j]}", f"{pad}{{"))
        lines.extend((offset(skeleton.offsets[j], pad), f"{pad}  CHANNELS {channels}"))
        for child in skeleton.children[j]:
            joint(child, pad + "  ")
        if not skeleton.children[j]:
            end = offset(end_offsets.get(j, np.zeros(3)), pad + "  ")
            lines.extend((f"{pad}  End Site", f"{pad}  {{", end, f"{pad}  }}"))
        lines.append(f"{pad}}}")

    joint(0, "")
    return lines, joints
