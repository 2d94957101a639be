"""One stride over a bar, a gap or a step: feet and hip height are planned, the rest of the pose is the network's.

It begins when a foot has landed before the obstacle (the stance foot). The other foot (the lead foot) swings over and
lands behind it, then the stance foot follows and lands a step farther: one stride later, at the same phase of the gait.
All is in the traversal's frame: x to the left, y over the ground before the obstacle, z along the path from its near edge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.easing import smoothstep
from runtime.feet.ik import LEG_FEET, LEG_SHINS, LEG_THIGHS, solve_legs
from runtime.pose import FPS
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT
from runtime.terrain.obstacle_detection import ObstacleKind
from runtime.traversal.keyframes import TraversalPose

Mask = NDArray[np.bool_]

TOE_OFFSET_M = np.asarray(SPORT_SKELETON.offsets[LEG_FEET[0] + 1], np.float64)  # from a flat foot's ankle
HIP_DROP_M = float(-SPORT_SKELETON.offsets[LEG_THIGHS[0], 1])  # from the hips down to the thighs' joints
LEG_LENGTH_M = float(-SPORT_SKELETON.offsets[LEG_SHINS[0], 1] - SPORT_SKELETON.offsets[LEG_FEET[0], 1])
LEG_REACH_FRACTION = 0.995  # of its length that a standing leg spans
TAKE_OFF_LEAD_M = 0.42  # distance of the hips ahead of the stance foot when it leaves the ground,
HIPS_LAG_M = 0.30  # and behind the lead foot when it lands
CLEARANCE_M = 0.05  # of soles above edges
EDGE_M = 0.07  # before and behind an edge, where soles are at that height
ROLL_M = 0.1  # the lead foot rolls over its toe once the hips are this far ahead of it
TOE_OFF_PITCH_RAD, LANDING_PITCH_RAD = 0.75, -0.2  # pitch of a foot, positive with toes down
FLATTEN_S = 0.09  # from heel strike to flat foot
MAX_FLIGHT_S = 0.35
LATEST_LANDING_FRACTION, MAX_STRIDE_RATIO = 0.68, 1.6  # of the stride; limit of its lengthening
FLIGHT_S = 0.22  # minimum over a gap
RISING_S = 0.2  # minimum of the hips' rise over a bar
MIN_FALL_M = 0.2  # the hips fall to ground deeper than this
MIN_RISE_FRACTION = 0.15  # minimum part of a swing for a foot's full rise or fall
LIFT_M = 0.05  # in a swing on level ground
MAX_LOWERING_M = 0.12  # limit of the hips' lowering for a foot out of reach
MAXIMUM_FRAMES, MEAN_FRAMES = 3, 7  # before and after a frame: window of the maximum, and of its smoothing
TIMING_ROUNDS = 4  # iterations of lengthening a stride; usually one suffices
MIN_DURATION_S = 1e-3  # minimum divisor of a duration
GRAVITY_M_PER_S2 = 9.81
# distance (m) of the stance foot before an edge: of a bar, plus height and speed over 1 m/s; of a gap or drop; of a step
BAR_TAKEOFF_M, TAKEOFF_TOP_FRACTION, TAKEOFF_S, EDGE_TAKEOFF_M, STEP_TAKEOFF_M = 0.22, 0.45, 0.12, 0.16, 0.3
# distance (m) of the lead foot's landing behind it: of a bar, plus height; of a drop
LANDING_M, LANDING_TOP_FRACTION, DROP_LANDING_M = 0.13, 0.35, 0.16
MIN_STEP_M, MIN_ROOT_M = 0.3, 0.05  # of the following step; of the root's distance behind the stance foot
# of a stride: range of the stance foot's take-off; earliest landing of the lead foot, of the stride and of its rest
LEAVE_RANGE_FRACTION, MIN_LANDING_FRACTION, MIN_SWING_FRACTION = (0.3, 0.62), 0.42, 0.15
MIN_LEAVE_S, LATEST_FALL_FRACTION, MIN_LEAD_FRACTION = 0.05, 0.85, 0.1
# of the stride, when hips change from the old ground to the new
HIPS_UP_FRACTION, HIPS_UP_S_FRACTION, HIPS_DOWN_FRACTION = 0.8, 0.4, 0.1
LOW_BAR_M, HIGHER_FRACTION = 0.33, 1.1  # factor on the hips' rise over a higher bar
ARC_FRACTIONS, FADE_S = (0.34, 0.48), 0.15  # of a stride: half duration of a rise
INNER_FRACTIONS = 0.04, 0.96  # of a swing, between which a foot must be clear
MIN_SQUARED_SPAN = 0.01  # m2 from hip to ankle
ON_TOE_RAD = 0.3  # pitch of a foot already on its toe
# of a stand; of a swing; of the rest of a stride
HEEL_UP_FRACTION, LANDING_TURN_FRACTION, ROLL_FRACTION = 0.35, 0.8, 1.6


@dataclass(frozen=True)
class LeapStart:
    """The state at the start of a leap, in the frame of the traversal."""

    start_z: float  # of the root
    speed: float  # m/s
    seconds: float  # of a stride of two steps
    elapsed: float  # seconds of the stride since the stance foot landed
    stance: int  # the foot that has landed: 0 left, 1 right
    ankles: Array  # (2, 3) left, right
    feet: Array  # (2, 4) world rotations
    hips: float  # height


def takeoff_m(kind: ObstacleKind, top: float, speed: float) -> float:
    """Return the best distance (metres) of the stance ankle from the obstacle's edge at take-off; `speed` of the root in m/s."""
    if kind is ObstacleKind.BAR:
        return BAR_TAKEOFF_M + TAKEOFF_TOP_FRACTION * top + TAKEOFF_S * max(speed - 1.0, 0.0)
    return EDGE_TAKEOFF_M if kind in (ObstacleKind.GAP, ObstacleKind.DOWN) else STEP_TAKEOFF_M


