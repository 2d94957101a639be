"""Body parts of one style on the legs of another, at matching step phase (as SINC composes actions by part)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.skeleton import PART_JOINTS
from training.layering.pose_edits import Motion
from training.layering.steps import left_landings, step_phase

Array = NDArray[np.floating]

UPPER_PARTS = ("left_arm", "right_arm", "torso", "head")
_SPINE = PART_JOINTS["torso"][1:]
MAX_TEMPO = 1.6  # ratio of the two cadences up to which a part may be sped up or slowed down


def recombine(base: Motion, donor: Motion, parts: tuple[str, ...]) -> Motion | None:
    """`base` with `parts` (of `UPPER_PARTS`) moving as in `donor`; None when their steps cannot be matched.

    The donor's frames are resampled so that its left foot lands when the base's does. A torso takes over the donor's
    inclination against the facing direction, shared by the lower back, while the base's hips keep carrying the legs.
    """
    mine, theirs = left_landings(base.contacts), left_landings(donor.contacts)
    if len(mine) < 3 or len(theirs) < 3:
        return None
    tempo = np.median(np.diff(theirs)) / np.median(np.diff(mine))
    if not 1.0 / MAX_TEMPO < tempo < MAX_TEMPO:
        return None
    wanted, given = step_phase(base.contacts), step_phase(donor.contacts)
    first = np.ceil(given[0] - wanted[0])  # whole cycles, so that landings stay landings
    wanted = wanted + first
    end = int(np.searchsorted(wanted, given[-1]))
    if end < 0.6 * len(wanted):
        return None
    at = np.interp(wanted[:end], given, np.arange(len(given)))
    low = np.floor(at).astype(int)
    high = np.minimum(low + 1, len(given) - 1)
    sampled = rotations.slerp(donor.local[low], donor.local[high], (at - low)[:, None])
    base = cut(base, 0, end)
    local = base.local.astype(np.float64).copy()
    for part in parts:
        if part == "torso":
            local = _take_torso(base, donor, sampled, local, at)
        else:
            joints = list(PART_JOINTS[part])
            local[:, joints] = sampled[:, joints]
    return replace(base, local=local)


def cut(motion: Motion, start: int, end: int) -> Motion:
    """Frames `start` to `end` of a motion."""
    piece = slice(start, end)
    return replace(
        motion,
        hips=motion.hips[piece],
        local=motion.local[piece],
        contacts=motion.contacts[piece],
        gait=None if motion.gait is None else motion.gait[piece],
    )


def _take_torso(base: Motion, donor: Motion, sampled: Array, local: Array, at: Array) -> Array:
    facing = rotations.from_yaw(np.interp(at, np.arange(len(donor.hips)), donor.facing))
    inclined = rotations.multiply(rotations.inverse(facing), sampled[:, 0])  # donor's hips against its facing
    wanted = rotations.multiply(rotations.from_yaw(base.facing), inclined)
    local = local.copy()
    local[:, _SPINE] = sampled[:, _SPINE]
    correction = rotations.multiply(rotations.inverse(local[:, 0]), wanted)
    local[:, _SPINE[0]] = rotations.multiply(correction, sampled[:, _SPINE[0]])
    return local
