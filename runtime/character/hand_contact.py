"""Hands end at the character's own surface: what would sink into trunk or head is put on it, and the arm follows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sport.runtime import rotations
from sport.runtime.character.body_surface import BodySurface
from sport.runtime.skeleton import SPORT_SKELETON

if TYPE_CHECKING:
    from sport.runtime.character.character import Character

Array = NDArray[Any]

ROUNDS = 4  # of pushing: what leaves one part may still be in the next
REACH = 0.9995  # of the arm's length
ELBOW_M = 0.005  # pull on the elbow of an arm that is straight, down and back
_ELBOW = np.array([0.0, -1.0, -0.5])
ARM = {
    side: tuple(SPORT_SKELETON.index(side + bone) for bone in ("Arm", "ForeArm", "Hand"))
    for side in ("Left", "Right")
}
BELOW = {
    side: tuple(SPORT_SKELETON.index(name) for name in (f"{side}Hand", f"{side}FingerBase", f"{side}HandIndex1", f"{side[0]}Thumb"))
    for side in ("Left", "Right")
}  # fmt: skip


def clear_hands(character: Character, positions: Array, world_rotations: Array) -> tuple[Array, Array]:
    """A SPORT pose as `joint_transforms` takes it, any leading shape, whose hands lie on the character's surface.

    Hands keep how they are turned; shoulder and elbow turn. A pose whose hands are free comes back as it is.
    """
    body = character.body
    if body is None:
        return positions, world_rotations
    pivots, _ = character.joint_transforms(positions, world_rotations)
    way = _way_out(character, body, pivots, world_rotations)
    for k, side in enumerate(body.sides):
        if np.any(way[..., k, :]):
            positions, world_rotations = _bent(
                character, side, way[..., k, :], pivots, positions, world_rotations
            )
    return positions, world_rotations


def _joint(character: Character, side: str, bone: int) -> int:
    return int(np.flatnonzero(character.alignment.source == ARM[side][bone])[0])


def _way_out(character: Character, body: BodySurface, pivots: Array, world_rotations: Array) -> Array:
    """How far `(..., sides, 3)` hands have to go until none of their points is inside trunk or head."""
    wrists = pivots[..., [_joint(character, side, 2) for side in body.sides], :]
    turned = world_rotations[..., [ARM[side][2] for side in body.sides], :]
    points = wrists[..., None, :] + rotations.rotate(turned[..., None, :], body.hands)
    middle = 0.5 * (points.mean(axis=-2) + wrists)  # not of the fingers alone, which may be beyond an axis
    axes = rotations.to_matrix(world_rotations[..., body.sources, :])  # (..., tables, 3, 3)
    places = pivots[..., body.joints, :]
    # as the joints of the tables see them: (..., sides, tables, points, 3)
    points = (points[..., :, None, :, :] - places[..., None, :, None, :]) @ axes[..., None, :, :, :]
    middle = _seen(middle[..., :, None, :] - places[..., None, :, :], axes)
    way: Array = np.zeros(wrists.shape, np.float64)
    for _ in range(ROUNDS):
        moved = _seen(np.broadcast_to(way[..., :, None, :], middle.shape), axes)
        deep = body.depth(points + moved[..., None, :]).max(axis=-1)[..., None]
        if not np.any(deep):
            break
        out = (axes[..., None, :, :, :] @ body.outward(middle + moved)[..., None])[..., 0]
        # weighed by depth, so that the way is continuous where one part takes over from another
        way = way + (deep * deep * out).sum(axis=-2) / np.maximum(deep.sum(axis=-2), 1e-9)
    return way


def _seen(vectors: Array, axes: Array) -> Array:
    """Vectors `(..., sides, tables, 3)` in the axes `(..., tables, 3, 3)` of the tables."""
    return np.asarray((vectors[..., None, :] @ axes[..., None, :, :, :])[..., 0, :])


def _bent(
    character: Character, side: str, way: Array, pivots: Array, positions: Array, world_rotations: Array
) -> tuple[Array, Array]:
    """The pose with an arm bent so that its hand goes `way` further, in the plane of its elbow."""
    shoulder, elbow, hand = (pivots[..., _joint(character, side, bone), :] for bone in range(3))
    upper, lower, moved = _two_bones(shoulder, elbow, hand, hand + way)
    world, arm = np.array(world_rotations), ARM[side]
    free = ~np.any(way, axis=-1)[..., None]  # stays bit by bit
    for j, turn in ((arm[0], upper), (arm[1], lower)):
        turned = rotations.multiply(turn, world_rotations[..., j, :])
        world[..., j, :] = np.where(free, world_rotations[..., j, :], turned)
    at = np.array(positions)
    if character.alignment.native:
        bent = shoulder + rotations.rotate(upper, elbow - shoulder)
        at[..., arm[1], :] = np.where(free, at[..., arm[1], :], bent)
        for j in BELOW[side]:
            at[..., j, :] = np.where(free, at[..., j, :], at[..., j, :] + moved - hand)
    return at, world


def _two_bones(shoulder: Array, elbow: Array, hand: Array, target: Array) -> tuple[Array, Array, Array]:
    """World rotations of upper arm and forearm that bring the hand to `target`, and where it comes to lie."""
    a, b = np.linalg.norm(elbow - shoulder, axis=-1), np.linalg.norm(hand - elbow, axis=-1)
    length = np.linalg.norm(target - shoulder, axis=-1)
    length = np.clip(length, np.abs(a - b) + 1e-4, REACH * (a + b))
    along, wanted = rotations.normalize(hand - shoulder), rotations.normalize(target - shoulder)
    aside = (elbow - shoulder) - np.sum((elbow - shoulder) * along, axis=-1, keepdims=True) * along
    down = np.sum(_ELBOW * along, axis=-1, keepdims=True) * along
    aside = rotations.normalize(aside + ELBOW_M * (_ELBOW - down))
    cosine = np.clip((a * a + length * length - b * b) / np.maximum(2 * a * length, 1e-9), -1.0, 1.0)
    sine = np.sqrt(1.0 - cosine * cosine)
    bent = a[..., None] * (cosine[..., None] * along + sine[..., None] * aside)
    swing = rotations.between(along, wanted)
    upper = rotations.multiply(
        swing, rotations.between(rotations.normalize(elbow - shoulder), rotations.normalize(bent))
    )
    fore = rotations.normalize(length[..., None] * along - bent)
    lower = rotations.multiply(swing, rotations.between(rotations.normalize(hand - elbow), fore))
    return upper, lower, shoulder + length[..., None] * wanted