class Leap:
    """The plan of a leap, as tables with one row per frame."""

    def __init__(
        self, kind: ObstacleKind, length: float, top: float, beyond: float, stride: LeapStart
    ) -> None:
        """`length` from near to far edge (0 for a step), `top` height of a bar, `beyond` height of the ground behind."""
        self.kind, self.length, self.top, self.beyond, self.stride = kind, length, top, beyond, stride
        lead = 1 - stride.stance
        first, last = stride.ankles[stride.stance], stride.ankles[lead]
        step = max(0.5 * stride.speed * stride.seconds, MIN_STEP_M)
        behind = DROP_LANDING_M if kind is ObstacleKind.DOWN else LANDING_M
        if kind is ObstacleKind.BAR:
            behind += LANDING_TOP_FRACTION * top
        fall = float(np.sqrt(max(-2.0 * beyond, 0.0) / GRAVITY_M_PER_S2)) if beyond < -MIN_FALL_M else 0.0
        self._fall = fall
        flown = stride.speed * fall + TAKE_OFF_LEAD_M + HIPS_LAG_M if fall else 0.0
        self._lead_z = max(length + behind, first[2] + step, first[2] + flown)
        self._stance_z = self._lead_z + step
        self.end_z = self._stance_z - max(
            first[2] - stride.start_z + stride.elapsed * stride.speed, MIN_ROOT_M
        )
        off, land = self._timed(float(first[2]))
        stride = self.stride
        rolls = float(np.interp(self._lead_z + ROLL_M, self._root, self._t, right=np.inf))
        goals = ((last[0], beyond, self._lead_z), (first[0], beyond, self._stance_z))
        leads = max(MIN_LEAD_FRACTION * stride.seconds, stride.elapsed), land, rolls
        plans = [
            _foot_plan(self._t, stride, lead, leads, goals[0]),
            _foot_plan(self._t, stride, stride.stance, (off, stride.seconds, np.inf), goals[1]),
        ]
        for plan in plans:
            plan.clear(self._profile)
        self._plans = plans if lead == 0 else plans[::-1]
        self._rise = self._hips_rise(off, land)

    def _timed(self, stance_z: float) -> tuple[float, float]:
        """Set the time and root position of every row; return when the stance foot leaves and the lead foot lands.

        A stride too short to bring the hips near the lead foot's landing is lengthened.
        """
        wanted = self.stride.seconds
        for _ in range(TIMING_ROUNDS):
            self.seconds = self.stride.seconds - self.stride.elapsed
            self._count = max(round(self.seconds * FPS), 2)
            self._t = self.stride.elapsed + np.arange(self._count + 1) / self._count * self.seconds
            self._root = self._root_path()
            whole = float(np.interp(self._lead_z - HIPS_LAG_M, self._root, self._t)) / LATEST_LANDING_FRACTION
            if whole <= self.stride.seconds + 0.5 / FPS or self.stride.seconds >= MAX_STRIDE_RATIO * wanted:
                break
            self.stride = replace(self.stride, seconds=min(whole, MAX_STRIDE_RATIO * wanted))
        return self._times(stance_z)

    def _root_path(self) -> Array:
        """Root positions over the stride, with its speed at both ends and the difference eased in between."""
        s, way = (self._t - self._t[0]) / self.seconds, self.end_z - self.stride.start_z
        slope = min(self.stride.speed * self.seconds, 2.0 * way)
        h00, h10, h11 = 2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, s**3 - s**2
        return self.stride.start_z + (1 - h00) * way + (h10 + h11) * slope

    def _times(self, stance_z: float) -> tuple[float, float]:
        """Return when the stance foot leaves the ground and the lead foot lands."""
        off = float(np.interp(stance_z + TAKE_OFF_LEAD_M, self._root, self._t))
        land = float(np.interp(self._lead_z - HIPS_LAG_M, self._root, self._t))
        whole, begin = self.stride.seconds, self.stride.elapsed
        soonest = max(land, MIN_LANDING_FRACTION * whole, begin + MIN_SWING_FRACTION * whole)
        land = min(soonest, LATEST_LANDING_FRACTION * whole)
        first, last = LEAVE_RANGE_FRACTION
        off = min(max(off, first * whole, begin + MIN_LEAVE_S), last * whole)
        if self.kind is ObstacleKind.GAP:
            off = max(min(off, land - FLIGHT_S), begin + MIN_LEAVE_S)
        return off, max(land, min(off + self._fall, LATEST_FALL_FRACTION * whole))

    def _profile(self, z: Array) -> Array:
        """Sole height at z `(N,)`: over the obstacle, with its edges widened; elsewhere the ground."""
        ground = np.where(z < 0.5 * self.length, 0.0, self.beyond)
        if self.kind is ObstacleKind.BAR:
            return np.where((z > -EDGE_M) & (z < self.length + EDGE_M), self.top + CLEARANCE_M, ground)
        near = (np.abs(z) < EDGE_M) | (np.abs(z - self.length) < EDGE_M)
        edges = np.where(
            (np.abs(z) < EDGE_M) & (np.abs(z - self.length) < EDGE_M), max(0.0, self.beyond), ground
        )
        return np.where(near, edges + CLEARANCE_M, ground)

    def _hips_rise(self, off: float, land: float) -> Array:
        """Height of the hips over the incoming pose: the new ground, a flight's arc, and the legs' reach."""
        t, begin, end = self._t, self.stride.elapsed, self.stride.seconds
        leaves = max(HIPS_UP_FRACTION * off, begin)
        if self._fall:
            up: Array = np.clip((t - off) / max(land - off, MIN_DURATION_S), 0.0, 1.0) ** 2
        elif self.beyond > 0.0:
            up = smoothstep((t - land) / min(HIPS_UP_S_FRACTION * end, end - land))
        else:
            up = smoothstep((t - leaves) / (land + HIPS_DOWN_FRACTION * off - leaves))
        flight = min(max(land - off, 0.0), MAX_FLIGHT_S)
        high = max(GRAVITY_M_PER_S2 * flight**2 / 8.0, HIGHER_FRACTION * (self.top - LOW_BAR_M))
        middle = 0.5 * (off + land)
        falling = np.pi * (0.5 * max(high, 0.0) / GRAVITY_M_PER_S2) ** 0.5  # no faster than free fall
        width = min(max(falling, ARC_FRACTIONS[0] * end), ARC_FRACTIONS[1] * end)
        # a leap that begins late rises later, and each end has its own ground
        before = min(width, max(middle - begin, RISING_S))
        middle = max(middle, begin + before)
        width = np.where(t < middle, before, min(width, end - middle))
        arc = np.where(np.abs(t - middle) < width, np.cos(0.5 * np.pi * (t - middle) / width) ** 2, 0.0)
        rise = self.beyond * up + max(high, 0.0) * arc
        limit = np.full(len(t), np.inf)
        for plan in self._plans:
            dz = plan.ankle[:, 2] - self._root
            spans = np.sqrt(np.maximum((LEG_REACH_FRACTION * LEG_LENGTH_M) ** 2 - dz**2, MIN_SQUARED_SPAN))
            reach = plan.ankle[:, 1] + spans + HIP_DROP_M
            limit = np.where(plan.stands, np.minimum(limit, reach - self.stride.hips), limit)
        lower = np.minimum(np.maximum(rise - limit, 0.0), MAX_LOWERING_M)
        # maximum of the neighbouring frames, then smoothed: at least as high, without a jump at a landing
        most = sliding_window_view(np.pad(lower, MAXIMUM_FRAMES, mode="edge"), 2 * MAXIMUM_FRAMES + 1).max(-1)
        kernel = np.hanning(2 * MEAN_FRAMES + 1)
        spread = np.convolve(np.pad(most, MEAN_FRAMES, mode="edge"), kernel / kernel.sum(), mode="valid")
        fade = smoothstep(np.minimum(t - t[0], end - t) / FADE_S)
        return rise - spread * fade

    def root_z(self, t: float) -> float:
        """Return the root's position (metres) along the path at `t` seconds."""
        return float(np.interp(self.stride.elapsed + t, self._t, self._root))

    def pose(self, t: float, hips: Array, local: Array) -> TraversalPose:
        """Return the leap's pose at `t` seconds, from the network's `hips` `(3,)` over ground 0 and `local` `(31, 4)`."""
        row = min(max(round(t * FPS), 0), self._count)
        raised = hips + np.array([0.0, self._rise[row], 0.0])
        targets = np.array([plan.ankle[row] for plan in self._plans])
        feet = np.array([plan.rotation[row] for plan in self._plans])
        contacts = np.array([[plan.heel[row], plan.toe[row]] for plan in self._plans], np.float64).ravel()
        return TraversalPose(raised, solve_legs(raised, local, targets, feet), contacts)


