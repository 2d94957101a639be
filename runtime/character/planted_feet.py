"""Plants the feet of characters with other proportions where ours stand, by inverse kinematics of the legs.

Joint angles alone would put a longer foot or a shorter shin into the ground. A foot that rolls over heel or ball
uses the character's own; while it stands, it stays in place.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.character.skinned_mesh import SkinnedMesh
from runtime.character.two_bones import bend
from runtime.easing import smoothstep
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT

LEGS = tuple(
    tuple(SPORT_SKELETON.index(side + bone) for bone in ("UpLeg", "Leg", "Foot", "ToeBase"))
    for side in ("Left", "Right")
)
OUR_HEEL = np.array([0.0, -ANKLE_HEIGHT, -0.05])  # of our own sole, metres from the ankle
OUR_BALL = np.array([0.0, -ANKLE_HEIGHT, float(SPORT_SKELETON.offsets[LEGS[0][3], 2])])
SOLE_FRACTION = 0.25  # of the ankle's height: vertices up to there belong to the sole
KNEE = np.array([0.0, 0.0, 1.0])  # direction in which a straight knee bends
HEEL_DOWN_RAD, HEEL_UP_RAD = np.radians((-2.0, -15.0))  # pitch at which the toes begin to bend, and stop
MAX_TOE_BEND_RAD = np.radians(80.0)  # their range
OUTLINE_POINTS = 13  # points of a foot or of toes,
OUTLINE_LEAN_FACTOR = 0.35  # tangent of the sideways roll of feet
FLAT_RANGE = (0.8, 1.0)  # contacts of heel and toe from which a foot stands flat,
ON_SLOPES_WEIGHT = 0.8  # also on a slope, where its heel may be lower: weight of the heel's lift
PRESSED_M = 0.002  # m, depth of our soles in the ground, `sink` of the foot lock
TOES_UP_FRACTION = 0.1  # sine of the pitch from which a foot rolls over its heel


@dataclass(frozen=True)
class Soles:
    """Both feet of a character in its aligned rest pose, left first; lengths in metres, relative to the ankles.

    `heel` and `ball` are offsets from the same points of the SPORT feet.
    """

    joints: NDArray[np.int64]  # (2, 3) of the character: upper leg, lower leg, foot
    heel: AnyArray  # (2, 3)
    ball: AnyArray  # (2, 3)
    aside: AnyArray  # (2, 3) how much farther out its hip joints are
    foot: AnyArray  # (2, n, 3) the outline of the foot
    toes: AnyArray  # (2, n, 3) and the approximate outline of the toes
    toe_joint: AnyArray  # (2, 3)


def find_soles(mesh: SkinnedMesh, rest: AnyArray, pivots: AnyArray) -> Soles:
    """Find the feet of a character by its vertices `rest` `(V, 3)` and pivots `(K, 3)` in the aligned rest pose."""
    alignment = mesh.alignment
    joint_of = {int(s): k for k, s in enumerate(alignment.source) if s >= 0}
    lead = mesh.joint_indices[np.arange(len(rest)), mesh.joint_weights.argmax(axis=1)]
    owner = alignment.source[alignment.driver[lead]]
    hips = pivots[[joint_of[upper] for upper, *_ in LEGS]].mean(axis=0)
    sides = []
    for upper, _, foot, toe in LEGS:
        ankle = pivots[joint_of[foot]]
        own, tip = rest[owner == foot] - ankle, rest[owner == toe] - ankle
        if not len(own):
            own = np.array([OUR_HEEL, OUR_BALL]) * (1, 0, 1) + (0, rest[:, 1].min() - ankle[1], 0)
        depth, back, front = _sole(np.concatenate([own, tip]))
        joint = pivots[joint_of[toe]] - ankle if toe in joint_of else np.array([0.0, -depth, front])
        aside = (pivots[joint_of[upper]] - hips) * (1, 0, 0)
        sides.append(
            (
                np.array([0.0, -depth, back]) - OUR_HEEL,
                np.array([0.0, -depth, joint[2]]) - OUR_BALL,
                aside - SPORT_SKELETON.rest_positions[upper] * (1, 0, 0),
                _outline(own),
                _outline(tip if len(tip) else joint[None]) - joint,
                joint,
            )
        )
    joints = np.array([[joint_of[upper], joint_of[lower], joint_of[foot]] for upper, lower, foot, _ in LEGS])
    return Soles(joints, *(np.stack(each) for each in zip(*sides, strict=True)))


def _sole(points: AnyArray) -> tuple[float, float, float]:
    """Return the depth of a sole below the ankle, and its extent along Z (back, front)."""
    depth = -float(points[:, 1].min())
    # otherwise a foot above its ankle
    low = points[points[:, 1] <= -(1.0 - SOLE_FRACTION) * depth] if depth > 0.0 else points
    return depth, float(low[:, 2].min()), float(low[:, 2].max())


def _outline(points: AnyArray) -> AnyArray:
    """Return the lowest, foremost and rearmost points `(3 OUTLINE_POINTS, 3)`, upright and leaning to either side."""
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, OUTLINE_POINTS)
    leans = np.repeat([-OUTLINE_LEAN_FACTOR, 0.0, OUTLINE_LEAN_FACTOR], OUTLINE_POINTS)
    directions = np.stack([leans, np.tile(-np.cos(angles), 3), np.tile(np.sin(angles), 3)], 1)
    return np.asarray(points[np.argmax(points @ directions.T, axis=0)])


def plant_feet(
    mesh: SkinnedMesh, soles: Soles, positions: AnyArray, world_rotations: AnyArray, contacts: AnyArray
) -> tuple[AnyArray, AnyArray]:
    """Bend the legs of a SPORT pose, any leading shape, so that this character's feet stand on the ground.

    `contacts` `(..., 4)` are those of a pose. Returns the unchanged positions and the new world rotations.
    """
    upper, lower, foot, toe = (list(joints) for joints in zip(*LEGS, strict=True))
    world = np.array(world_rotations, np.float64)
    pivots, _ = mesh.joint_transforms(positions, world)
    hip, knee, ankle = (pivots[..., soles.joints[:, k], :] for k in range(3))
    turned = world[..., foot, :]
    world[..., toe, :] = toes = _flat_toes(turned, world[..., toe, :])
    toe_height = positions[..., toe, 1] - positions[..., foot, 1] - TOE_HEIGHT
    floor = np.minimum(toe_height, -ANKLE_HEIGHT) + PRESSED_M
    pairs = np.reshape(contacts, (*np.shape(contacts)[:-1], 2, 2))
    target = positions[..., foot, :] + _shift(soles, turned, toes, pairs, floor)
    ahead = rotations.rotate(world[..., upper, :], KNEE)
    turn_upper, turn_lower, _ = bend(hip, knee, ankle, target, ahead)
    world[..., upper, :] = rotations.multiply(turn_upper, world[..., upper, :])
    world[..., lower, :] = rotations.multiply(turn_lower, world[..., lower, :])
    return positions, world


def _flat_toes(foot: AnyArray, toes: AnyArray) -> AnyArray:
    """Return toes bent up under a rising heel: the motion hardly bends them, and longer toes would enter the ground."""
    pitch, own = (np.arcsin(np.clip(rotations.rotate(q, KNEE)[..., 1], -1.0, 1.0)) for q in (foot, toes))
    wanted = np.minimum(pitch + MAX_TOE_BEND_RAD, 0.0)
    up = smoothstep((HEEL_DOWN_RAD - pitch) / (HEEL_DOWN_RAD - HEEL_UP_RAD)) * np.maximum(wanted - own, 0.0)
    axis = rotations.rotate(foot, np.array([1.0, 0.0, 0.0]))
    return rotations.multiply(rotations.from_axis_angle(axis, -up), toes)


def _shift(soles: Soles, foot: AnyArray, toes: AnyArray, contacts: AnyArray, floor: AnyArray) -> AnyArray:
    """Offset `(..., 2, 3)` from our ankles to these: a foot rolls over the ball on its toes, over the heel with toes up.

    `contacts` `(..., 2, 2)` of heel and toe of each foot, `floor` `(..., 2)` the ground's height from our ankle.
    """
    toe_contact = contacts[..., 1]
    ahead = rotations.rotate(foot, KNEE)
    level = rotations.from_yaw(np.arctan2(ahead[..., 0], ahead[..., 2]))
    heel_share = np.clip(ahead[..., 1] / TOES_UP_FRACTION, 0.0, 1.0) * (1.0 - np.clip(toe_contact, 0.0, 1.0))
    flat = np.array([1.0, 0.0, 1.0])
    over_ball = rotations.rotate(toes, soles.ball * flat + soles.aside) - rotations.rotate(foot, soles.ball)
    over_heel = rotations.rotate(level, soles.heel * flat + soles.aside) - rotations.rotate(foot, soles.heel)
    shift = over_ball + heel_share[..., None] * (over_heel - over_ball)
    # then no point of this foot may be deeper than the lowest one of our sole
    up = rotations.rotate(toes, np.array([0.0, 1.0, 0.0]))[..., None, :]
    in_foot = (rotations.to_matrix(foot).swapaxes(-1, -2) @ up.swapaxes(-1, -2))[..., 0]  # (..., 2, 3)
    ours = np.minimum(in_foot @ OUR_HEEL, in_foot @ OUR_BALL)
    own_foot = np.sum(soles.foot * in_foot[..., None, :], -1).min(-1)
    own_toes = soles.toes[..., 1].min(-1) + np.sum(soles.toe_joint * in_foot, -1)
    deepest = np.minimum(own_foot, own_toes) + np.sum(shift * up[..., 0, :], -1)
    shift = shift + np.maximum(ours - deepest, 0.0)[..., None] * up[..., 0, :]
    # nor, unless heel and toe both stand, below the ground under our ankle and toe joint
    down = np.array([0.0, 1.0, 0.0])
    in_toes = (rotations.to_matrix(toes).swapaxes(-1, -2) @ down)[..., None, :]
    own_toes = rotations.rotate(foot, soles.toe_joint)[..., 1] + np.sum(soles.toes * in_toes, -1).min(-1)
    in_foot = (rotations.to_matrix(foot).swapaxes(-1, -2) @ down)[..., None, :]
    own_low = np.minimum(np.sum(soles.foot * in_foot, -1).min(-1), own_toes) + shift[..., 1]
    stands = smoothstep((contacts.min(axis=-1) - FLAT_RANGE[0]) / (FLAT_RANGE[1] - FLAT_RANGE[0]))
    lift = np.maximum(floor - own_low, 0.0) * (1.0 - ON_SLOPES_WEIGHT * stands)
    return np.asarray(shift + lift[..., None] * down)
