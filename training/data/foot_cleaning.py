"""Foot cleaning: feet in contact are fixed in place on the ground, and legs follow by IK."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.feet.ik import MAX_REACH, solve_legs
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT
from runtime.takes.footplants import stretches
from training.data.retarget import FOOT_OFFSET, LEG_LENGTH, heel_rise, pitched

GroundHeight = Callable[[Array, Array], Array]

_FOOT_LENGTH = float(np.linalg.norm(FOOT_OFFSET))
_REST_ELEVATION = float(np.arcsin(FOOT_OFFSET[1] / _FOOT_LENGTH))
_FLOAT_M = 0.001  # that a foot may float above its target: sinking hips instead would bend a straight knee by 5 degrees
# of the leg's length (knee flexion 8 degrees): beyond, a knee must not become straighter than it was
_STRAIGHT_FRACTION = 0.9975
_HEEL_OFF = np.deg2rad(6.0)  # pitch above which a heel counts as raised while the toes stand
_MAX_TURN = np.deg2rad(40.0)
_MIN_SWING_ANKLE_M = 0.05  # minimum ankle height of a foot in the air
_THIGHS, _ANKLES, _TOES = [2, 7], [4, 9], [5, 10]


def clean_feet(
    hips: Array, local: Array, contacts: NDArray[np.uint8], ground: GroundHeight
) -> tuple[Array, Array]:
    """Return hips `(T, 3)` and local rotations `(T, 31, 4)` with planted feet that do not slide on `ground(x, z)`.

    Feet in contact keep their position on the ground, and flat feet follow its slope; the correction is blended over the
    swing. Over standing toes the heel rises until the leg has its former length; if a leg is still too short the hips sink.
    """
    hips, local = hips.astype(np.float64), local.astype(np.float64)
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    foot, ankles = world[:, _ANKLES], positions[:, _ANKLES]
    thighs, before = positions[:, _THIGHS], ankles.copy()
    lengths = np.linalg.norm(ankles - thighs, axis=-1)
    pairs = contacts.astype(bool).reshape(-1, 2, 2)
    for side in range(2):
        pairs[:, side] = _carrying(ankles[:, side], positions[:, _TOES[side]], pairs[:, side], ground)
        ankles[:, side], foot[:, side] = _clean_foot(
            ankles[:, side], positions[:, _TOES[side]], foot[:, side], pairs[:, side], ground
        )
    shift = _standing_shift(before, ankles, pairs)
    hips, thighs = hips + shift, thighs + shift
    for side in range(2):
        ankles[:, side], foot[:, side] = _raise_heel(
            thighs[:, side], ankles[:, side], foot[:, side], lengths[:, side], pairs[:, side]
        )
    hips = _sink_to_reach(hips, thighs, ankles, lengths)
    local = solve_legs(hips, local, ankles, foot)
    local = rotations.continuous(rotations.normalize(local))
    return hips.astype(np.float32), local.astype(np.float32)


def bridge(values: Array, known: NDArray[np.bool_], hold_slope: bool) -> Array:
    """Fill the gaps of `values` `(T, n)` between stretches of `known` by cubic Hermite curves, constant at the ends.

    With `hold_slope` a gap begins and ends with the slope of its neighbours, otherwise with slope 0.
    """
    result = values.copy()
    runs = stretches(known)
    if not runs:
        return np.zeros_like(values)
    result[: runs[0][0]] = values[runs[0][0]]
    result[runs[-1][1] :] = values[runs[-1][1] - 1]
    for (_, end), (start, _) in pairwise(runs):
        span = start - end + 1
        s = (np.arange(1, span) / span)[:, None]
        a, b = values[end - 1], values[start]
        slope_a = values[end - 1] - values[end - 2] if hold_slope and end >= 2 and known[end - 2] else 0.0
        slope_b = (
            values[start + 1] - values[start]
            if hold_slope and start + 1 < len(known) and known[start + 1]
            else 0.0
        )
        result[end:start] = (
            (2 * s**3 - 3 * s**2 + 1) * a + (3 * s**2 - 2 * s**3) * b
            + (s**3 - 2 * s**2 + s) * span * slope_a + (s**3 - s**2) * span * slope_b
        )  # fmt: skip
    return result


def _carrying(
    ankle: Array, toe: Array, contact: NDArray[np.bool_], ground: GroundHeight
) -> NDArray[np.bool_]:
    """Return contacts `(T, 2)` of heel and toe without rising heels: pressing those down would stretch the leg.

    A heel counts as raised relative to both this ground and level ground: feet captured on a floor ignore slopes.
    """
    flat = np.minimum(_slope(ankle, toe, ground), _REST_ELEVATION)
    rise = flat - _pitch(ankle, toe)
    lifted = contact[:, 1] & (rise > _HEEL_OFF)
    return np.stack([contact[:, 0] & ~lifted, contact[:, 1]], axis=1)


def _slope(ankle: Array, toe: Array, ground: GroundHeight) -> Array:
    """Return the elevation from ankle to toe of a foot flat on the ground, radians."""
    rise = ground(toe[:, 0], toe[:, 2]) - ground(ankle[:, 0], ankle[:, 2])
    return np.arcsin(np.clip((rise + FOOT_OFFSET[1]) / _FOOT_LENGTH, -0.9, 0.9))


def _pitch(ankle: Array, toe: Array) -> Array:
    return np.arcsin(np.clip((toe[:, 1] - ankle[:, 1]) / _FOOT_LENGTH, -1.0, 1.0))


def _standing_shift(before: Array, after: Array, contacts: NDArray[np.bool_]) -> Array:
    """Return the median lift of standing ankles as a vector: hips lifted by it preserve the legs' length."""
    lifts = (after - before)[..., 1][contacts.any(-1)]
    return np.array([0.0, float(np.median(lifts)) if len(lifts) else 0.0, 0.0])


