"""Balance over a stride: the hips move so that the zero moment point lies under the feet on the ground.

If the zero moment point of an inverted pendulum of height h misses its feet by e, a displacement x restores balance, where
x - h/g x'' = e. Over a stride of angular frequency w, harmonic k of x is that of e divided by 1 + h/g (k w)^2. The error
is measured on the body without the correction and learnt by stride phase, so that there is no feedback loop. It is
a horizontal force over body weight rather than a distance, so that flight phases, without any force, count too.

Shaking of hips, trunk and arms that does not repeat with the stride is smoothed. A critically damped filter (alpha and beta of
fading memory: E. Brookner, Tracking and Kalman Filtering Made Easy, 1998, section 1.2.6) follows the centre of mass at
constant velocity, and the hips make up for the deviation from it.

Horizontal vectors are complex numbers, X + iZ. Divided by the path's direction they have components along and across the path.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import atan2, cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array, Flags
from runtime.motion.features import DT, FPS
from runtime.scalar_math import MIN_DIVISOR, MIN_SIZE, damp, decay
from runtime.skeleton import SPORT_SKELETON


class Segment(NamedTuple):
    """A body segment between two joints, for one side: its mass fraction and centre of mass."""

    mass: float  # fraction of the body's mass
    proximal: str  # joint
    distal: str  # joint
    center: float  # fraction of the way from the proximal to the distal joint at which its mass lies


# P. de Leva (1996), Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters, Journal of Biomechanics 29(9),
# table 4, males. Each side has half of the trunk, from the hip joint to the shoulder, and of head and neck.
SIDE_SEGMENTS = {
    "trunk": Segment(0.2173, "UpLeg", "Arm", 0.55),
    "upper arm": Segment(0.0271, "Arm", "ForeArm", 0.58),
    "forearm": Segment(0.0162, "ForeArm", "Hand", 0.46),
    "hand": Segment(0.0061, "ForeArm", "Hand", 1.25),
    "thigh": Segment(0.1416, "UpLeg", "Leg", 0.41),
    "shank": Segment(0.0433, "Leg", "Foot", 0.45),
    "foot": Segment(0.0137, "Foot", "ToeBase", 0.44),
}
HEAD_SEGMENT = Segment(0.0694, "Neck1", "Head", 1.6)
# how far each joint of the legs follows a shift of the hips; all other joints follow fully
SHIFT_FRACTIONS = {"Leg": 0.5, "Foot": 0.0, "ToeBase": 0.0}

GRAVITY_M_PER_S2 = 9.81
MIN_WEIGHT_FRACTION = 0.2  # of the body's weight: minimum force that an acceleration is divided by
MIN_HEIGHT_M = 0.3  # of the pendulum
MARGIN_M = 0.02  # between the zero moment point and the line between ankles and toes that stand
MAX_ERROR_M = 0.3
MAX_SHIFT_M = 0.08  # limit of the hips' shift, along and across the path
WINDOW_FRAMES = 13  # over which a cubic smooths accelerations; the error is evaluated at their middle
HARMONICS = 4  # of a stride
LEARNING_HALF_LIFE_S = 2.0  # in which errors are forgotten
PRIOR_VARIANCE = 0.05  # of each harmonic, relative to that of an error
# m along the path at 1 m/s, cosine and sine of the second and the fourth harmonic, which grow by the square of the speed:
# halfway between those of captured styles (-0.019, 0.03, -0.022, 0.018) and of composed ones (-0.028, 0.104, -0.042, 0.042),
# which surge too little with each step (means after 10 s). Learnt errors are added
USUAL_ERRORS_M = {3: -0.023, 4: 0.065, 7: -0.03, 8: 0.03}
MAX_USUAL_SPEED_M_PER_S = 1.5  # up to which these values hold
DISTANCE_HALF_LIFE_S = 0.6  # of the mean and mean square of the ankles' distance
SPEED_HALF_LIFE_S = 0.03  # of the smoothing of its speed
PHASE_GAIN = 0.15  # of the phase-locked loop: fraction of its error corrected per frame
FREQUENCY_GAIN = 0.25 * PHASE_GAIN**2  # the same for its frequency: critically damped
USUAL_FREQUENCY_RAD_PER_S = 2.0 * pi * 0.9
FREQUENCY_RANGE_RAD_PER_S = 2.0 * pi * 0.3, 2.0 * pi * 2.0
# along and across the path: how fast the filtered centre of mass may change its velocity
SMOOTHING_FREQUENCIES_HZ = np.array([1.0, 2.0])
MAX_SMOOTHING_M = 0.05  # limit of this shift of the hips
MAX_TRACKING_ERROR_M = 0.3  # limit of the filter's error: beyond, the body was moved elsewhere
FADE_HALF_LIFE_S = 0.25  # in which the correction fades in and out
MIN_IN_FORCE_FRACTION = 1e-4  # smaller weights count as zero
MIN_SQUARE = 1e-6  # m2 of the ankles' distance, m2/s2 of its speed

_AT = SPORT_SKELETON.index
# X and Z of ankle and toe, the left foot's first
_FOOT_POINTS = [
    3 * _AT(name) + k for name in ("LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase") for k in (0, 2)
]
# line segments between foot points that support the body, by whether the left and the right foot are loaded
_LINES = {(True, False): ((0, 1),), (False, True): ((2, 3),), (True, True): tuple(combinations(range(4), 2))}
_MIDDLE = WINDOW_FRAMES // 2
_CUBIC = np.linalg.pinv(np.vander((np.arange(WINDOW_FRAMES) - _MIDDLE) * DT, 4, increasing=True))
_FIT = np.stack([_CUBIC[0], 2.0 * _CUBIC[2]])  # at the window's middle: position and acceleration
# columns of the window per frame: centre of mass, foot points, which feet stand, planned velocity, phase of the
# stride, and whether the frame is used for learning
_MASS, _POINTS, _STANDS, _VELOCITY = slice(3), slice(3, 11), slice(11, 13), slice(13, 15)
_PHASE, _LEARNS, _COLUMNS = 15, 16, 17
_TERMS = 1 + 2 * HARMONICS
_ORDERS = (np.arange(_TERMS) + 1) // 2  # the harmonic of each term
_USUAL = np.array([[USUAL_ERRORS_M.get(term, 0.0), 0.0] for term in range(_TERMS)])
_KEEPS = decay(LEARNING_HALF_LIFE_S)
_MEMORY = np.exp(-2.0 * np.pi * SMOOTHING_FREQUENCIES_HZ * DT)
_PLACE_GAINS, _SPEED_GAINS = (1.0 - _MEMORY**2).tolist(), ((1.0 - _MEMORY) ** 2 / DT).tolist()
_FOLLOWS, _SMOOTHS = 1.0 - decay(DISTANCE_HALF_LIFE_S), 1.0 - decay(SPEED_HALF_LIFE_S)


def _mass_of_joints() -> tuple[Array, float]:
    """Weights of the joints `(31,)` in the centre of mass, and its displacement for a hip shift of 1."""
    weights = np.zeros(len(SPORT_SKELETON))
    halves = [(side, segment) for side in ("Left", "Right") for segment in SIDE_SEGMENTS.values()]
    for side, (mass, proximal, distal, center) in [*halves, ("", HEAD_SEGMENT)]:
        weights[_AT(side + proximal)] += mass * (1.0 - center)
        weights[_AT(side + distal)] += mass * center
    weights /= weights.sum()
    names = [name.removeprefix("Left").removeprefix("Right") for name in SPORT_SKELETON.names]
    return weights, float(weights @ [SHIFT_FRACTIONS.get(name, 1.0) for name in names])


JOINT_MASSES, MASS_SHIFT = _mass_of_joints()


def _one(*shape: int, start: Array | float = 0.0) -> Callable[[], Array]:
    """Return a factory for the array of one character."""
    return lambda: np.zeros((1, *shape)) + start


@dataclass
class StrideBalance:
    """Stride measurements of N characters."""

    window: Array = field(
        default_factory=_one(WINDOW_FRAMES, _COLUMNS), metadata={"shape": (WINDOW_FRAMES, _COLUMNS)}
    )
    # distance of the ankles along the path: mean, last (m), speed (m/s)
    distance: Array = field(default_factory=_one(3), metadata={"shape": (3,)})
    # mean squares of this distance (m2) and its speed (m2/s2)
    mean_squares: Array = field(default_factory=_one(2, start=0.05), metadata={"shape": (2,)})
    # phase of the stride, radians
    phase: Array = field(default_factory=_one(), metadata={"shape": ()})
    frequency: Array = field(default_factory=_one(start=USUAL_FREQUENCY_RAD_PER_S), metadata={"shape": ()})
    # m along and across the path, relative to the usual ones: mean, cosine and sine of each harmonic
    errors: Array = field(default_factory=_one(_TERMS, 2), metadata={"shape": (_TERMS, 2)})
    # covariance of the errors
    covariance: Array = field(
        default_factory=_one(_TERMS, _TERMS, start=PRIOR_VARIANCE * np.eye(_TERMS)),
        metadata={"shape": (_TERMS, _TERMS)},
    )
    # weight of the correction, 0 to 1
    fraction: Array = field(default_factory=_one(), metadata={"shape": ()})
    # its change, 1/s
    fraction_speed: Array = field(default_factory=_one(), metadata={"shape": ()})
    # XZ position and velocity of the filtered centre of mass, m and m/s
    mass_place: Array = field(default_factory=_one(2), metadata={"shape": (2,)})
    mass_velocity: Array = field(default_factory=_one(2), metadata={"shape": (2,)})
    # XZ shift of the hips in the last frame, m: by smoothing, and in total
    smoothing: Array = field(default_factory=_one(2), metadata={"shape": (2,)})
    shift: Array = field(default_factory=_one(2), metadata={"shape": (2,)})

    def update(
        self,
        positions: Array,
        ground: Array,
        velocity: Array,
        stands: Sequence[tuple[bool, bool]],
        steady: Sequence[bool],
        composed: Sequence[float],
    ) -> Array:
        """Return the displacement `(N, 2)` of the hips in X and Z for this frame, metres.

        `positions` `(N, 31, 3)` are the joints shown in the last frame, `ground` `(N,)` the height under them, `stands`
        whether the left and right foot stood, `velocity` `(N, 2)` the planned one (m/s), `steady` which characters walk
        steadily, and `composed` how unlike any captured walk theirs is: only composed walks are smoothed.
        """
        velocities = velocity.view(complex)[:, 0].tolist()
        paths = [_direction(each) for each in velocities]
        joints = positions.astype(np.float64)
        masses, feet = JOINT_MASSES @ joints, joints.reshape(len(joints), -1).take(_FOOT_POINTS, 1)
        self._follow_phase(feet.view(complex).tolist(), paths)
        masses[:, 1] -= ground
        places = masses[:, ::2] - MASS_SHIFT * self.shift
        masses[:, ::2] = places + MASS_SHIFT * self.smoothing
        smoothing = self._follow_mass(places.view(complex)[:, 0].tolist(), velocities, paths)
        row = np.concatenate([masses, feet, stands, velocity, self.phase[:, None], np.array([steady]).T], -1)
        self.window = np.concatenate([self.window[:, 1:], row[:, None]], 1)
        if any(steady):
            self._learn()
        self._fade(steady)
        in_force = self.fraction.tolist()
        if not any(in_force):
            self.shift = self.smoothing = np.zeros_like(velocity)
            return self.shift
        smoothing = [f * c * each for f, c, each in zip(in_force, composed, smoothing, strict=True)]
        k = np.maximum(masses[:, 1], MIN_HEIGHT_M)[:, None] / GRAVITY_M_PER_S2
        terms = _terms(self.phase.tolist()) / (1.0 + k * (_ORDERS * self.frequency[:, None]) ** 2)
        missing = [_limited(each / MASS_SHIFT, MAX_SHIFT_M) for each in self._missing(terms, velocities)]
        parts = zip(in_force, missing, paths, smoothing, strict=True)
        self.smoothing, self.shift = _pairs(smoothing), _pairs([f * (m * p) + s for f, m, p, s in parts])
        return self.shift

    def _follow_mass(
        self, places: Sequence[complex], velocities: Sequence[complex], paths: Sequence[complex]
    ) -> list[complex]:
        """Filter the centres of mass; return the hip shifts that make them move evenly."""
        followed, moved = [], []
        states = (self.mass_place, self.mass_velocity, self.window[:, -1, _VELOCITY])
        known = (each.view(complex)[:, 0].tolist() for each in states)
        for place, velocity, path, at, going, planned in zip(places, velocities, paths, *known, strict=True):
            speed = going + velocity - planned  # a change of the planned velocity is not shaking
            expected = at + DT * speed
            away = place - expected
            if max(abs(away.real), abs(away.imag)) > MAX_TRACKING_ERROR_M or not path:
                followed.append(place)
                moved.append(velocity)
                continue
            away *= path.conjugate()  # along and across the path
            (along, across), (faster, aside) = _PLACE_GAINS, _SPEED_GAINS
            followed.append(expected + complex(along * away.real, across * away.imag) * path)
            moved.append(speed + complex(faster * away.real, aside * away.imag) * path)
        self.mass_place, self.mass_velocity = _pairs(followed), _pairs(moved)
        away_by = (b - a for a, b in zip(places, followed, strict=True))
        return [_limited(each / MASS_SHIFT, MAX_SMOOTHING_M) for each in away_by]

    def _follow_phase(self, feet: Sequence[Sequence[complex]], paths: Sequence[complex]) -> None:
        """Follow the phase of the stride from the distance of the ankles along the path."""
        least, most = FREQUENCY_RANGE_RAD_PER_S
        made = []
        for points, path, (mean, last, speed), (square, speed_square), phase, frequency in zip(
            feet,
            paths,
            self.distance.tolist(),
            self.mean_squares.tolist(),
            self.phase.tolist(),
            self.frequency.tolist(),
            strict=True,
        ):
            now = ((points[0] - points[2]) * path.conjugate()).real
            mean += _FOLLOWS * (now - mean)
            speed += _SMOOTHS * ((now - last) * FPS - speed)
            square += _FOLLOWS * ((now - mean) ** 2 - square)
            speed_square += _FOLLOWS * (speed * speed - speed_square)
            seen = atan2(
                -speed / sqrt(max(speed_square, MIN_SQUARE)), (now - mean) / sqrt(max(square, MIN_SQUARE))
            )
            phase += frequency * DT
            away = (seen - phase + pi) % (2.0 * pi) - pi
            frequency = min(max(frequency + FREQUENCY_GAIN * away * FPS, least), most)
            phase = (phase + PHASE_GAIN * away) % (2.0 * pi)
            made.append((mean, now, speed, square, speed_square, phase, frequency))
        values = np.array(made)
        self.distance, self.mean_squares = values[:, :3], values[:, 3:5]
        self.phase, self.frequency = values[:, 5], values[:, 6]

    def _learn(self) -> None:
        """Fit the harmonics to the error at the window's middle: recursive least squares with exponential forgetting."""
        middle = self.window[:, _MIDDLE]
        known = self.window[..., _LEARNS].min(-1)[:, None]
        terms = _terms(middle[:, _PHASE].tolist())
        velocities = middle[:, _VELOCITY].view(complex)[:, 0].tolist()
        fitted = (_FIT @ self.window[..., _MASS]).tolist()
        points, stands = middle[:, _POINTS].view(complex).tolist(), middle[:, _STANDS].tolist()
        errors = zip(
            map(_error, fitted, points, stands), velocities, self._missing(terms, velocities), strict=True
        )
        missing = _pairs([error * _direction(v).conjugate() - known for error, v, known in errors])
        spread = (self.covariance @ terms[..., None])[..., 0]
        gain = known * spread / (_KEEPS + np.add.reduce(terms * spread, -1, keepdims=True))
        self.errors = self.errors + gain[..., None] * missing[:, None]
        covariance = self.covariance - gain[..., None] * spread[:, None]
        known_well: Flags = covariance.trace(0, 1, 2) < _KEEPS * _TERMS * PRIOR_VARIANCE
        forgets = known[:, 0] * known_well
        self.covariance = covariance * (1.0 + forgets * (1.0 / _KEEPS - 1.0))[:, None, None]

    def _missing(self, terms: Array, velocities: Sequence[complex]) -> list[complex]:
        """Return the usual plus learnt error, metres along and across the path, for harmonic terms `(N, 9)`."""
        squares = np.array([min(_square(each), MAX_USUAL_SPEED_M_PER_S**2) for each in velocities])
        made = terms[:, None] @ (self.errors + squares[:, None, None] * _USUAL)
        return made.view(complex)[:, 0, 0].tolist()

    def _fade(self, steady: Sequence[bool]) -> None:
        """Fade the correction in for `steady` characters, and out for all others."""
        now = zip(self.fraction.tolist(), self.fraction_speed.tolist(), steady, strict=True)
        faded = [damp(fraction, speed, float(on), FADE_HALF_LIFE_S, DT) for fraction, speed, on in now]
        kept = [each if max(each) > MIN_IN_FORCE_FRACTION else (0.0, 0.0) for each in faded]
        self.fraction, self.fraction_speed = np.array(kept).T


