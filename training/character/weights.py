"""Skin weights of the left half: blends along each limb at its joints, smoothed over the surface.

A vertex only ever gets joints of its own limb chain, so nothing bleeds between the legs, the arm and the flank, or
fingers and thumb; diffusion over the mesh afterwards removes the creases between the chains.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.skeleton import MIRROR_JOINTS, SPORT_SKELETON, J
from training.character.body import Body
from training.character.mesh import Triangles, laplacian

MAX_INFLUENCES = 4


def ramp(x: Array, start: Array | float, end: Array | float) -> Array:
    """Smoothstep from 0 at `start` to 1 at `end` (which may lie below `start`)."""
    t = np.clip((x - start) / (np.asarray(end) - start), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _chain(weights: Array, share: Array, names: tuple[str, ...], blends: tuple[Array, ...]) -> None:
    """Distribute `share` `(V,)` along a chain: `blends[i]` is how far a vertex has passed from joint i to joint i + 1."""
    rest = share
    for name, blend in zip(names[:-1], blends, strict=True):
        weights[:, SPORT_SKELETON.index(name)] += rest * (1.0 - blend)
        rest = rest * blend
    weights[:, SPORT_SKELETON.index(names[-1])] += rest


def analytic_weights(body: Body, v: Array) -> Array:
    """Weights `(V, 31)` of rest-pose vertices of the left half, before smoothing."""
    x, y, z = v.T
    weights = np.zeros((len(v), J))
    arm = ramp(x, 0.138 + 0.02 * ramp(y, 1.34, 1.25), 0.225 - 0.02 * ramp(y, 1.34, 1.25)) * (y > 1.15)
    inner = ramp(x, 0.15, 0.0)  # near the mirror plane the thigh begins lower
    leg = ramp(y, 0.965 - 0.125 * inner, 0.845 - 0.045 * inner) * (1 - arm)
    trunk = 1.0 - arm - leg
    above = y + 0.35 * z  # the jaw belongs to the head, the nape below it does not
    collar = 0.55 * ramp(x, 0.035, 0.14) * ramp(y, 1.25, 1.34) * ramp(above, 1.43, 1.38)
    _chain(
        weights,
        trunk * (1 - collar),
        ("Hips", "LowerBack", "Spine", "Spine1", "Neck", "Neck1", "Head"),
        (
            ramp(y, 0.955, 1.055),
            ramp(y, 1.065, 1.165),
            ramp(y, 1.175, 1.275),
            ramp(above, 1.345, 1.405),
            ramp(above, 1.375, 1.445),
            ramp(above, 1.435, 1.485),
        ),
    )
    weights[:, SPORT_SKELETON.index("LeftShoulder")] += trunk * collar
    _arm_weights(body, v, arm, weights)
    _chain(
        weights,
        leg,
        ("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"),
        (
            ramp(y, 0.545, 0.435),
            ramp(y - 0.25 * (z - 0.047), 0.105, 0.050),
            ramp(z, 0.160, 0.200) * ramp(y, 0.12, 0.06),
        ),
    )
    return weights


def _arm_weights(body: Body, v: Array, arm: Array, weights: Array) -> None:
    x = v[:, 0]
    far = x > 0.6
    thumb = np.zeros(len(v))
    if far.any():
        rest = np.min([body.part_distance(n, v[far]) for n in ("palm", "finger0")], axis=0)
        thumb[far] = ramp(rest - body.part_distance("thumb", v[far]), -0.002, 0.008)
    _chain(weights, arm * thumb, ("LeftHand", "LThumb"), (ramp(x, 0.675, 0.705),))
    _chain(
        weights,
        arm * (1 - thumb),
        ("LeftArm", "LeftForeArm", "LeftHand", "LeftHandIndex1"),
        (ramp(x, 0.420, 0.512), ramp(x, 0.630, 0.688), ramp(x, 0.705, 0.760)),
    )


def diffuse(weights: Array, vertices: Array, triangles: Triangles, reach: float) -> Array:
    """Let weights `(V, 31)` spread like heat over the surface by about `reach` metres, whatever the mesh's density."""
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    stiffness, mass = laplacian(vertices, triangles)
    steps = 4  # one implicit step would have a long exponential tail
    solver = splu((diags(mass) + reach**2 / steps * stiffness).tocsc())
    for _ in range(steps):
        weights = np.clip(solver.solve(mass[:, None] * weights), 0.0, None)
    return weights


def mirrored_weights(
    weights: Array, source: NDArray[np.int64], side: NDArray[np.int64], middle: Array
) -> Array:
    """Weights `(V, 31)` of the whole mesh; vertices on the mirror plane share both sides evenly."""
    whole = weights[source]
    whole[side == 1] = whole[side == 1][:, MIRROR_JOINTS]
    centre = np.flatnonzero(middle)
    whole[centre] = 0.5 * (whole[centre] + whole[centre][:, MIRROR_JOINTS])
    return whole


def separate_sides(weights: Array, vertices: Array) -> Array:
    """Take limbs of the other side out of weights `(V, 31)`, but for a narrow seam at the mirror plane."""
    weights = weights.copy()
    for prefixes, side in ((("Left", "LHip", "LThumb"), -1.0), (("Right", "RHip", "RThumb"), 1.0)):
        limbs = [i for i, name in enumerate(SPORT_SKELETON.names) if name.startswith(prefixes)]
        weights[:, limbs] *= ramp(side * vertices[:, 0], 0.02, 0.0)[:, None]
    return weights / weights.sum(axis=1, keepdims=True)


def strongest(weights: Array) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """The four strongest joints `(V, 4)` of each vertex and their weights, which sum to one."""
    joints = np.argsort(-weights, axis=1, kind="stable")[:, :MAX_INFLUENCES]
    values = np.take_along_axis(weights, joints, axis=1)
    values = np.where(values < 0.01, 0.0, values)
    values /= values.sum(axis=1, keepdims=True)
    joints = np.where(values > 0, joints, 0)
    return joints.astype(np.uint16), values.astype(np.float32)
