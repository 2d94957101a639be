"""Prediction of each foot's next step on ground with edges: its landing, the clearance until then, and evasive knee motion.

A step is assumed to be as long, and to take as long, as the last one of the same foot. Obstacles in between are known
early, so that a foot is lifted in time over a bar, and shifted when it would land on a bar or in a gap.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, pi, sin, sqrt

from runtime.feet.leg import LegPose, turned_out
from runtime.scalar_math import MIN_SIZE, Vector, add, damp, scale, smoothstep
from runtime.skeleton import ANKLE_HEIGHT
from runtime.terrain.height_map import PointHeights

RISE_M, RUN_M = 0.08, 0.1  # ground that rises by this much within this distance has edges
HIP_VELOCITY_FRACTION = 0.08  # weight of one frame in the mean velocity of the hip
MIN_HIP_SPEED_M_PER_S = 0.25  # slower hips predict no step
MIN_STEP_S, MAX_STEP_S, MIN_LANDING_S = 0.2, 1.5, 0.04  # time between two landings; until the next one
STEP_RANGE_M = 0.1, 2.5  # range of step length
STEP_RATIO_RANGE = 0.6, 1.6  # range of the change in step length with speed
RAISED_BEFORE_S, RISING_BEFORE_S = 0.18, 0.42  # time before an edge when a foot is raised, and begins to rise
SPACING_M = 0.04
CLEARANCE_M, EDGE_M = 0.05, 0.08  # between sole and edge, over it and before and behind it
MIN_EDGE_M, MIN_EDGE_SLOPE = 0.03, 0.7  # minimum height over a standing foot, and rise over run, of an edge
# ankle to the near edge of a bar or gap, and to its far edge, for a foot that stands clear of both
TOE_M, HEEL_M = 0.19, 0.1
MAX_LEAD_M = 0.4  # shift of a foot along its path
LEAD_HYSTERESIS_M = 0.1  # hysteresis: with a larger difference the shift keeps its direction
LED_HALF_LIFE_S = 0.06
MIN_LED_M, MIN_OUT_RAD = 1e-4, 1e-3  # smallest shift of a foot and rotation of a knee that are applied
MIN_IMPROVEMENT_M = 1e-3  # smallest improvement in depth for which a knee turns farther out
UNREACHED_DEPTH_M = 1e9  # deeper than any ground
LOW_BAR_M, MAX_HIPS_RISE_M = 0.33, 0.27  # over a higher bar the hips rise in flight, by at most this
RISE_WIDTH_M = 0.8  # before and behind the bar
TOUCH_M = 0.01  # depth of a held leg in a bar's clearance beyond which its foot is released
OVER_MARGIN_M = 0.1  # before and behind the bar, where the root counts as over it
KNEE_OUT_RAD = (0.0, 0.3, 0.6, 0.9, 1.2)  # outward rotations of a knee that are tried, radians
OUT_HALF_LIFE_S = 0.05
LIMB_M = 0.07  # half thickness of thigh and shin
SHIN_TIMES_S = (0.0, 0.08, 0.16, 0.24, 0.32)  # times ahead at which a shin is checked against a bar
THIGH_FRACTIONS, SHIN_FRACTIONS = (0.6, 0.8), (0.25, 0.5, 0.75)  # points along the bones that are checked
AHEAD_M = (0.0, 0.07, 0.14, 0.21)  # distances ahead at which a knee is checked


def has_edges(ground: PointHeights) -> bool:
    """Return whether this ground anywhere rises as steeply as a bar or a step."""
    return ground.steepest * RUN_M > RISE_M


@dataclass
class SteppedOver:
    """A bar or gap that the gait itself steps over: its near edge and the direction across it."""

    x: float = 0.0  # of the near edge, m
    z: float = 0.0
    yaw: float = 0.0  # direction across it
    length: float = -1.0  # from the near edge to the far one, m; negative if there is no obstacle
    ground: float = 0.0  # height before it, m
    rise: float = 0.0  # of the ground behind it
    top: float = 0.0  # height of a bar above the ground before it
    crossing: bool = False  # the foot that lands next crosses it

    def along(self, x: float, z: float) -> float:
        """Return how far (metres) a position is past the near edge."""
        return (x - self.x) * sin(self.yaw) + (z - self.z) * cos(self.yaw)

    def is_under(self, x: float, z: float) -> bool:
        """Return whether a root at this position is over the bar or gap, where its far side would look like a step."""
        return self.length >= 0.0 and -OVER_MARGIN_M < self.along(x, z) < self.length + OVER_MARGIN_M

    def hips_rise(self, hips: Vector) -> float:
        """Return how far (metres) the hips rise at this position to step over a high bar."""
        high = min(self.top - LOW_BAR_M, MAX_HIPS_RISE_M)
        if self.length < 0.0 or high <= 0.0:
            return 0.0
        away = abs(self.along(hips[0], hips[2]) - 0.5 * self.length) / RISE_WIDTH_M
        return high * cos(0.5 * pi * away) ** 2 if away < 1.0 else 0.0


@dataclass
class NextStep:
    """State of one foot's steps, carried from frame to frame."""

    hip_x: float = 0.0  # position of the hip in the last frame, m
    hip_z: float = 0.0
    way_x: float = 0.0  # its smoothed velocity, m/s
    way_z: float = 0.0
    watched: bool = False
    held: bool = False  # held in the last frame
    stood: bool = False  # stood in the last frame, held or not
    landed_x: float = 0.0  # where its ankle landed last, m, before any shift
    landed_z: float = 0.0
    since: float = 9.0  # seconds since that landing
    step: float = 0.6  # length of the last step from the other foot's landing, m
    step_seconds: float = 0.5  # and its duration, s
    step_speed: float = 1.2  # and the hip's speed in it, m/s
    metres: float = 0.0  # metres to the next landing, and seconds; 0 if unknown
    seconds: float = 0.0
    second: bool = False  # it lands after the other foot
    goal: float = 0.0  # requested shift along the path, m
    led: float = 0.0  # current shift, m
    led_velocity: float = 0.0
    out: float = 0.0  # outward rotation of its knee, radians
    out_velocity: float = 0.0
    over: SteppedOver = field(default_factory=SteppedOver)  # the obstacle it steps over
    knee: Vector = (0.0, 0.0, 0.0)  # the shown knee
    caught: bool = False  # thigh or shin hits the ground for every knee rotation, or soon a bar

    @property
    def speed(self) -> float:
        """Horizontal speed of the hip, m/s."""
        return sqrt(self.way_x * self.way_x + self.way_z * self.way_z)

    def watch(
        self, leg: LegPose, other: NextStep, held: bool, down: bool, velocity: Vector, dt: float
    ) -> None:
        """Update from the incoming leg: the velocity of its hip and the landings of its foot; `down` if the foot has landed."""
        self._follow_hip(leg.hip, dt)
        ankle_x, _, ankle_z = leg.ankle
        stands = held or down
        came = stands and not self.stood and self.since > MIN_STEP_S
        self.held, self.stood, self.metres, self.seconds = held, stands, 0.0, 0.0
        self.since += dt
        speed = self.speed
        way = self.way_x / max(speed, MIN_SIZE), self.way_z / max(speed, MIN_SIZE)
        steps = speed > MIN_HIP_SPEED_M_PER_S and other.since < MAX_STEP_S
        step = (ankle_x - other.landed_x) * way[0] + (ankle_z - other.landed_z) * way[1]
        if came:
            if steps and STEP_RANGE_M[0] < step < STEP_RANGE_M[1]:
                self.step, self.step_seconds, self.step_speed = step, other.since, speed
            self.landed_x, self.landed_z, self.since = ankle_x, ankle_z, 0.0
        elif steps and not held:
            mine = (ankle_x - self.landed_x) * way[0] + (ankle_z - self.landed_z) * way[1]
            metres = self._expect(other, step, mine, velocity[0] * way[0] + velocity[2] * way[1])
            self.metres = 0.0 if down else max(metres, 0.0)

    def _follow_hip(self, hip: Vector, dt: float) -> None:
        """Smooth the velocity of the hip."""
        if self.watched:
            self.way_x += ((hip[0] - self.hip_x) / dt - self.way_x) * HIP_VELOCITY_FRACTION
            self.way_z += ((hip[2] - self.hip_z) / dt - self.way_z) * HIP_VELOCITY_FRACTION
        self.hip_x, _, self.hip_z = hip
        self.watched = True

    def _expect(self, other: NextStep, step: float, mine: float, pace: float) -> float:
        """Metres to the landing of a free foot; also stores the time until then.

        The landing is `step` metres past the other foot's last one, `mine` past its own, at `pace` (m/s).
        """
        self.second = self.since < other.since
        faster = min(max(self.speed / self.step_speed, STEP_RATIO_RANGE[0]), STEP_RATIO_RANGE[1])
        if self.second:
            metres = (self.step + other.step) * faster - mine
            seconds = self.step_seconds + other.step_seconds - self.since
        else:
            metres, seconds = self.step * faster - step, self.step_seconds - other.since
        self.seconds = max(seconds, MIN_LANDING_S)
        if self.seconds < 0.5 * self.step_seconds:  # a foot that slows down before landing comes no farther
            metres = min(metres, max(pace, 0.0) * self.seconds)
        return metres

    def lead(self, leg: LegPose, over: SteppedOver | None, held: bool, dt: float) -> LegPose:
        """Return the leg shifted so that it lands before or behind the obstacle `over`; a held foot keeps its shift."""
        self.over = over or SteppedOver()
        if not held:
            if self.over.length < 0.0:
                self.goal = 0.0
            elif self.seconds > 0.0:
                self.goal = self._lead_to(leg, self.over)
            self.led, self.led_velocity = damp(self.led, self.led_velocity, self.goal, LED_HALF_LIFE_S, dt)
            if self.goal == 0.0 and abs(self.led) < MIN_LED_M:
                self.led = self.led_velocity = 0.0
        else:
            self.goal = self.led_velocity = 0.0
        speed = self.speed
        if self.led == 0.0 or speed == 0.0:
            return leg
        by = (self.led * self.way_x / speed, 0.0, self.led * self.way_z / speed)
        return leg._replace(toe=add(leg.toe, by), ankle=add(leg.ankle, by))

    def _lead_to(self, leg: LegPose, over: SteppedOver) -> float:
        here = over.along(leg.ankle[0], leg.ankle[2])
        back = min(-TOE_M - here - self.metres, 0.0)
        onwards = max(over.length + HEEL_M - here - self.metres, 0.0)
        if over.crossing or here + self.led > -0.5 * TOE_M:
            return min(onwards, MAX_LEAD_M)
        if self.second:  # the other foot may still land before the obstacle
            return 0.0
        nearer = onwards < -back + (LEAD_HYSTERESIS_M if self.goal > 0.0 else -LEAD_HYSTERESIS_M)
        return min(onwards, MAX_LEAD_M) if nearer else max(back, -MAX_LEAD_M)

    def lift(self, points: tuple[tuple[Vector, float], ...], ground: PointHeights) -> float:
        """Return how far (metres) the foot must rise above its incoming height to clear edges on its path; 0 without edges.

        `points` are the shown toe and ankle, each with the incoming height of its sole.
        """
        lift, over = 0.0, self.over
        if over.top > 0.0:
            for point, low in points:
                if -EDGE_M < over.along(point[0], point[2]) < over.length + EDGE_M:
                    lift = max(lift, over.ground + over.top + CLEARANCE_M - low)
            ankle, low = points[1]
            if over.along(ankle[0], ankle[2]) + self.metres + self.goal - self.led > 0.0:
                pace = self.metres / max(self.seconds, MIN_LANDING_S)
                lift = max(lift, self._shin_over(ankle, pace) - ANKLE_HEIGHT - low)
        if self.metres <= 0.0:
            return lift
        speed = self.speed
        x, z, pace = self.way_x / speed, self.way_z / speed, self.metres / self.seconds
        farthest = min(self.metres + self.goal - self.led, pace * RISING_BEFORE_S)
        for point, low in points:
            below, metre = ground.height(point[0], point[2]), SPACING_M
            while metre <= farthest:
                ahead = ground.height(point[0] + metre * x, point[2] + metre * z)
                if ahead - below > MIN_EDGE_M + MIN_EDGE_SLOPE * metre and ahead + CLEARANCE_M - low > lift:
                    soon = smoothstep((RISING_BEFORE_S - metre / pace) / (RISING_BEFORE_S - RAISED_BEFORE_S))
                    lift = max(lift, soon * (ahead + CLEARANCE_M - low))
                metre += SPACING_M
        return lift

    def _shin_over(self, ankle: Vector, pace: float, soon_s: tuple[float, ...] = SHIN_TIMES_S) -> float:
        """Height of an ankle moving at `pace` (m/s) at which its shin clears the bar at the times `soon_s`."""
        over, need = self.over, -UNREACHED_DEPTH_M
        top = over.ground + over.top + LIMB_M
        knee, here = over.along(self.knee[0], self.knee[2]), over.along(ankle[0], ankle[2])
        for seconds in soon_s:
            behind = here + pace * seconds
            ahead = knee + 0.5 * (self.speed + pace) * seconds  # the knee moves at the mean of hip and foot
            soon = smoothstep((RISING_BEFORE_S - seconds) / (RISING_BEFORE_S - RAISED_BEFORE_S))
            for edge in (0.0, over.length):
                if behind < edge < ahead:
                    slope = (self.knee[1] - top) / (ahead - edge)
                    height = min(self.knee[1] - slope * (ahead - behind), top + LIMB_M)
                    need = max(need, ankle[1] + soon * (height - ankle[1]))
        return need

    def knee_out(self, leg: LegPose, side: int, ground: PointHeights, dt: float) -> float:
        """Return how far (radians) the knee of a solved leg turns outwards so that thigh and shin clear the ground."""
        goal, least = 0.0, UNREACHED_DEPTH_M
        for radians_out in KNEE_OUT_RAD:
            depth = self._knee_depth(leg, turned_out(leg, side, radians_out).knee, ground)
            if depth < least - MIN_IMPROVEMENT_M:
                goal, least = radians_out, depth
            if depth <= 0.0:
                break
        self.caught = least > TOUCH_M
        if self.over.top > 0.0:
            self.knee = leg.knee
            self.caught = self.caught or (
                self.held and self._shin_over(leg.ankle, 0.0, SHIN_TIMES_S[:2]) > leg.ankle[1] + TOUCH_M
            )
        self.out, self.out_velocity = damp(self.out, self.out_velocity, goal, OUT_HALF_LIFE_S, dt)
        if goal == 0.0 and abs(self.out) < MIN_OUT_RAD:
            self.out = self.out_velocity = 0.0
        return self.out

    def _knee_depth(self, leg: LegPose, knee: Vector, ground: PointHeights) -> float:
        """Depth in metres of thigh and shin in the ground with the `knee` there, now or soon."""
        speed = max(self.speed, MIN_SIZE)
        x, z = self.way_x / speed, self.way_z / speed
        points = [
            knee,
            *_between(leg.hip, knee, THIGH_FRACTIONS),
            *_between(knee, leg.ankle, SHIN_FRACTIONS),
        ]
        return max(ground.height(p[0] + m * x, p[2] + m * z) + LIMB_M - p[1] for p in points for m in AHEAD_M)


def _between(a: Vector, b: Vector, fractions: tuple[float, ...]) -> list[Vector]:
    return [add(scale(a, 1.0 - f), scale(b, f)) for f in fractions]
