"""Clips of a gliding figure in the format of the importer, for tests of training."""

from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.controls import Gait
from runtime.motion import features
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON, J
from training.data.clips import Patches, TrainingClip

SPEED_M_PER_S = 1.2
LENGTH_FRAMES = 260


def write_clip(path: Path, style: str, yaw: float, slope: float = 0.0, held_out: bool = False) -> None:
    """Write a clip of a figure with swinging legs that glides straight ahead on a plane with `slope` along +Z."""
    t = np.arange(LENGTH_FRAMES) / features.FPS
    local = np.tile(rotations.identity((J,)), (LENGTH_FRAMES, 1, 1)).astype(np.float64)
    swing = 0.5 * np.sin(2 * np.pi * t)
    for name, sign in (("LeftUpLeg", 1.0), ("RightUpLeg", -1.0)):
        local[:, SPORT_SKELETON.index(name)] = rotations.from_axis_angle(np.array([1.0, 0, 0]), sign * swing)
    local[:, 0] = rotations.from_yaw(np.full(LENGTH_FRAMES, yaw))
    forward = np.array([np.sin(yaw), np.cos(yaw)])
    hips = np.stack([SPEED_M_PER_S * t * forward[0], np.full(LENGTH_FRAMES, REST_HIPS_HEIGHT), SPEED_M_PER_S * t * forward[1]], -1)  # fmt: skip
    hips[:, 1] += slope * hips[:, 2]
    grid = np.arange(-20, 21, dtype=np.float32)
    gait = np.zeros((LENGTH_FRAMES, 6), np.float32)
    gait[:, 1] = 1.0
    np.savez(
        path, hips_positions=hips.astype(np.float32), local_rotations=local.astype(np.float32),
        contacts=np.ones((LENGTH_FRAMES, 4), np.uint8), gait=gait, style=style, content="walk", source="jlpm",
        split="held_out" if held_out else "train", mirrored=False, tier="exact",
        patch_heights=np.broadcast_to(slope * grid, (1, 41, 41)).astype(np.float16),
        patch_origin=np.array([-20.0, -20.0]), patch_cell=1.0,
    )  # fmt: skip


def flat_patch(positions: np.ndarray) -> Patches:
    """Return level ground under joint positions `(T, J, 3)`, a grid of 2 x 2."""
    places = positions[..., [0, 2]].reshape(-1, 2)
    low, high = places.min(0) - 1.5, places.max(0) + 1.5
    return Patches(np.zeros((1, 2, 2)), (float(low[0]), float(low[1])), float((high - low).max()))


def save_motion(
    folder: Path, name: str, motion: tuple[Array, Array, Array], gait: Gait = Gait.WALK, **changes: object
) -> None:
    """Write a clip of hips, local rotations and contacts on level ground, by default a neutral training walk."""
    values = {"style": "neutral", "content": "walk", "source": "100style", "split": "train", "tier": "exact"}
    flat = Patches(np.zeros((1, 3, 3), np.float16), (-200.0, -200.0), 200.0)
    labels = np.eye(6)[np.full(len(motion[0]), gait)]
    TrainingClip(name, *motion, labels, **{"patches": flat, **values, **changes}).save(folder)  # type: ignore[arg-type]
