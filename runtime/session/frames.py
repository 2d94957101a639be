"""The stored form of a take's frames: quantised, and differenced in time, which compresses to a fifth.

Precision is `HIPS_STEP_M` / 2 = 0.031 mm for hips, 0.005 degrees for local rotations, 1 / 256 for contacts; gaits are exact.
Frames are stored in pieces of `PIECE_FRAMES`, so that versions of a take share the pieces that an edit did not change.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from runtime.arrays import AnyArray
from runtime.skeleton import J

PIECE_FRAMES = 300  # frames: 5 s
HIPS_STEP_M = 1.0 / 16384.0
# of a component: the three smaller ones of a quaternion are below 0.7072
ROTATION_COMPONENT_STEP = 1.0 / (32767.0 * 2.0**0.5)
CONTACT_STEP = 1.0 / 128.0
MIN_CONTACT_PROBABILITY = -0.5
PACKED_FRAME_BYTES = 3 * 4 + J * (1 + 3 * 2) + 4 + 1  # of a packed frame: hips, rotations, contacts, gait
_PLACES = (np.arange(4) - np.arange(4)[:, None]) % 4  # component order by the largest one's index
CLIP_FRAME_BYTES = 4 * (3 + 4 * J + 4) + 1  # of a frame in memory


def pieces(count: int) -> Iterator[slice]:
    for first in range(0, count, PIECE_FRAMES):
        yield slice(first, min(first + PIECE_FRAMES, count))


def packed_frames(hips: AnyArray, rotations: AnyArray, contacts: AnyArray, gaits: AnyArray | None) -> bytes:
    """Return the packed bytes of T frames: hips `(T, 3)`, rotations `(T, 31, 4)`, contacts `(T, 4)`, gaits `(T,)`."""
    places = np.round(np.asarray(hips, np.float64) / HIPS_STEP_M).astype(np.int32)
    largest = np.abs(rotations).argmax(axis=-1)
    ordered = np.take_along_axis(rotations, (largest[..., None] + np.arange(4)) % 4, axis=-1)
    negative = ordered[..., 0] < 0.0
    rest = ordered[..., 1:] * np.where(negative, -1.0, 1.0)[..., None]
    small = np.clip(np.round(rest / ROTATION_COMPONENT_STEP), -32767, 32767).astype(np.int16)
    signs = (largest | (negative << 2)).astype(np.uint8)
    touching = np.round((contacts - MIN_CONTACT_PROBABILITY) / CONTACT_STEP).astype(np.uint8)
    requested = np.zeros(len(hips), np.int8) if gaits is None else gaits.astype(np.int8)
    columns = (
        signs,
        _differences(small.reshape(len(hips), -1)),
        _differences(places),
        touching,
        requested[:, None],
    )
    return b"".join(packed_table(column) for column in columns)


def unpacked_frames(data: bytes, count: int) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    """Return hips, rotations, contacts and gaits from `packed_frames`; ValueError for other bytes."""
    if len(data) != PACKED_FRAME_BYTES * count:
        raise ValueError(f"{len(data)} bytes of {count} frames")
    sizes = np.cumsum([J, J * 3 * 2, 3 * 4, 4]) * count
    parts = [bytes(part) for part in np.split(np.frombuffer(data, np.uint8), sizes)]
    signs = unpacked_table(parts[0], count, np.uint8).reshape(count, J)
    small = _sums(unpacked_table(parts[1], count, np.int16)).reshape(count, J, 3)
    places = _sums(unpacked_table(parts[2], count, np.int32))
    if (signs > 7).any() or (small == -32768).any():
        raise ValueError("invalid rotations")
    a, b, c = np.moveaxis(small * ROTATION_COMPONENT_STEP, -1, 0)
    main = np.sqrt(np.maximum(1.0 - (a * a + b * b + c * c), 0.0))
    ordered = np.stack([main, a, b, c], axis=-1).astype(np.float32)
    rotations = np.take_along_axis(ordered, _PLACES[signs & 3], axis=-1)
    rotations *= np.where(signs & 4, np.float32(-1.0), np.float32(1.0))[..., None]
    hips = (places * HIPS_STEP_M).astype(np.float32)
    contacts = (unpacked_table(parts[3], count, np.uint8) * CONTACT_STEP + MIN_CONTACT_PROBABILITY).astype(
        np.float32
    )
    return hips, rotations, contacts, unpacked_table(parts[4], count, np.int8)[:, 0]


def packed_gaits(data: bytes, count: int) -> AnyArray:
    """Return the gaits `(T,)` from `packed_frames`, which are its last bytes."""
    return np.frombuffer(data, np.int8, count, (PACKED_FRAME_BYTES - 1) * count)


def _differences(values: AnyArray) -> AnyArray:
    """Return second differences along time, small magnitudes first; integer overflow is reversible."""
    for _ in range(2):
        values = np.diff(values, axis=0, prepend=np.zeros_like(values[:1]))
    return (values << 1) ^ (values >> (8 * values.itemsize - 1))


def _sums(values: AnyArray) -> AnyArray:
    """Return the values from their `_differences`."""
    unsigned = values.view(f"u{values.itemsize}")
    values = (unsigned >> 1).view(values.dtype) ^ -(values & 1)
    for _ in range(2):
        values = np.cumsum(values, axis=0, dtype=values.dtype)
    return values


def packed_table(values: AnyArray) -> bytes:
    """Return the bytes of a table `(T, columns)`, grouped by byte significance and column so that they compress well."""
    count, width = values.shape
    apart = np.ascontiguousarray(values.T).view(np.uint8).reshape(width, count, -1)
    return np.ascontiguousarray(apart.transpose(2, 0, 1)).tobytes()


def unpacked_table(data: bytes, count: int, kind: Any) -> AnyArray:
    """Return the table `(T, columns)` from `packed_table`."""
    size = np.dtype(kind).itemsize
    planes = np.frombuffer(data, np.uint8).reshape(size, -1, count)
    return np.ascontiguousarray(planes.transpose(1, 2, 0)).view(kind)[..., 0].T
