"""One leg in plain floats: forward kinematics, two-bone IK, knees of limited speed, and toes bent by the ground.

`runtime.feet.ik` is the same mathematics on arrays; tests compare the two.

Near straight, a millimetre of hip-ankle distance changes the knee by ten degrees, so that landing, holding or releasing a
foot would snap the knee. What the knee cannot follow for some frames, the foot takes up by rolling over its toe.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import acos, asin, atan2, copysign, cos, dist, hypot, radians, sin, sqrt
from typing import NamedTuple

from runtime.feet.ik import EASE_REACH_FRACTION, MAX_REACH, MIN_OPENING_M, MIN_REACH_FRACTION, POLE_WEIGHT_M
from runtime.scalar_math import (
    MIN_DIVISOR,
    MIN_SIZE,
    Quaternion,
    Vector,
    add,
    add_scaled,
    between,
    decay,
    dot,
    from_vector,
    length,
    multiply,
    perpendicular,
    relative,
    rotate,
    scale,
    subtract,
    unit,
)
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT, Skeleton
from runtime.terrain.height_map import PointHeights


class LegBones(NamedTuple):
    """Joint indices and offsets (metres) of one leg."""

    joints: tuple[int, int, int, int, int]  # hip joint, thigh, shin, foot, toe
    offsets: tuple[Vector, Vector, Vector, Vector, Vector]
    length: float  # thigh and shin
    foot_length: float  # ankle to toe joint


class LegPose(NamedTuple):
    """World rotations and positions of one leg."""

    base: Quaternion  # of the hip joint
    thigh: Quaternion
    shin: Quaternion
    foot: Quaternion
    hip: Vector
    knee: Vector
    ankle: Vector
    toe: Vector

    def raised(self, metres: float) -> Vector:
        """Return the hip position raised by `metres`."""
        return self.hip[0], self.hip[1] + metres, self.hip[2]


def leg_bones(side: int, skeleton: Skeleton = SPORT_SKELETON) -> LegBones:
    """Return the left (0) or right (1) leg of a SPORT skeleton."""
    first = 1 + 5 * side
    joints = (first, first + 1, first + 2, first + 3, first + 4)
    offsets = tuple((float(x), float(y), float(z)) for x, y, z in skeleton.offsets[list(joints)])
    reach = length(offsets[2]) + length(offsets[3])
    return LegBones(joints, offsets, reach, length(offsets[4]))  # type: ignore[arg-type]


def leg_forward(bones: LegBones, hips: Vector, local: list[Quaternion]) -> LegPose:
    """Return the world pose of a leg by forward kinematics; `local` are the pose's 31 local rotations."""
    j0, j1, j2, j3, _ = bones.joints
    _, _, upper, lower, sole = bones.offsets
    base, hip = leg_base(bones, hips, local[0], local[j0])
    thigh = multiply(base, local[j1])
    shin = multiply(thigh, local[j2])
    foot = multiply(shin, local[j3])
    knee = add(hip, rotate(thigh, upper))
    ankle = add(knee, rotate(shin, lower))
    return LegPose(base, thigh, shin, foot, hip, knee, ankle, add(ankle, rotate(foot, sole)))


def leg_base(bones: LegBones, hips: Vector, root: Quaternion, joint: Quaternion) -> tuple[Quaternion, Vector]:
    """Return the world rotation of a leg's hip joint, which is located at the hips, and the position of its thigh."""
    base = multiply(root, joint)
    return base, add(hips, rotate(base, bones.offsets[1]))


def toes_raised(leg: LegPose, fraction: float, rise: float = 0.0) -> LegPose:
    """Return the leg with its toes raised further by a `fraction`, relative to a flat sole; the foot turns about the ankle.

    The ground under the toe is `rise` metres higher than under the ankle.
    """
    sole = subtract(leg.toe, leg.ankle)
    foot = length(sole)
    up = asin(min(max(sole[1] / foot, -1.0), 1.0)) - asin(
        min(max((TOE_HEIGHT - ANKLE_HEIGHT + rise) / foot, -1.0), 1.0)
    )
    if up <= 0.0:
        return leg
    turn = from_vector(scale(rotate(leg.foot, (-1.0, 0.0, 0.0)), fraction * up))
    return LegPose(*leg[:3], multiply(turn, leg.foot), *leg[4:7], add(leg.ankle, rotate(turn, sole)))