def _error(fitted: Sequence[Sequence[float]], points: Sequence[complex], stands: Sequence[float]) -> complex:
    """Return the distance (m) of the zero moment point from the standing feet, times the force on them over body weight."""
    place, acceleration = fitted
    weight = max(1.0 + acceleration[1] / GRAVITY_M_PER_S2, MIN_WEIGHT_FRACTION)
    error = place[1] / GRAVITY_M_PER_S2 * complex(acceleration[0], acceleration[2])
    if any(stands):
        zero_moment = complex(place[0], place[2]) - error / weight
        lines = _LINES[stands[0] > 0.5, stands[1] > 0.5]
        lacks = min((_to_line(zero_moment, points[start], points[end]) for start, end in lines), key=_square)
        error = max(1.0 - MARGIN_M / max(sqrt(_square(lacks)), MIN_DIVISOR), 0.0) * weight * lacks
    x, z = (min(max(each, -MAX_ERROR_M), MAX_ERROR_M) for each in (error.real, error.imag))
    return complex(x, z)


def _to_line(point: complex, start: complex, end: complex) -> complex:
    """Return the vector from a point to the nearest point of a line segment."""
    line, there = end - start, point - start
    part = (there * line.conjugate()).real / max(_square(line), MIN_DIVISOR)
    return min(max(part, 0.0), 1.0) * line - there


def _terms(phases: Sequence[float]) -> Array:
    """Return 1, then cosine and sine of every harmonic of N phases: `(N, 9)`."""
    orders = range(1, HARMONICS + 1)
    return np.array([[1.0, *(f(k * p) for k in orders for f in (cos, sin))] for p in phases])


def _direction(velocity: complex) -> complex:
    """Return the unit vector of a velocity; 0 for zero velocity."""
    return velocity / max(sqrt(_square(velocity)), MIN_SIZE)


def _square(value: complex) -> float:
    """Return the squared magnitude of a complex number."""
    return value.real * value.real + value.imag * value.imag


def _limited(value: complex, most: float) -> complex:
    """Return a value with both parts limited to `most`, nearly unchanged where they are small."""
    x, z = value.real / most, value.imag / most
    return complex(value.real / sqrt(1.0 + x * x), value.imag / sqrt(1.0 + z * z))


def _pairs(values: Sequence[complex]) -> Array:
    """Return real and imaginary parts `(N, 2)` of N complex numbers."""
    return np.array(values).view(np.float64).reshape(-1, 2)