class _FootPlan:
    """Ankle `(T, 3)`, rotation `(T, 4)` and contacts of one foot over the stride."""

    def __init__(self, ankle: Array, pitch: Array, yaw: float, swing: Array, heel: Mask, toe: Mask) -> None:
        self.ankle, self._pitch, self._yaw = ankle, pitch, yaw
        self._swing = swing  # 0..1 during the swing
        self.heel, self.toe = heel, toe
        self.stands: Mask = heel | toe
        self.rotation = rotations.multiply(rotations.from_yaw(np.full(len(pitch), yaw)), _pitched(pitch))

    def clear(self, profile: Callable[[Array], Array]) -> None:
        """Raise the foot during its swing so that the sole clears the obstacle."""
        u = self._swing
        points = [
            (self.ankle, ANKLE_HEIGHT),
            (self.ankle + rotations.rotate(self.rotation, np.tile(TOE_OFFSET_M, (len(u), 1))), TOE_HEIGHT),
        ]
        lack = np.max([profile(p[:, 2]) - (p[:, 1] - rest) for p, rest in points], axis=0)
        lack = np.where((u > 0.0) & (u < 1.0), lack, 0.0)
        inner = (u > INNER_FRACTIONS[0]) & (u < INNER_FRACTIONS[1]) & (lack > 0.0)
        if not inner.any():
            return
        first, last = float(u[inner][0]), float(u[inner][-1])
        up = smoothstep(u / max(first, MIN_RISE_FRACTION))
        down = smoothstep((1.0 - u) / max(1.0 - last, MIN_RISE_FRACTION))
        self.ankle = self.ankle + np.outer(float(lack[inner].max()) * np.minimum(up, down), [0.0, 1.0, 0.0])


