"""A prepared take as BVH, with what is known of it beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.atomic import write_atomic
from runtime.skeleton import SPORT_SKELETON, Skeleton
from runtime.takes.bvh import format_bvh
from runtime.takes.clip import END_OFFSETS, UNITS_PER_METRE
from runtime.takes.options import ExportOptions
from runtime.takes.prepare import PreparedTake
from runtime.takes.sidecar import write_sidecar

ROOT = "Root"


def save_take_bvh(take: PreparedTake, path: Path, options: ExportOptions) -> Path:
    """Write a prepared take as BVH; with a root on the ground the hips have position channels too. FileError."""
    clip, scale = take.clip, UNITS_PER_METRE[options.unit]
    if not options.ground_root:
        text = format_bvh(
            SPORT_SKELETON,
            clip.hips_positions,
            clip.local_rotations,
            clip.fps,
            units_per_metre=scale,
            end_offsets=END_OFFSETS,
        )
    else:
        text = _rooted(take, scale)
    write_atomic(path, text)
    write_sidecar(clip, path, text)
    return path


def _rooted(take: PreparedTake, scale: float) -> str:
    """The text with one more joint, on the ground above the hips."""
    clip, root = take.clip, take.root
    skeleton = Skeleton(
        (ROOT, *SPORT_SKELETON.names),
        (-1, *(parent + 1 for parent in SPORT_SKELETON.parents)),
        np.concatenate([np.zeros((1, 3), np.float32), SPORT_SKELETON.offsets]),
    )
    turn = rotations.from_yaw(root.yaw)
    back = rotations.inverse(turn)
    hips = rotations.rotate(back, clip.hips_positions - root.positions)
    local = np.concatenate([turn[:, None], clip.local_rotations], axis=1)
    local[:, 1] = rotations.multiply(back, clip.local_rotations[:, 0])
    return format_bvh(
        skeleton,
        root.positions,
        local,
        clip.fps,
        units_per_metre=scale,
        end_offsets={joint + 1: offset for joint, offset in END_OFFSETS.items()},
        moving={1: hips},
    )