def leg_inverse(
    leg: LegPose, target: Vector, foot: Quaternion, drop: float = 0.0
) -> tuple[Quaternion, Quaternion, Quaternion]:
    """Return local rotations of thigh, shin and foot that bring the ankle to `target` with the hips lowered by `drop` metres.

    `foot` is the foot's new world rotation. See `runtime.feet.ik.two_bone`.
    """
    base, thigh, shin, _, hip, knee, ankle, _ = leg
    upper, lower, now = subtract(knee, hip), subtract(ankle, knee), subtract(ankle, hip)
    axis, to_target = unit(now), (target[0] - hip[0], target[1] - (hip[1] - drop), target[2] - hip[2])
    # far from the origin rounding makes hip and knee coincide: avoid dividing by a zero length
    a, b = max(length(upper), MIN_SIZE), max(length(lower), MIN_SIZE)
    wanted = length(to_target)
    aim = unit(to_target) if wanted > MIN_SIZE else axis
    d = max(soft_reach(wanted, a + b, length(now)), abs(a - b) + MIN_OPENING_M)
    swing = between(axis, aim)
    bend = rotate(swing, _bend(axis, upper, rotate(thigh, (0.0, 0.0, 1.0))))
    c = min(1.0, max(-1.0, (a * a + d * d - b * b) / (2.0 * a * d)))
    s = sqrt(1.0 - c * c)
    thigh_to = add_scaled(scale(aim, c), bend, s)
    shin_to = unit(add_scaled(scale(aim, d), thigh_to, -a))
    thigh_turn = multiply(between(rotate(swing, unit(upper)), thigh_to), swing)
    shin_turn = multiply(between(rotate(swing, unit(lower)), shin_to), swing)
    thigh, shin = multiply(thigh_turn, thigh), multiply(shin_turn, shin)
    return relative(base, thigh), relative(thigh, shin), relative(shin, foot)


def turned_out(leg: LegPose, side: int, radians_out: float) -> LegPose:
    """Return the left (0) or right (1) leg with its knee turned outwards about the hip-ankle line; the foot does not move."""
    turn = from_vector(scale(unit(subtract(leg.ankle, leg.hip)), radians_out if side else -radians_out))
    knee = add(leg.hip, rotate(turn, subtract(leg.knee, leg.hip)))
    return leg._replace(knee=knee, thigh=multiply(turn, leg.thigh), shin=multiply(turn, leg.shin))


def roll_cosine(to_hip: Vector, foot: float, reach: float) -> float:
    """Return the cosine of the angle at the toe between hip and ankle for which the ankle is `reach` metres from the hip.

    The ankle is `foot` metres from the toe. There is no such angle if the value is outside -1 to 1.
    """
    distance = length(to_hip)
    return (distance * distance + foot * foot - reach * reach) / (2.0 * distance * foot)


def rolled(to_hip: Vector, along: Vector, cosine: float) -> Vector:
    """Return the direction from toe to ankle that has this cosine with that to the hip, on the side of `along`."""
    cosine = min(max(cosine, -1.0), 1.0)
    up = scale(to_hip, 1.0 / length(to_hip))
    side = unit(perpendicular(along, up))
    return add_scaled(scale(up, cosine), side, sqrt(1.0 - cosine * cosine))


def soft_reach(distance: float, leg_length: float, span: float = 0.0) -> float:
    """Scalar version of `runtime.feet.ik.soft_reach`."""
    start = max((MAX_REACH - EASE_REACH_FRACTION) * leg_length, min(span, leg_length))
    room = max(MAX_REACH * leg_length - start, MIN_DIVISOR * leg_length)
    over = min(max(distance - start, 0.0), 2.0 * room)
    return max(min(distance, start) + over - over * over / (4.0 * room), MIN_REACH_FRACTION * leg_length)


def _bend(axis: Vector, knee: Vector, pole: Vector) -> Vector:
    forward = unit(perpendicular(pole, axis))
    bend = add_scaled(perpendicular(knee, axis), forward, POLE_WEIGHT_M)
    lack = 0.5 * POLE_WEIGHT_M - dot(bend, forward)
    return unit(add_scaled(bend, forward, lack) if lack > 0.0 else bend)


# rad/s2, of the flexion; 6 degrees per frame squared is visible as a snap, captures stay below
MAX_FLEXION_RAD_PER_S = radians(4.5) * 3600
MIN_FLEXION_RAD = radians(2.3)  # flexion of a straight knee, the smallest allowed
BRAKE_RAD_PER_S2 = radians(2.5) * 3600  # rad/s2, deceleration towards the requested flexion
STRAIGHTEST_HALF_LIFE_S = 2.0  # half-life of the flexion of the straightest recent stride
MAX_STRAIGHTEST_RAD = radians(25.0)
# how much straighter than the incoming knee one with a free foot may be, up to the flexion in which feet land; less by a
# ratio of the least flexion, and eased by another
STRAIGHTER_RAD, MAX_LANDING_RAD = radians(6.0), radians(30.0)
LESS_STRAIGHT_RATIO, LEAST_EASE_RATIO = 0.375, 0.67


