"""Closed-form inverse kinematics of a two-bone limb."""

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray

REACH_FRACTION = 0.9995  # of the limb's length
GIVES_WAY_M = 0.005  # pull on the middle joint of a straight limb


def bend(
    top: AnyArray, middle: AnyArray, end: AnyArray, target: AnyArray, toward: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Return world rotations of both bones that bring the end of a limb to `target`, and the position that the end reaches.

    All inputs are `(..., 3)`. The limb stays in its plane; a straight limb bends `toward`.
    """
    a, b = np.linalg.norm(middle - top, axis=-1), np.linalg.norm(end - middle, axis=-1)
    length = np.linalg.norm(target - top, axis=-1)
    length = np.clip(length, np.abs(a - b) + 1e-4, REACH_FRACTION * (a + b))
    along, wanted = rotations.normalize(end - top), rotations.normalize(target - top)
    aside = (middle - top) - np.sum((middle - top) * along, axis=-1, keepdims=True) * along
    off = np.sum(toward * along, axis=-1, keepdims=True) * along
    aside = rotations.normalize(aside + GIVES_WAY_M * (toward - off))
    cosine = np.clip((a * a + length * length - b * b) / np.maximum(2 * a * length, 1e-9), -1.0, 1.0)
    sine = np.sqrt(1.0 - cosine * cosine)
    bent = a[..., None] * (cosine[..., None] * along + sine[..., None] * aside)
    swing = rotations.between(along, wanted)
    upper = rotations.multiply(
        swing, rotations.between(rotations.normalize(middle - top), rotations.normalize(bent))
    )
    fore = rotations.normalize(length[..., None] * along - bent)
    lower = rotations.multiply(swing, rotations.between(rotations.normalize(end - middle), fore))
    return upper, lower, top + length[..., None] * wanted
