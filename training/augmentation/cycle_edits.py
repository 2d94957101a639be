"""Edits of what a body does within a gait cycle: bounce, hips, shoulders, and how feet land. Steps stay where they are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.easing import smoothstep
from runtime.skeleton import SPORT_SKELETON
from training.augmentation.catalogue import PartEdit
from training.augmentation.cycle import (
    Axes,
    away_from_mean,
    axes,
    cycle_frames,
    cycle_mean,
    right_landings,
)
from training.augmentation.pose_edits import SPINE_ONLY, EditedMotion, lean_shares, turn_joints, turns
from training.augmentation.root_edits import down, feet_of, with_feet
from training.augmentation.steps import height_in_swing, left_landings, swings
from training.frames import smooth

_UP = np.array([0.0, 1.0, 0.0])
_LEFT_ARM, _RIGHT_ARM = SPORT_SKELETON.index("LeftArm"), SPORT_SKELETON.index("RightArm")
_SPINE = 0.23  # m from the hips to the chest
_CHEST_STAYS = 0.6  # of what the hips sway more: the chest stays behind, level
_HARD = 6.0  # frames from a landing to the deepest of a knee that gives


def _scale(edit: PartEdit, name: str, random: np.random.Generator) -> float:
    value = float(edit.parameters.get(name, 1.0))
    return value if value == 1.0 else value * float(np.exp(0.05 * random.normal()))


def bob(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """`scale`: times the rise and fall of the hips. Their highest stays where it is, or sinks: legs grow no longer."""
    return _bobbing(motion, _scale(edit, "scale", random))


def _bobbing(motion: EditedMotion, scale: float) -> EditedMotion:
    hips = motion.hips.astype(np.float64)
    frames = cycle_frames(motion.contacts)
    away = (hips - cycle_mean(hips, frames))[:, 1]
    top = cycle_mean(np.maximum(away, 0.0)[:, None], frames)[:, 0] * 2.0
    ankles, _, feet = feet_of(motion)
    return with_feet(
        motion, hips + ((scale - 1.0) * away - abs(scale - 1.0) * top)[:, None] * _UP, ankles, feet
    )


def hips(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """`sideways`: times the sway of the pelvis to either side; `roll` and `yaw`: times its turns about a cycle's mean."""
    ahead = axes(motion)
    frames = cycle_frames(motion.contacts)
    ankles, _, _ = feet_of(motion)
    own = motion.hips - cycle_mean(motion.hips.astype(np.float64), frames)
    sideways = np.sum(own * ahead.left, axis=1)[:, None] * ahead.left
    moved_by = (_scale(edit, "sideways", random) - 1.0) * sideways
    moved = replace(motion, hips=motion.hips + moved_by)
    back = np.degrees(np.arctan2(-_CHEST_STAYS * np.sum(moved_by * ahead.left, axis=1), _SPINE))
    moved = turn_joints(moved, turns(moved, 0.0, 0.0, back), {11: 1.0, 12: 1.0})
    turn = away_from_mean(motion.local[:, 0].astype(np.float64), ahead.yaw, frames)
    more = turn * np.array([0.0, _scale(edit, "yaw", random) - 1.0, _scale(edit, "roll", random) - 1.0])
    return turn_joints(moved, _world(ahead, more), {0: 1.0}, ankles)


def shoulders(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """`yaw`: times the turning of the shoulders about a cycle's mean; `roll`: degrees that they rise and fall in turn."""
    ahead = axes(motion)
    positions, _ = SPORT_SKELETON.forward_kinematics(motion.hips, motion.local.astype(np.float64))
    across = positions[:, _LEFT_ARM] - positions[:, _RIGHT_ARM]
    yaw = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))[:, None]
    turn = yaw - cycle_mean(yaw, cycle_frames(motion.contacts))
    more = turn * np.array([0.0, _scale(edit, "yaw", random) - 1.0, 0.0])
    shares = lean_shares(SPINE_ONLY, 1.0, 0.1)
    moved = turn_joints(motion, _world(ahead, more), shares)
    roll = float(edit.parameters.get("roll", 0.0)) * random.normal(1.0, 0.06)
    if not roll:
        return moved
    swing = roll * np.sin(2 * np.pi * (motion.step_phase() + 0.05))
    return turn_joints(moved, turns(moved, 0.0, 0.0, swing), lean_shares(SPINE_ONLY, 0.8, 0.2))