def _foot_plan(
    t: Array,
    stride: LeapStart,
    side: int,
    times: tuple[float, float, float],
    goal: tuple[float, float, float],
) -> _FootPlan:
    """Plan a foot that stands until `off`, swings, lands at `land` over `goal` (x, ground, z) and rolls from `rolls` on."""
    off, land, rolls = times
    start = np.asarray(stride.ankles[side], np.float64)
    ahead = rotations.rotate(stride.feet[side], TOE_OFFSET_M)
    yaw = float(np.arctan2(ahead[0], ahead[2]))
    level = float(np.arctan2(TOE_OFFSET_M[1], TOE_OFFSET_M[2]))
    pitch0 = float(level - np.arctan2(ahead[1], np.hypot(ahead[0], ahead[2])))
    u = np.clip((t - off) / max(land - off, MIN_DURATION_S), 0.0, 1.0)
    flat = smoothstep((t - t[0]) / FLATTEN_S)
    on_toe, raised = pitch0 >= ON_TOE_RAD, HEEL_UP_FRACTION * off
    heel_off = np.ones(len(t)) if on_toe else smoothstep((t - raised) / ((1.0 - HEEL_UP_FRACTION) * off))
    standing = np.full(len(t), pitch0) if on_toe else pitch0 * (1.0 - flat)
    standing = standing + (TOE_OFF_PITCH_RAD - standing) * heel_off * smoothstep(
        (t - t[0]) / max(off - t[0], MIN_DURATION_S)
    )
    swung = TOE_OFF_PITCH_RAD + (LANDING_PITCH_RAD - TOE_OFF_PITCH_RAD) * smoothstep(
        u / LANDING_TURN_FRACTION
    )
    rolled: Array = np.zeros(len(t))
    if rolls < t[-1]:
        rolled = TOE_OFF_PITCH_RAD * smoothstep((t - rolls) / (ROLL_FRACTION * (t[-1] - rolls)))
    landed = LANDING_PITCH_RAD * (1.0 - smoothstep((t - land) / FLATTEN_S)) + rolled
    pitch = np.where(t < off, standing, np.where(t < land, swung, landed))
    over = np.array([goal[0], goal[1] + ANKLE_HEIGHT, goal[2]])
    ankle = _planned_ankle(t, off, land, u, pitch, yaw, start, over)
    ahead = rotations.rotate(rotations.from_yaw(yaw), TOE_OFFSET_M)
    turned = rotations.multiply(rotations.from_yaw(np.full(len(t), yaw)), _pitched(rolled))
    ankle = ankle + (ahead - rotations.rotate(turned, np.tile(TOE_OFFSET_M, (len(t), 1))))  # over its toe
    heel = ((t < raised) & (not on_toe)) | ((t >= land) & (t < rolls))
    toe = (t < off) | (t >= land + FLATTEN_S)
    return _FootPlan(ankle, pitch, yaw, u, heel, toe)