@dataclass
class Knee:
    """State of one knee: its shown flexion (radians) and speed, and the incoming pose's flexion."""

    flexion: float | None = None
    speed: float = 0.0
    incoming: float = 0.0
    straightest: float = field(default=0.0, metadata={"later": True})  # of the straightest recent stride

    def follow(
        self,
        leg: LegPose,
        hip: Vector,
        target: Vector,
        bones: LegBones,
        dt: float,
        free: bool = False,
        least: float = 0.0,
        level: bool = False,
    ) -> float:
        """Return the hip-ankle distance (metres) of this frame for the requested `target`; `leg` is the incoming leg.

        The knee is bent by at least `least` (radians), and that of a `free` foot at least as far as in the incoming strides.
        Over `level` ground a free foot does not reach down for it: the knee would snap where the foot lands.
        """
        thigh, shin = dist(leg.knee, leg.hip), dist(leg.ankle, leg.knee)
        far, spans = dist(target, hip), dist(leg.ankle, leg.hip)
        wanted = _flexion(soft_reach(far, bones.length, spans), thigh, shin)
        incoming = _flexion(spans, thigh, shin)
        if self.flexion is None:
            self.flexion, self.speed, self.incoming = wanted, 0.0, incoming
            return far
        forgotten = self.straightest + (1.0 - decay(STRAIGHTEST_HALF_LIFE_S)) * (incoming - self.straightest)
        self.straightest = min(incoming, forgotten)
        if free:
            wanted = max(wanted, min(self.straightest, MAX_STRAIGHTEST_RAD))
            if level:
                near = min(incoming, MAX_LANDING_RAD) - STRAIGHTER_RAD + LESS_STRAIGHT_RATIO * least
                wanted = max(wanted, _soft_max(near, least, LEAST_EASE_RATIO * least))
        wanted = max(wanted, least)
        natural = (incoming - self.incoming) / dt
        missing = wanted - (self.flexion + natural * dt)
        speed = natural + copysign(
            min(abs(missing) / dt, sqrt(2.0 * BRAKE_RAD_PER_S2 * abs(missing))), missing
        )
        speed = max(speed, -sqrt(2.0 * BRAKE_RAD_PER_S2 * max(self.flexion - MIN_FLEXION_RAD, 0.0)))
        change = min(max(speed - self.speed, -MAX_FLEXION_RAD_PER_S * dt), MAX_FLEXION_RAD_PER_S * dt)
        self.incoming, self.speed = incoming, self.speed + change
        self.flexion = max(self.flexion + self.speed * dt, 0.0)
        return sqrt(max(thigh * thigh + shin * shin + 2.0 * thigh * shin * cos(self.flexion), MIN_DIVISOR))

    def bend_to(self, leg: LegPose, hip: Vector, ankle: Vector, bones: LegBones, dt: float) -> None:
        """Update the knee's state after the ground has shortened the leg beyond the request."""
        thigh, shin = dist(leg.knee, leg.hip), dist(leg.ankle, leg.knee)
        flexion = _flexion(min(dist(ankle, hip), bones.length), thigh, shin)
        if flexion > (self.flexion or 0.0):
            self.speed += (flexion - (self.flexion or 0.0)) / dt
            self.flexion = flexion


def _soft_max(a: float, b: float, ease: float) -> float:
    """max(a, b), radians, eased where they are alike."""
    return 0.5 * (a + b + sqrt((a - b) * (a - b) + ease * ease))


def _flexion(reach: float, thigh: float, shin: float) -> float:
    """Knee flexion (radians, 0 straight) at which the leg spans `reach`."""
    cosine = (reach * reach - thigh * thigh - shin * shin) / (2.0 * thigh * shin)
    return acos(min(max(cosine, -1.0), 1.0))


TOE_LENGTH_M = 0.06  # m, from the toe joint to the tip
MAX_TIP_RISE_M = 0.055  # how far the tip may be above the joint: about 65 degrees


def bent(toe: Quaternion, foot: Quaternion, joint: Vector, ground: PointHeights, sink: float) -> Quaternion:
    """Return the local rotation of toes bent by the ground, from the network's `toe` and the foot's world rotation.

    `joint` is the toe joint's position. The toes turn about their own lateral axis, because their heading would flip
    when they point straight down.
    """
    world = multiply(foot, toe)
    ahead = rotate(world, (0.0, 0.0, 1.0))
    tip = add_scaled(joint, ahead, TOE_LENGTH_M)
    rise = min(ground.height(tip[0], tip[2]) + TOE_HEIGHT - sink - joint[1], MAX_TIP_RISE_M) / TOE_LENGTH_M
    if ahead[1] >= rise:
        return toe
    # bent by b, the tip is raised by ahead_y cos b + up_y sin b
    up = rotate(world, (0.0, 1.0, 0.0))
    most = hypot(ahead[1], up[1])
    bend = atan2(up[1], ahead[1]) - acos(max(min(rise / max(most, MIN_SIZE), 1.0), -1.0))
    return multiply(toe, (cos(0.5 * bend), -sin(0.5 * bend), 0.0, 0.0))