def rock(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """`roll`: degrees that the whole torso tilts over the foot that carries, `sideways`: metres that the hips go along."""
    size = random.normal(1.0, 0.06)
    swing = np.sin(2 * np.pi * (motion.step_phase() + 0.05))
    ankles, _, _ = feet_of(motion)
    left = axes(motion).left
    sideways = size * float(edit.parameters["sideways"]) * swing
    moved = replace(motion, hips=motion.hips + sideways[:, None] * left)
    roll = size * float(edit.parameters["roll"]) * swing
    chain = {0: 0.35, 11: 0.6, 12: 0.8, 13: 1.0}
    return turn_joints(moved, turns(moved, 0.0, 0.0, roll), lean_shares(chain, 0.6, 0.4), ankles)


def landing(motion: EditedMotion, edit: PartEdit, random: np.random.Generator) -> EditedMotion:
    """How feet come down. `lift`: metres that they rise more before it, late; `drop`: metres that knees give after it.

    `soft`: share of a swing's height that is gone by two thirds of it, so that the foot arrives slowly.
    """
    p: dict[str, Any] = edit.parameters
    size = random.normal(1.0, 0.06)
    ankles, _, feet = feet_of(motion)
    for column in range(2):
        standing = down(motion, column)
        if "lift" in p:
            ankles[:, column, 1] += size * p["lift"] * _late(standing)
        if "soft" in p:
            high = height_in_swing(ankles[:, column, 1], standing)
            ankles[:, column, 1] -= p["soft"] * high * _early(standing)
    lower = size * float(p.get("drop", 0.0)) * _jolts(motion)
    moved = with_feet(motion, motion.hips - lower[:, None] * _UP, ankles, feet)
    if "bob" in p:
        moved = _bobbing(moved, p["bob"])
    pitch = size * float(p.get("jolt", 0.0)) * _jolts(motion)
    if not pitch.any():
        return moved
    return turn_joints(moved, turns(moved, pitch, 0.0, 0.0), lean_shares(SPINE_ONLY, 0.6, 0.4))


def _world(ahead: Axes, turn: Array) -> Array:
    return rotations.rotate(rotations.from_yaw(ahead.yaw), turn)


def _late(standing: NDArray[np.bool_]) -> Array:
    """For every swing a hill of height 1 that is highest after two thirds and ends steeply."""
    result = np.zeros(len(standing))
    for a, b in swings(standing):
        x = (np.arange(a, b) - a + 0.5) / (b - a)
        result[a:b] = x**2 * (1.0 - x) / (4.0 / 27.0)
    return result


def _early(standing: NDArray[np.bool_]) -> Array:
    """Of every swing: nothing in its first third, one from two thirds on."""
    result = np.zeros(len(standing))
    for a, b in swings(standing):
        result[a:b] = smoothstep(((np.arange(a, b) - a + 0.5) / (b - a) - 0.3) / 0.35)
    return result


def _jolts(motion: EditedMotion) -> Array:
    """One after every landing, risen to in a tenth of a second and gone after half."""
    landings = np.concatenate([left_landings(motion.contacts), right_landings(motion.contacts)])
    since = (np.arange(len(motion.hips))[:, None] - landings[None]) / _HARD
    bumps = np.where(since > 0, np.maximum(since, 0.0) * np.exp(1.0 - np.maximum(since, 0.0)), 0.0)
    return smooth(bumps.sum(1, keepdims=True), 1.0)[:, 0] if len(landings) else np.zeros(len(motion.hips))


KINDS = {"bob": bob, "hips": hips, "shoulders": shoulders, "rock": rock, "landing": landing}
