"""A jump in the present gait and style: the hips are keyframed, everything else is the network's.

The network continues its gait with its phase slowed, so that the next foot lands as planned. The hips are
pushed up from the standing foot (from both at rest), follow a ballistic arc, and give way at the landing. It
modifies the pose before foot lock, which holds the standing feet.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import dist, e, exp, hypot, sqrt

import numpy as np

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.feet.leg import LegPose, leg_bones, leg_forward, leg_inverse, roll_cosine, rolled
from runtime.feet.settings import SETTINGS
from runtime.pose import DT, Pose
from runtime.scalar_math import (
    MIN_SIZE,
    Quaternion,
    Vector,
    add,
    between,
    damp,
    dot,
    from_vector,
    length,
    multiply,
    rotate,
    scale,
    smoothstep,
    subtract,
    unit,
)
from runtime.skeleton import TOE_HEIGHT
from runtime.terrain.height_map import PointHeights, Terrain
from runtime.traversal.keyframes import bend_trunk, quaternions, swing_arms
from runtime.traversal.planned_steps import PlannedSteps

GRAVITY_M_PER_S2 = 9.81
STAGES = ("", "push", "flight", "land")
BOTH = 2  # both feet push
PUSH_S = 0.25  # from the button to the take-off
FIRST_FRAME_S = 1.5 * DT  # until then a push is in its first frame
WHOLE_PUSH_FRACTION = 1.0 - 1e-6  # of a push: more counts as complete
MAX_NUMBER = 1e4  # m, m/s and s of a jump read from a file
APEX_M = 0.36  # of the hips above their mean height, at the apex
TAKE_OFF_M = 0.09  # the part of it reached at take-off, on tiptoe
LAND_M = 0.06  # hip height above the incoming pose at landing
YIELDS_PER_S = (6.5, 7.0, 7.5)  # 1/s, rates of the spring that gives way: at rest, in a walk, in a jog
MAX_YIELD_M = 0.45  # limit of giving way: a squat, also after a fall from a cliff
LAND_S = 1.0  # until the landing has fully decayed
TIPTOE_M = 0.02  # rise of the hips at which the heel leaves the ground
EXTENDED_S = 0.14  # after the take-off and before the landing, when legs are stretched
FOLD_S = 0.2  # in which the legs fold
PUT_DOWN_HEIGHT_M = 0.25  # height above the ground at which a foot is still put down fully
SET_S = 0.1  # in which a pushing foot is put down
HANG_M, HANG_S = 0.05, 0.3  # height of the pushing foot at landing, and time until it lands
CARRIED_S = 0.3  # in which the network's own speed and height take over
MOVING_SPEED_M_PER_S = 0.3  # slower, both feet push
HOLD_S = 0.1  # for which a landed foot is held
MAX_BEHIND_M = 0.25  # behind the hip; farther back it moves with the body, fully at twice that
MAX_PUSH_BEHIND_M = 0.38  # behind the hip, limit of a pushing foot
STANDING_HEIGHT_M = 0.02  # above the ground: a lower foot stands
AHEAD_M = 0.12  # how far ahead a foot must be before the phase waits for it
UPPER_BODY_HALF_LIFE_S = 0.06
REST_HALF_LIFE_S = 0.3  # seconds, of the mean height
# of a stride since the pushing foot landed, at take-off; jogging
TAKE_OFF_STRIDE_FRACTION = ((0.36, 0.47), (0.25, 0.34))
RUNNING_SPEED_M_PER_S = 1.7  # m/s
# m/s of forward speed at which feet are fully that far apart; from half of it
FULL_STRIDE_SPEED_M_PER_S = 0.6
WAKE_S = 0.1  # before the landing the phase resumes
MAX_RHYTHM_RATIO = 2.0  # of the network's phase rate, before the take-off
SWINGING_RHYTHM_RATIO = 0.7  # of it in flight, until the landing foot is ahead,
FLYING_RHYTHM_RATIO = 0.12  # and afterwards
# change per frame at most: more would bend the elbows' course by 8 degrees
MAX_RHYTHM_CHANGE_RATIO = 0.18
EASE_S = 0.1  # in which a push reaches its rate
PUSH_SPAN_FRACTION = 0.985  # of its length that a pushing leg spans,
YIELD_SPAN_FRACTION = 0.955  # and one that is to give way,
YIELDING_RATE_PER_S, YIELD_S, YIELDED_SPAN_FRACTION = 24.0, 0.12, 0.88  # rate (1/s2), time and final span
TUCK_M = 0.10  # by which feet are drawn up in flight
POINTED_TOES_RAD = 0.5  # toes down in flight
APART_M = (0.3, 0.42)  # distance of the feet ahead of and behind the hips in flight, in a walk and in a jog
JUMP_LEAN_RAD = 0.22  # of the trunk, before and after
# radians that hanging arms swing back before, and up in flight, at rest; half as much when moving
ARM_SWING_RAD = 0.45, 0.9
LEGS = (leg_bones(0), leg_bones(1))
# cosine of an upper arm with the vertical from which it swings, and swings fully
SWING_BACK_FRACTION, LANDS_S = 0.4, 0.15  # of the push; before and after a landing
# fractions of the upward swing before it, and of the return after it
LANDING_SWING_FRACTION, LANDED_SWING_FRACTION = 0.4, 0.3


@dataclass
class Jump:
    """State of one character's jump, from frame to frame."""

    stage: str = field(default="", metadata={"choices": STAGES})
    time: float = 0.0  # s in this stage
    pressed: bool = False  # the button was down in the last frame
    # gait requested while the button was up
    gait: int = field(default=int(Gait.WALK), metadata={"most": max(Gait)})
    foot: int = field(default=BOTH, metadata={"most": BOTH})  # pushing foot: 0 left, 1 right, or both
    rate: float = 1.0  # of the network's phase
    rest: float = 0.95  # mean height of the hips over the ground, m
    hips: float = 0.0  # shown height of the hips, m,
    speed: float = 0.0  # and its speed, m/s
    begin: tuple[float, float] = (0.0, 0.0)  # height and speed of the hips at the start of the stage
    aim: tuple[float, float] = (0.0, 0.0)  # height and speed at the end of the push
    ripe: bool = False  # the foot that will land is as far ahead as it gets
    lead: float = 0.0  # m that the other foot is ahead of the hips, in the network's pose
    spot: tuple[float, float] | None = None  # XZ of the standing toe
    shift: tuple[float, float] = (0.0, 0.0)  # m by which that foot is moved for it
    give: float = YIELDS_PER_S[0]
    over: float = 0.0  # m of the hips above the incoming pose,
    high: float = 0.0  # and above their mean height
    velocity: tuple[float, float] = (0.0, 0.0)  # of the root in flight, XZ, m/s
    swing: float = 0.0  # radians of the arms,
    swing_speed: float = 0.0
    lean: float = 0.0  # and of the trunk
    lean_speed: float = 0.0

    @property
    def is_possible(self) -> bool:
        """Return whether a state read from a file is a valid jump."""
        numbers = (
            self.time,
            self.hips,
            self.speed,
            self.rest,
            self.over,
            self.high,
            *self.begin,
            *self.aim,
            *self.velocity,
        )
        whole = self.gait in list(Gait) and self.foot in (0, 1, BOTH) and 0.0 <= self.rate <= MAX_RHYTHM_RATIO
        return (
            whole and max(map(abs, numbers)) < MAX_NUMBER and (self.stage != "flight" or self.begin[1] > 0.0)
        )

    @property
    def airborne(self) -> bool:
        """Whether the body is in free flight."""
        return self.stage == "flight"

    @property
    def active(self) -> bool:
        """Whether the jump is in progress: pushing off or in flight."""
        return self.stage in ("push", "flight")

    @property
    def pace(self) -> float:
        """Rate of the network's phase in this frame, 1 normally; it eases in during the push."""
        if self.stage != "push":
            return self.rate
        return 1.0 + (self.rate - 1.0) * min(self.time / EASE_S, 1.0)

    def requested_gait(self, gait: Gait) -> Gait:
        """Return the gait requested by the stick; while the jump button is down, the gait before it."""
        return Gait(self.gait) if gait is Gait.JUMP else gait

    def press(self, gait: Gait, free: bool) -> bool:
        """Read the jump button and return whether a jump begins; `free`: no traversal is in progress."""
        down = gait is Gait.JUMP
        begins = down and not self.pressed and free and self.stage in ("", "land")
        self.pressed = down
        if not down:
            self.gait = int(gait)
        return begins

    @staticmethod
    def standing(hips: float, ground: float) -> Jump:
        """Return the jump state of a standing body."""
        return Jump(rest=hips - ground, hips=hips)

    def cancel(self, hips: float) -> None:
        """Cancel the jump because another controller places the hips at `hips` (height, metres)."""
        self.stage, self.rate, self.hips, self.speed, self.over = "", 1.0, hips, 0.0, 0.0
        self.swing = self.swing_speed = self.lean = self.lean_speed = 0.0

    def raise_by(self, height: float) -> None:
        """Shift the jump up by `height` metres because the ground under it changed."""
        self.hips += height
        if self.stage != "land":  # there heights are over the ground
            self.begin = (self.begin[0] + height, self.begin[1])
            self.aim = (self.aim[0] + height, self.aim[1])

    def carried(self, velocity: tuple[float, float]) -> tuple[float, float]:
        """Return the root's velocity (m/s, XZ): that of take-off in flight, blending back to the network's after landing."""
        if self.stage == "flight":
            return self.velocity
        if self.stage == "land":
            own = smoothstep(self.time / CARRIED_S)
            (was_x, was_z), (x, z) = self.velocity, velocity
            return was_x * (1.0 - own) + x * own, was_z * (1.0 - own) + z * own
        return velocity

    def start(self, pose: Pose, steps: PlannedSteps, velocity: tuple[float, float]) -> None:
        """Start a jump from the last `pose` of the stride; `velocity` is the root's (XZ), m/s."""
        self.stage, self.time = "push", 0.0
        self.begin = (self.hips, self.speed)
        self.foot, self.rate, self.ripe, self.spot, self.shift = BOTH, 1.0, False, None, (0.0, 0.0)
        speed = hypot(*velocity)
        if speed > MOVING_SPEED_M_PER_S and steps.stance is not None:
            self.foot = steps.stance
            done = steps.elapsed / steps.seconds
            least, most = TAKE_OFF_STRIDE_FRACTION[speed > RUNNING_SPEED_M_PER_S]
            toe, hip = (pose.positions[LEGS[self.foot].joints[k]].astype(np.float64) for k in (4, 1))
            ahead = ((toe - hip)[[0, 2]] @ np.array(velocity)) / speed
            if speed * PUSH_S - ahead > MAX_PUSH_BEHIND_M:  # the other foot is closer to its landing
                self.foot, done = 1 - self.foot, done - 0.5
            goal = min(max(done + PUSH_S / steps.seconds, least), most)
            self.rate = min(max((goal - done) * steps.seconds / PUSH_S, 0.0), MAX_RHYTHM_RATIO)

    def advance(self, incoming: float, ground: float, root: tuple[float, float]) -> None:
        """Advance the jump by a frame; `incoming` is the hips' height (m), `ground` the height under it, `root` its velocity."""
        before, mean = self.hips, self.rest + ground
        self.time += DT
        if self.stage == "push":
            self._push(mean, root)
        elif self.stage == "flight":
            self._fly(mean)
        elif self.stage == "land":
            back = smoothstep((self.time - HOLD_S) / CARRIED_S)
            self.hips = mean + back * (incoming - mean) + _giving(self.time, self.give, *self.begin)
            if self.time > LAND_S:
                self.stage = ""
        if self.stage == "":
            self.hips = incoming
            self.rest += (incoming - ground - self.rest) * (1.0 - 0.5 ** (DT / REST_HALF_LIFE_S))
        self.speed = (self.hips - before) / DT
        self.over, self.high = self.hips - incoming, self.hips - mean
        self._move_upper()

    def _push(self, mean: float, root: tuple[float, float]) -> None:
        """Move the hips from their height to the take-off; `mean` is their height at rest, m."""
        fraction = min(self.time / PUSH_S, 1.0)
        if self.time <= FIRST_FRAME_S:
            self.aim = (mean + TAKE_OFF_M, sqrt(2.0 * GRAVITY_M_PER_S2 * (APEX_M - TAKE_OFF_M)))
        self.hips = _hermite(fraction, self.begin, self.aim, PUSH_S)
        if fraction >= WHOLE_PUSH_FRACTION:
            self.stage, self.time, self.velocity = "flight", 0.0, root
            self.begin = self.aim

    def _fly(self, mean: float) -> None:
        """Fall freely, with the phase slowed, until the hips are back at `mean` (m)."""
        t = self.time
        self.hips = self.begin[0] + self.begin[1] * t - 0.5 * GRAVITY_M_PER_S2 * t * t
        falls = self.begin[1] - GRAVITY_M_PER_S2 * t
        going = FLYING_RHYTHM_RATIO if self.ripe else SWINGING_RHYTHM_RATIO
        goal = 1.0 if self.foot == BOTH or self._wakes() else going
        self.rate += min(max(goal - self.rate, -MAX_RHYTHM_CHANGE_RATIO), MAX_RHYTHM_CHANGE_RATIO)
        if falls < 0.0 and self.hips < mean + LAND_M:
            self.stage, self.time, self.spot = "land", 0.0, None
            self.begin = (self.hips - mean, falls)
            fast = hypot(*self.velocity) > RUNNING_SPEED_M_PER_S
            self.give = max(YIELDS_PER_S[0 if self.foot == BOTH else 1 + fast], -falls / (e * MAX_YIELD_M))
            self.rate = 1.0

    def pose(
        self, hips: Array, local: Array, contacts: Array, terrain: Terrain
    ) -> tuple[Array, Array, Array]:
        """Return hips `(3,)`, rotations `(31, 4)` and contacts `(4,)` of the jump, from the incoming pose."""
        ground = PointHeights(terrain, float(hips[1]) - SETTINGS.ground_under_hips, float(hips[1]))
        x, y, z = (float(c) for c in hips)
        incoming = quaternions(local)
        mine = list(incoming)
        self._trunk_and_arms(mine)
        place, shown = (x, y + self.over, z), np.array(contacts)
        for side in (0, 1):
            leg, bones = leg_forward(LEGS[side], (x, y, z), incoming), LEGS[side]
            high = leg.toe[1] - TOE_HEIGHT - ground.height(leg.toe[0], leg.toe[2])
            high = min(max(high, 0.0), PUT_DOWN_HEIGHT_M)
            up, contact = self._foot(side, high)
            if contact is not None:
                shown[2 * side : 2 * side + 2] = contact
            if self.active and side == 1 - self.foot:
                self._wait_for(leg)
            ankle, foot = self._placed(side, leg, up, high)
            solved = leg_inverse(leg, ankle, foot, -self.over)
            for joint, rotation in zip(bones.joints[1:4], solved, strict=True):
                mine[joint] = rotation
        return np.array(place), np.array(mine), shown

    def _foot(self, side: int, high: float) -> tuple[float, tuple[float, float] | None]:
        """Return a foot's height (metres) above the incoming one, which is at `high`, and its contacts (heel, toe) if changed."""
        pushes = self.foot in (BOTH, side)
        lands = self.foot in (BOTH, 1 - side)
        if self.stage == "push":
            if pushes:
                down = smoothstep(self.time / SET_S) * high
                return -down, (float(self.over < TIPTOE_M), 1.0)
            return max(self.over, 0.0), (0.0, 0.0)
        if self.stage == "flight":
            extended = (TAKE_OFF_M + high) * (1.0 - smoothstep(self.time / EXTENDED_S)) if pushes else 0.0
            extended -= TUCK_M * self.flies
            extended += smoothstep(1.0 - self._left() / EXTENDED_S) * (
                self.over - self.high + LAND_M + high if lands else -HANG_M
            )
            return self.over - extended, (0.0, 0.0)
        if lands:
            soon = self.time < HOLD_S
            down = (1.0 - smoothstep((self.time - HOLD_S) / HOLD_S)) * high
            return -down, (float(self.over < TIPTOE_M), 1.0) if soon else None
        hangs = 1.0 - smoothstep(self.time / HANG_S)
        return (LAND_M + HANG_M) * hangs, (0.0, 0.0) if hangs > 0.0 else None

    def _wait_for(self, leg: LegPose) -> None:
        """Slow the phase once the foot that will land is as far ahead as it gets."""
        lead = dot(_ahead(leg), subtract(leg.toe, leg.hip))
        self.ripe = self.ripe or AHEAD_M < lead < self.lead
        self.lead = lead
        if self.ripe and self.stage == "push":
            self.rate = max(self.rate - MAX_RHYTHM_CHANGE_RATIO, FLYING_RHYTHM_RATIO)

    def _wakes(self) -> bool:
        """Whether the landing is near."""
        return self.stage == "flight" and self.high > LAND_M and self._left() < WAKE_S

    def _left(self) -> float:
        """Remaining seconds of the flight, over the present ground."""
        high, falls = self.high - LAND_M, self.begin[1] - GRAVITY_M_PER_S2 * self.time
        return (falls + sqrt(max(falls * falls + 2.0 * GRAVITY_M_PER_S2 * high, 0.0))) / GRAVITY_M_PER_S2

    @property
    def flies(self) -> float:
        """Return the flight's weight: 0 on the ground to 1 in the middle of the flight."""
        if self.stage != "flight":
            return 0.0
        return smoothstep(self.time / FOLD_S) * smoothstep(self._left() / FOLD_S)

    def _spans(self) -> float:
        """Return the fraction of its length that a leg may span: bent before landing, then extending as fast as a knee can."""
        if self.stage == "flight":
            return PUSH_SPAN_FRACTION + (YIELD_SPAN_FRACTION - PUSH_SPAN_FRACTION) * smoothstep(
                self.time / FOLD_S
            )
        if self.stage == "land":
            soon = max(YIELD_SPAN_FRACTION - YIELDING_RATE_PER_S * self.time**2, YIELDED_SPAN_FRACTION)
            return soon + (PUSH_SPAN_FRACTION - soon) * smoothstep((self.time - YIELD_S) / YIELD_S)
        return PUSH_SPAN_FRACTION

    def _placed(self, side: int, leg: LegPose, up: float, high: float) -> tuple[Vector, Quaternion]:
        """Ankle and world rotation of a foot `up` metres above the incoming one, rolled over its toe if the leg is too short."""
        bones, flies = LEGS[side], self.flies
        hip = leg.raised(self.over)
        toe = (leg.toe[0], leg.toe[1] + up, leg.toe[2])
        if flies > 0.0 and self.foot != BOTH:
            toe = add(toe, scale(self._apart(side, leg), flies))
        if self.foot != BOTH:
            x, z = self._shifted(side, toe, hip, _ahead(leg), high)
            toe = (toe[0] + x, toe[1], toe[2] + z)
        sole = rotate(leg.foot, bones.offsets[4])
        ankle, foot = subtract(toe, sole), leg.foot
        spans = min(dist(leg.ankle, leg.hip), bones.length)
        own = spans if self.stage == "push" else 0.0
        reach = max(self._spans() * bones.length, own)
        far = dist(ankle, hip)
        if far > reach:
            along = unit(scale(sole, -1.0))
            to_hip = subtract(hip, toe)
            turned = rolled(to_hip, along, roll_cosine(to_hip, bones.foot_length, reach))
            foot = multiply(between(along, turned), foot)
            ankle = add(toe, scale(turned, bones.foot_length))
            away = subtract(ankle, hip)
            ankle = add(hip, scale(away, min(reach / length(away), 1.0)))
        if flies > 0.0:
            right = rotate(leg.base, (1.0, 0.0, 0.0))
            foot = multiply(from_vector(scale(right, POINTED_TOES_RAD * flies)), foot)
        return ankle, foot

    def _shifted(self, side: int, toe: Vector, hip: Vector, way: Vector, high: float) -> tuple[float, float]:
        """Shift (metres, XZ) that keeps a foot where it stands, before and after the flight."""
        pushes = self.stage == "push"
        if side != (self.foot if pushes or self.stage == "flight" else 1 - self.foot):
            return 0.0, 0.0
        if self.stage == "flight":
            left = 1.0 - smoothstep(self.time / FOLD_S)
            return self.shift[0] * left, self.shift[1] * left
        if self.spot is None:
            if pushes and self.time <= SET_S and high >= STANDING_HEIGHT_M:
                return 0.0, 0.0
            self.spot = (toe[0], toe[2])
        held = 1.0 if pushes else self._held(self.spot, hip, way)
        self.shift = (held * (self.spot[0] - toe[0]), held * (self.spot[1] - toe[2]))
        return self.shift

    def _held(self, spot: tuple[float, float], hip: Vector, way: Vector) -> float:
        """Weight with which a foot that landed at `spot` is held there: a body that moves on takes it along."""
        behind = -dot(way, (spot[0] - hip[0], 0.0, spot[1] - hip[2]))
        held = 1.0 - smoothstep((self.time - HOLD_S) / HOLD_S)
        return held * (1.0 - smoothstep((behind - MAX_BEHIND_M) / MAX_BEHIND_M))

    def _apart(self, side: int, leg: LegPose) -> Vector:
        """Shift of a foot in flight: ahead of or behind the hips, as far as the body moves in its facing direction."""
        way = _ahead(leg)
        speed = self.velocity[0] * way[0] + self.velocity[1] * way[2]
        fraction = min(max(2.0 * speed / FULL_STRIDE_SPEED_M_PER_S - 1.0, 0.0), 1.0)
        goal = APART_M[speed > RUNNING_SPEED_M_PER_S] * (-1.0 if side == self.foot else 1.0)
        return scale(way, fraction * (goal - dot(way, subtract(leg.toe, leg.hip))))

    def _trunk_and_arms(self, mine: list[Quaternion]) -> None:
        """Bend the trunk and swing hanging arms, in place."""
        bend_trunk(mine, self.lean, 0.0, -0.5 * self.lean)
        swing_arms(mine, self.swing)

    def _move_upper(self) -> None:
        """Animate trunk and arms: back and down, up in the flight, and forward when the landing gives way."""
        fraction = 1.0 if self.foot == BOTH else 0.5
        back, up = fraction * ARM_SWING_RAD[0], -fraction * ARM_SWING_RAD[1]
        if self.stage == "push":
            swing, lean = (back, JUMP_LEAN_RAD) if self.time < SWING_BACK_FRACTION * PUSH_S else (up, 0.0)
        elif self.stage == "flight":
            swing, lean = (
                (up, 0.0) if self._left() > LANDS_S else (LANDING_SWING_FRACTION * up, JUMP_LEAN_RAD)
            )
        elif self.stage == "land" and self.time < LANDS_S:
            swing, lean = LANDED_SWING_FRACTION * back, JUMP_LEAN_RAD
        else:
            swing, lean = 0.0, 0.0
        self.swing, self.swing_speed = damp(self.swing, self.swing_speed, swing, UPPER_BODY_HALF_LIFE_S, DT)
        self.lean, self.lean_speed = damp(self.lean, self.lean_speed, lean, UPPER_BODY_HALF_LIFE_S, DT)


def _ahead(leg: LegPose) -> Vector:
    """The level direction in which a leg's hip faces."""
    x, _, z = rotate(leg.base, (0.0, 0.0, 1.0))
    size = max(sqrt(x * x + z * z), MIN_SIZE)
    return x / size, 0.0, z / size


def _hermite(fraction: float, begin: tuple[float, float], end: tuple[float, float], seconds: float) -> float:
    """Hermite interpolation at `fraction` of `seconds`, between heights and speeds at both ends."""
    s, v = fraction, 1.0 - fraction
    a, b = (1.0 + 2.0 * s) * v * v, s * s * (3.0 - 2.0 * s)
    return a * begin[0] + b * end[0] + seconds * (s * v * v * begin[1] - s * s * v * end[1])


def _giving(t: float, rate: float, over: float, speed: float) -> float:
    """Height above the incoming pose `t` seconds after landing at `over` with `speed`: a damped spring of that rate (1/s)."""
    return (over + (speed + rate * over) * t) * exp(-rate * t)
