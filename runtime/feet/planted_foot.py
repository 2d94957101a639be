"""One foot of the foot lock: its held point, its target, and its clearance in swing."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import atan2, cos, dist, pi, sin, sqrt

from runtime.arrays import Array
from runtime.feet.leg import LegBones, LegPose, leg_bones, roll_cosine, rolled
from runtime.feet.next_step import HEEL_M, NextStep, SteppedOver, has_edges
from runtime.feet.reach import depth_in_ground, span
from runtime.feet.settings import SETTINGS
from runtime.scalar_math import (
    MIN_DIVISOR,
    MIN_SIZE,
    Quaternion,
    Vector,
    add,
    between,
    damp,
    damp_vector,
    from_vector,
    inverse,
    length,
    multiply,
    rotate,
    scale,
    subtract,
    to_vector,
    unit,
)
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from runtime.terrain.height_map import PointHeights

ANCHORS = ("", "heel", "toe")
NOWHERE: Vector = (0.0, 0.0, 0.0)
LEGS = (leg_bones(0), leg_bones(1))
LANDING_HEIGHT_M = 0.1  # foot height over the ground from which a foot near a bar is still landing
MAX_STRAIN_BESIDE_STEP = 1.5  # limit of the strain while the other foot makes a small step
MIN_LEVEL_FOOT_M = 0.04  # ankle to toe seen from above: a shorter distance has no heading
SOLE_REACH_M = 0.07  # from the middle of the sole to the points where the ground's slope is read
MIN_EDGE_AHEAD_M = 0.03  # height over a standing foot from which steep ground ahead is an edge
SEEN_AHEAD_FRACTIONS = (1.0, 0.75, 0.5, 0.25)  # of `look_ahead`: where the ground is sampled
HEEL_STRIKE_FRACTION = 0.3  # of the height ahead that the ankle clears in a heel strike
FALLING_FRACTION = 0.25  # of `look_ahead`: time for which the foot's vertical speed is extrapolated
CONTACT_HYSTERESIS_RATIO = 1.5  # factor on the thresholds of a point that was in contact


@dataclass
class PlantedFoot:
    """State of one planted foot; the offset is the outgoing minus the incoming toe joint."""

    side: int  # 0 left, 1 right
    anchor: str = field(default="", metadata={"choices": ANCHORS})  # the point that is held
    point: tuple[float, float] = (0.0, 0.0)  # x, z of the held point
    lowest: float = 0.0  # lowest height of the incoming point while it is held
    refractory: float = 0.0  # s until it may be held again
    offset: Vector = NOWHERE
    offset_velocity: Vector = NOWHERE
    yaw: float = 0.0
    yaw_velocity: float = 0.0
    held_yaw: float | None = None
    twisted: bool = False  # the body has turned away over a held heel
    tilt: Vector = NOWHERE  # rotation vector that lays the sole on the ground
    tilt_velocity: Vector = NOWHERE
    incoming: tuple[Vector, Vector] | None = None  # toe and ankle of the previous frame
    toe: Vector = NOWHERE  # outgoing
    ankle: Vector = NOWHERE
    rotation: Quaternion = (1.0, 0.0, 0.0, 0.0)
    velocity: Vector = NOWHERE  # of the incoming toe
    rise: tuple[float, float] = (0.0, 0.0)  # m/s of the outgoing toe and ankle
    toe_down: bool = False
    heel_down: bool = False
    heights: tuple[float, float] = (0.0, 0.0)  # incoming toe and ankle over their resting heights
    moved: float = 0.0  # m that the outgoing toe moved along the ground in the last frame
    climb: float = 0.0  # m/s, vertical speed of the incoming toe relative to the ground
    chances: tuple[float, float] = (0.0, 0.0)  # contact probabilities of toe and heel
    next_step: NextStep = field(default_factory=NextStep, metadata={"later": True})

    @property
    def bones(self) -> LegBones:
        """The bones of the foot's leg."""
        return LEGS[self.side]

    def observe(self, leg: LegPose, heel: float, toe: float, ground: PointHeights, dt: float) -> None:
        """Update velocities, heights over rest and contacts from the incoming foot."""
        if self.incoming is None:
            self.incoming = (leg.toe, leg.ankle)
            self.toe, self.ankle = leg.toe, leg.ankle
        self.velocity = scale(subtract(leg.toe, self.incoming[0]), 1.0 / dt)
        ankle_velocity = scale(subtract(leg.ankle, self.incoming[1]), 1.0 / dt)
        self.incoming = (leg.toe, leg.ankle)
        self.refractory = max(0.0, self.refractory - dt)
        before = self.heights[0]
        self.heights = (
            leg.toe[1] - ground.height(leg.toe[0], leg.toe[2]) - TOE_HEIGHT,
            leg.ankle[1] - ground.height(leg.ankle[0], leg.ankle[2]) - ANKLE_HEIGHT,
        )
        self.climb = (self.heights[0] - before) / dt
        self.chances = (toe, heel)
        self.toe_down = self._in_contact(self.toe_down, toe, self.heights[0], self.velocity)
        self.heel_down = self._in_contact(self.heel_down, heel, self.heights[1], ankle_velocity)

    def adopt(self, shown: LegPose, leg: LegPose) -> None:
        """Start from the leg as it was `shown` instead of the incoming `leg`."""
        self.incoming = (leg.toe, leg.ankle)
        self.toe, self.ankle, self.rotation = shown.toe, shown.ankle, shown.foot
        self.offset = subtract(shown.toe, leg.toe)
        self.tilt = to_vector(multiply(shown.foot, inverse(leg.foot)))

    def _in_contact(self, was: bool, chance: float, height: float, velocity: Vector) -> bool:
        s = SETTINGS
        speed = sqrt(velocity[0] * velocity[0] + velocity[2] * velocity[2])
        slack = CONTACT_HYSTERESIS_RATIO if was else 1.0
        if length(velocity) < slack * s.still_speed and height < slack * s.still_height:
            return True
        if was:
            return chance > s.contact_off and speed < slack * s.lock_speed
        return chance > s.contact_on and speed < s.lock_speed and height < s.lock_height

    def choose_anchor(
        self,
        leg: LegPose,
        drop: float,
        other_steps: bool,
        patience: float = 1.0,
        over: bool = False,
        last: bool = False,
    ) -> None:
        """Hold, keep or release the anchor point; the toe has priority over the heel, so that the foot rolls over it.

        A foot that is `over` an obstacle lands first. The `last` foot on the ground in a walk is held until the other lands.
        """
        anchor = self._point_down(last)
        if self.refractory > 0.0 or not anchor or (over and not self.anchor):
            self.anchor = ""
            return
        k = ("toe", "heel").index(anchor)
        rise = self.heights[k]
        if anchor != self.anchor:
            joint = (self.toe, self.ankle)[k]
            self.point, self.lowest = (joint[0], joint[2]), rise
        self.anchor, self.lowest = anchor, min(self.lowest, rise)
        most_strain = SETTINGS.last_patience if last else MAX_STRAIN_BESIDE_STEP if other_steps else 1.0
        if rise > self.lowest + self._may_rise(k, last):
            self.anchor, self.toe_down, self.heel_down = "", False, False
        elif self._strained((leg.toe, leg.ankle)[k], leg.raised(-drop), patience, most_strain):
            self.anchor, self.refractory = "", SETTINGS.refractory

    def _point_down(self, last: bool) -> str:
        """The point that can hold the foot, or ""; the `last` foot on the ground keeps its present one."""
        if self.toe_down or self.heel_down:
            return "toe" if self.toe_down else "heel"
        return self.anchor if last else ""

    def _may_rise(self, k: int, last: bool) -> float:
        """Metres that the held toe (0) or heel (1) may rise above its lowest height."""
        sure = last or self.chances[k] > SETTINGS.contact_on
        return SETTINGS.release_rise_sure if sure else SETTINGS.release_rise

    def _strained(self, incoming: Vector, hip: Vector, patience: float, most: float) -> bool:
        """Whether the held point, now at `incoming`, must be released because it is strained or because of the leg's posture."""
        s = SETTINGS
        away = sqrt((incoming[0] - self.point[0]) ** 2 + (incoming[2] - self.point[1]) ** 2)
        stretch = dist(self.ankle, hip) - self.bones.length
        overstrained = max(away / (patience * s.release_offset), stretch / s.release_stretch) > most
        hip_low = self.ankle[1] > hip[1] - s.release_under
        return self.twisted or overstrained or self.next_step.caught or hip_low

    def is_over(self, over: SteppedOver | None, ground: PointHeights) -> bool:
        """Return whether the shown foot is still passing over an obstacle: high above the ground, or beyond its far edge."""
        if over is None or over.length < 0.0:
            return False
        ankle, toe = over.along(self.ankle[0], self.ankle[2]), over.along(self.toe[0], self.toe[2])
        edge = (
            0.0 if over.top > 0.0 else over.length
        )  # no foot stands on a bar, nor half over the far edge of a gap
        hangs = ankle < over.length + 0.5 * HEEL_M and toe > edge
        high = self.toe[1] - ground.height(self.toe[0], self.toe[2]) > TOE_HEIGHT + LANDING_HEIGHT_M
        return hangs or high

    def plant(
        self, leg: LegPose, drop: float, ground: PointHeights, dt: float, patience: float = 1.0
    ) -> None:
        """Compute the outgoing toe, ankle and foot rotation; the more `patience`, the slower a sole is laid flat."""
        before, (toe_x, _, toe_z) = (self.toe[1], self.ankle[1]), self.toe
        tilt = self.tilt
        self._turn(leg, ground, dt, patience)
        turned = self.rotation
        sole = rotate(self.rotation, self.bones.offsets[4])
        if self.anchor == "toe":
            y = self._settle(
                self.toe[1], self.rise[0], self._support(ground) + TOE_HEIGHT, leg.toe[1] - drop, dt
            )
            self.toe = (self.point[0], y, self.point[1])
            self.ankle = subtract(self.toe, sole)
            self._roll(leg)
        elif self.anchor == "heel":
            y = self._settle(
                self.ankle[1],
                self.rise[1],
                ground.height(*self.point) + ANKLE_HEIGHT,
                leg.ankle[1] - drop,
                dt,
            )
            self.ankle = (self.point[0], y, self.point[1])
            self.toe = add(self.ankle, sole)
        else:
            last = self.offset
            self._fade_offset((0.0, self._lift(leg, drop, ground), 0.0), dt)
            self.toe = self._lifted_first(add(leg.toe, self.offset), leg, ground, dt)
            x, _, z = scale(subtract(subtract(self.toe, leg.toe), last), 1.0 / dt)
            self.offset_velocity = (x, self.offset_velocity[1], z)
            self.ankle = subtract(self.toe, sole)
        self._clear(ground)
        if (
            self.rotation != turned
        ):  # rolling and clearing are part of the tilt, so that it fades when they end
            self.tilt = to_vector(multiply(self.rotation, multiply(inverse(turned), from_vector(self.tilt))))
            self.tilt_velocity = scale(subtract(self.tilt, tilt), 1.0 / dt)
        self.moved = sqrt((self.toe[0] - toe_x) ** 2 + (self.toe[2] - toe_z) ** 2)
        self.rise = ((self.toe[1] - before[0]) / dt, (self.ankle[1] - before[1]) / dt)
        offset = subtract(self.toe, leg.toe)
        if self.anchor:
            self.offset_velocity = scale(subtract(offset, self.offset), 1.0 / dt)
        self.offset = offset

    def _lifted_first(self, target: Vector, leg: LegPose, ground: PointHeights, dt: float) -> Vector:
        """Position of a free toe on its way to `target`: it lifts before it travels, and stops before it lands."""
        s = SETTINGS
        height = min(joint[1] - ground.height(joint[0], joint[2]) for joint in (self.toe, target))
        fraction = max(0.0, height - TOE_HEIGHT) / s.travel_height
        x, z = target[0] - self.toe[0], target[2] - self.toe[2]
        if fraction >= 1.0:
            if not has_edges(ground):
                return target
            # a toe that an edge held up catches up with increasing speed
            fastest = self.moved / dt + s.catch_up * dt
            part = min(1.0, fastest * dt / max(sqrt(x * x + z * z), MIN_DIVISOR))
            return (self.toe[0] + part * x, target[1], self.toe[2] + part * z)
        behind = sqrt((leg.toe[0] - self.toe[0]) ** 2 + (leg.toe[2] - self.toe[2]) ** 2)
        fastest = s.travel_near + s.travel_rise * fraction * fraction / (1.0 - fraction)
        fastest = max(fastest, (behind - s.max_behind) / s.behind_seconds)
        part = min(fastest * dt / max(sqrt(x * x + z * z), MIN_DIVISOR), 1.0)
        there = (self.toe[0] + part * x, target[1], self.toe[2] + part * z)
        if has_edges(ground) and ground.height(there[0], there[2]) + TOE_HEIGHT - target[1] > s.still_height:
            return (self.toe[0], target[1], self.toe[2])  # it waits before a riser that it does not clear yet
        return target if part >= 1.0 else there

    def _roll(self, leg: LegPose) -> None:
        """Roll a trailing foot over its held toe until the leg spans the incoming distance, as in human walking."""
        to_hip, to_ankle = subtract(leg.hip, self.toe), subtract(self.ankle, self.toe)
        foot = self.bones.foot_length
        lack = dist(self.ankle, leg.hip) - span(leg)
        ahead = (to_hip[0] * -to_ankle[0] + to_hip[2] * -to_ankle[2]) / foot + foot
        fraction = min(max((ahead - SETTINGS.trailing) / SETTINGS.trailing, 0.0), 1.0)
        if lack == 0.0 or fraction == 0.0:
            return
        # an incoming leg deep in the ground would roll the ankle above the hip
        beyond = max(-lack - SETTINGS.rolls_away, 0.0)
        wanted = span(leg) + (1.0 - fraction) * lack - fraction * beyond
        along = unit(to_ankle)
        turned = rolled(to_hip, along, roll_cosine(to_hip, foot, wanted))
        self.rotation = multiply(between(along, turned), self.rotation)
        self.ankle = add(self.toe, scale(turned, foot))

    def _settle(self, y: float, velocity: float, ground: float, incoming: float, dt: float) -> float:
        """Height of a held point, eased to the ground or to an unnoticeable distance of the incoming point from it."""
        s = SETTINGS
        rest = min(max(incoming, ground - s.unseen), ground + s.unseen)
        return damp(y, velocity, rest, s.settle_half_life + s.settle_slower * abs(y - rest), dt)[0]

    def _turn(self, leg: LegPose, ground: PointHeights, dt: float, patience: float) -> None:
        """Rotation of the foot: the incoming one, with its heading held and its sole flat while the whole sole is down."""
        s = SETTINGS
        ahead = rotate(leg.foot, self.bones.offsets[4])
        level = sqrt(ahead[0] * ahead[0] + ahead[2] * ahead[2]) > MIN_LEVEL_FOOT_M
        heading = atan2(ahead[0], ahead[2])
        whole = level and self._whole_sole_down(ahead)
        near = self.toe[1] - ground.height(self.toe[0], self.toe[2]) - TOE_HEIGHT < s.travel_height
        if whole or (self.anchor == "heel" and near and level):  # nearly landed toes would sweep
            self._hold_heading(heading, dt)
        else:
            self.held_yaw, self.twisted = None, False
            self.yaw, self.yaw_velocity = damp(self.yaw, self.yaw_velocity, 0.0, s.yaw_half_life, dt)
        rotation = multiply(_from_yaw(self.yaw), leg.foot)
        goal: Vector = (0.0, 0.0, 0.0)
        if whole:
            slope = between((0.0, 1.0, 0.0), self._normal(ground))
            lying = multiply(slope, _from_yaw(heading + self.yaw))
            goal = to_vector(multiply(lying, inverse(rotation)))
        # a heel that sinks under a standing body would jerk its knee
        half_life = s.flat_half_life * (1.0 + s.flat_slower * (patience - 1.0))
        self.tilt, self.tilt_velocity = damp_vector(self.tilt, self.tilt_velocity, goal, half_life, dt)
        self.rotation = multiply(from_vector(self.tilt), rotation)

    def _whole_sole_down(self, ahead: Vector) -> bool:
        """Whether toe and heel of a held foot are both down, not on tiptoe; `ahead` (m) is the vector from ankle to toe."""
        heel_over_toe = -ahead[1] - (ANKLE_HEIGHT - TOE_HEIGHT)  # on level ground
        tiptoe = min(self.heights[1] - self.heights[0], heel_over_toe) > SETTINGS.still_height
        return bool(self.anchor) and self.toe_down and self.heel_down and not tiptoe

    def _hold_heading(self, heading: float, dt: float) -> None:
        """Turn the foot from its incoming `heading` towards the one at its landing, within the leg's range of rotation."""
        if self.held_yaw is None:
            self.held_yaw = heading + self.yaw
        turn = (self.held_yaw - heading + pi) % (2.0 * pi) - pi
        self.twisted = self.anchor == "heel" and abs(turn) > SETTINGS.max_yaw
        turn = min(max(turn, -SETTINGS.max_yaw), SETTINGS.max_yaw)
        self.yaw, self.yaw_velocity = turn, (turn - self.yaw) / dt

    def _normal(self, ground: PointHeights) -> Vector:
        """Upward normal of the ground under the sole; straight up where the sole lies over an edge."""
        x, z, reach = 0.5 * (self.toe[0] + self.ankle[0]), 0.5 * (self.toe[2] + self.ankle[2]), SOLE_REACH_M
        dx = (ground.height(x + reach, z) - ground.height(x - reach, z)) / (2.0 * reach)
        dz = (ground.height(x, z + reach) - ground.height(x, z - reach)) / (2.0 * reach)
        steep = sqrt(dx * dx + dz * dz) > SETTINGS.edge_slope
        return (0.0, 1.0, 0.0) if steep else unit((-dx, 1.0, -dz))

    def _support(self, ground: PointHeights) -> float:
        """Height of the ground that carries a held toe: under the heel when the toe hangs over an edge."""
        under = ground.height(*self.point)
        if not self.heel_down:
            return under
        heel = ground.height(self.ankle[0], self.ankle[2])
        over_edge = heel - under > SETTINGS.edge_slope * self.bones.foot_length
        return heel if over_edge else under

    def _lift(self, leg: LegPose, drop: float, ground: PointHeights) -> float:
        """Metres that the swinging foot must rise above its incoming height: ground below, edges ahead; `drop` is the hips'."""
        s = SETTINGS
        lift = s.refractory_lift if self.refractory > 0.0 else 0.0
        vx, vy, vz = self.velocity
        speed = sqrt(vx * vx + vz * vz)
        moving = min(1.0, speed / s.swing_speed)
        travels, toe_clears = self._toe_travels(speed)
        incoming = (leg.toe[1] - TOE_HEIGHT, leg.ankle[1] - ANKLE_HEIGHT)
        if has_edges(ground):
            points = ((self.toe, incoming[0]), (self.ankle, incoming[1]))
            lift = max(lift, self.next_step.lift(points, ground))
        heel_strikes = leg.toe[1] - leg.ankle[1] > TOE_HEIGHT - ANKLE_HEIGHT
        # for edges ahead a foot rises only as far as the knee can fold: higher, the knee would flip
        room, under = max(leg.hip[1] - drop - s.folded - leg.ankle[1], 0.0), 0.0
        for joint, rest, chance in zip((self.toe, self.ankle), incoming, self.chances, strict=True):
            below = ahead = ground.height(joint[0], joint[2])
            for fraction in SEEN_AHEAD_FRACTIONS:
                time = fraction * s.look_ahead
                ahead = ground.height(joint[0] + time * vx, joint[2] + time * vz)
                if ahead - below > MIN_EDGE_AHEAD_M + s.edge_slope * time * speed:
                    lift = max(lift, ahead + s.clearance - rest)
            # a swinging foot slows down before it lands, and does not drag over the ground
            free, clear = 1.0 - chance, moving * moving * s.swing_clearance
            if joint is self.toe:
                free, clear = max(free, travels), toe_clears
            soon = max(0.0, ahead - below - FALLING_FRACTION * s.look_ahead * vy) + clear
            if joint is self.ankle and heel_strikes:
                soon = HEEL_STRIKE_FRACTION * soon
            depth = below - s.sink - rest + free * soon
            lift = max(lift, _soft_positive(depth, free * s.soft_floor))
            under = max(under, below - s.sink - rest)
        return max(min(lift, room), under)

    def _toe_travels(self, speed: float) -> tuple[float, float]:
        """Weight (0..1) of the shown toe travelling, and its clearance in metres; `speed` is the incoming toe's.

        A steep path needs no clearance: the toe travels little while it is near the ground.
        """
        s = SETTINGS
        catching_up = sqrt(self.offset[0] ** 2 + self.offset[2] ** 2) / s.catch_up_seconds
        travels = min(1.0, max(speed, catching_up) / s.travel_speed)
        shallow = 2.0 - abs(self.climb) / (s.shallow * max(speed, MIN_SIZE))
        under = -self.heights[0] / s.travel_height
        return travels, travels * travels * min(max(shallow, under, 0.0), 1.0) * s.travel_clearance

    def _fade_offset(self, goal: Vector, dt: float) -> None:
        s = SETTINGS
        vertical = s.rise_half_life if goal[1] > self.offset[1] else s.fall_half_life
        vertical += s.far_slower * max(abs(goal[1] - self.offset[1]) - s.far, 0.0)
        y, velocity_y = damp(self.offset[1], self.offset_velocity[1], goal[1], vertical, dt)
        (x, _, z), (velocity_x, _, velocity_z) = damp_vector(
            self.offset, self.offset_velocity, goal, s.release_half_life, dt
        )
        self.offset, self.offset_velocity = (x, y, z), (velocity_x, velocity_y, velocity_z)

    def _clear(self, ground: PointHeights) -> None:
        """Raise toe and ankle out of the ground; the foot turns so that it keeps its length."""
        s = SETTINGS
        toe_floor = ground.height(self.toe[0], self.toe[2]) + TOE_HEIGHT - s.sink
        ankle_floor = ground.height(self.ankle[0], self.ankle[2]) + ANKLE_HEIGHT - s.sink
        if self.toe[1] >= toe_floor and self.ankle[1] >= ankle_floor:
            return
        toe = (self.toe[0], max(self.toe[1], toe_floor), self.toe[2])
        ankle = (self.ankle[0], max(self.ankle[1], ankle_floor), self.ankle[2])
        before = unit(subtract(self.toe, self.ankle))
        after = unit(subtract(toe, ankle))
        self.rotation = multiply(between(before, after), self.rotation)
        sole = scale(after, self.bones.foot_length)
        if self.anchor == "heel":
            toe = add(ankle, sole)
        else:
            ankle = subtract(toe, sole)
        # the rotation moved one end sideways, perhaps over an edge: lift the whole foot by the remaining depth
        missing = max(0.0, depth_in_ground(toe, ankle, ground))
        self.toe = (toe[0], toe[1] + missing, toe[2])
        self.ankle = (ankle[0], ankle[1] + missing, ankle[2])

    def knee_out(self, leg: LegPose, hip: Vector, local: Array, ground: PointHeights, dt: float) -> float:
        """Return how far (radians) the knee turns outwards to clear the ground.

        `local` are the rotations of thigh, shin and foot relative to the base of `leg`.
        """
        upper, lower, _ = local.tolist()
        thigh = multiply(leg.base, upper)
        shin = multiply(thigh, lower)
        knee = add(hip, rotate(thigh, self.bones.offsets[2]))
        solved = leg._replace(
            hip=hip, knee=knee, ankle=add(knee, rotate(shin, self.bones.offsets[3])), thigh=thigh, shin=shin
        )
        out = self.next_step.knee_out(solved, self.side, ground, dt)
        straightest = SETTINGS.straightest * (self.bones.length + self.bones.foot_length)
        self.next_step.caught |= dist(self.toe, hip) > straightest
        return out


def _soft_positive(x: float, width: float) -> float:
    """max(x, 0), smoothed within +- `width`."""
    if abs(x) >= width:
        return max(x, 0.0)
    return (x + width) * (x + width) / (4.0 * width)


def _from_yaw(yaw: float) -> Quaternion:
    return cos(0.5 * yaw), 0.0, sin(0.5 * yaw), 0.0