def _planned_ankle(
    t: Array, off: float, land: float, u: Array, pitch: Array, yaw: float, start: Array, goal: Array
) -> Array:
    """Ankle positions `(T, 3)`: over its toe while standing, smooth in the swing, over `goal` afterwards."""
    turned = rotations.multiply(rotations.from_yaw(np.full(len(t), yaw)), _pitched(pitch))
    toe = rotations.rotate(turned, np.tile(TOE_OFFSET_M, (len(t), 1)))
    on_toe = pitch[0] >= ON_TOE_RAD
    down = start[1] if on_toe else np.minimum(start[1], ANKLE_HEIGHT)
    held = np.array([start[0], down, start[2]]) + toe[0]
    held[1] = max(held[1], TOE_HEIGHT) if on_toe else TOE_HEIGHT
    over = held - toe  # the toe stays in place
    settle = (start - over[0]) * (1.0 - smoothstep((t - t[0]) / FLATTEN_S))[:, None]
    standing = over + settle
    leaves = standing[min(int(np.searchsorted(t, off)), len(t) - 1)]
    eased = (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))[:, None]
    swung = leaves + (goal - leaves) * eased + LIFT_M * np.outer(np.sin(np.pi * u) ** 2, [0.0, 1.0, 0.0])
    return np.where((t < off)[:, None], standing, np.where((t < land)[:, None], swung, goal))


def _pitched(pitch: Array) -> Array:
    return rotations.from_axis_angle(np.tile([1.0, 0.0, 0.0], (len(pitch), 1)), pitch)