def _raise_heel(
    hip: Array, ankle: Array, foot: Array, length: Array, contact: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return ankle `(T, 3)` and foot `(T, 4)`, with the heel raised to leg `length` `(T,)` where only the toe bears weight."""
    from scipy.ndimage import gaussian_filter1d

    alone = gaussian_filter1d((contact[:, 1] & ~contact[:, 0]).astype(np.float64), 2.0)
    toe = ankle + rotations.rotate(foot, FOOT_OFFSET)
    foot = pitched(foot, alone * heel_rise(hip, toe, foot, length))
    return toe - rotations.rotate(foot, FOOT_OFFSET), foot


def _clean_foot(
    ankle: Array, toe: Array, foot: Array, contact: NDArray[np.bool_], ground: GroundHeight
) -> tuple[Array, Array]:
    """Return targets of one ankle `(T, 3)` and rotations of that foot `(T, 4)`; `contact` `(T, 2)` is heel, toe."""
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d

    planted = np.any(contact, axis=1)
    slide = _slide_correction(ankle, toe, contact)
    ankle, toe = ankle + slide, toe + slide
    under_ankle, under_toe = ground(ankle[:, 0], ankle[:, 2]), ground(toe[:, 0], toe[:, 2])

    both = gaussian_filter1d(contact.all(1).astype(np.float64), 2.0)
    turn = np.clip(_pitch(ankle, toe) - _slope(ankle, toe, ground), -_MAX_TURN, _MAX_TURN) * both
    foot = pitched(foot, turn)
    toe = ankle + rotations.rotate(foot, FOOT_OFFSET)

    # the joint in contact determines the height; if both are, they agree after the rotation
    error = np.where(
        contact[:, 1], under_toe + TOE_HEIGHT - toe[:, 1], under_ankle + ANKLE_HEIGHT - ankle[:, 1]
    )
    lift = gaussian_filter1d(bridge(error[:, None], planted, hold_slope=False)[:, 0], 1.5)
    ankle[:, 1] += lift
    toe[:, 1] += lift
    depth = np.maximum(
        ground(toe[:, 0], toe[:, 2]) + TOE_HEIGHT - toe[:, 1],
        np.where(contact[:, 0], ANKLE_HEIGHT, _MIN_SWING_ANKLE_M) + under_ankle - ankle[:, 1],
    )
    ankle[:, 1] += gaussian_filter1d(maximum_filter1d(np.maximum(depth, 0.0), 7), 1.5)
    return ankle, foot


def _slide_correction(ankle: Array, toe: Array, contact: NDArray[np.bool_]) -> Array:
    """Return the horizontal displacement `(T, 3)` that fixes the contact joints of every stance."""
    weights = contact / np.maximum(contact.sum(1, keepdims=True), 1)
    steps = np.stack([np.diff(ankle, axis=0), np.diff(toe, axis=0)], axis=1)
    moved = np.sum(steps * weights[1:, :, None], axis=1) * np.array([1.0, 0.0, 1.0])
    correction = np.zeros_like(ankle)
    planted = np.any(contact, axis=1)
    for start, end in stretches(planted):
        drift = np.concatenate([np.zeros((1, 3)), np.cumsum(moved[start : end - 1], axis=0)])
        correction[start:end] = drift.mean(0) - drift
    return bridge(correction, planted, hold_slope=True)


def _sink_to_reach(hips: Array, thighs: Array, ankles: Array, lengths: Array) -> Array:
    """Lower the hips smoothly where a nearly straight leg would become longer than it was (`lengths` `(T, 2)`)."""
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d

    gap = ankles - thighs
    across = np.linalg.norm(gap[..., [0, 2]], axis=-1)
    reach = np.clip(lengths, _STRAIGHT_FRACTION * LEG_LENGTH, MAX_REACH * LEG_LENGTH)
    allowed = np.sqrt(np.maximum(reach**2 - across**2, 0.01))
    missing = np.clip((-gap[..., 1] - allowed).max(axis=1) - _FLOAT_M, 0.0, 0.25)
    sink = gaussian_filter1d(maximum_filter1d(missing, 9), 3.0)
    return hips - np.stack([np.zeros_like(sink), sink, np.zeros_like(sink)], axis=1)
