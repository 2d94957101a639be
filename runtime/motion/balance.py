"""Balance over a stride: the hips move so that the zero moment point lies under the feet that stand.

An inverted pendulum of height h whose zero moment point lacks e to its feet is in balance when it is moved by x, where
x - h/g x'' = e. Over a stride of angular frequency w, harmonic k of x is that of e divided by 1 + h/g (k w)^2. The error
is measured on the body without the correction and learnt by the phase of the stride, so that nothing is fed back. It is
a horizontal force over the body's weight and not a distance, so that a flight counts too: there no force acts.

What the hips, trunk and arms of a network shake beside that has no phase. A filter of critical damping (alpha and beta of
fading memory: E. Brookner, Tracking and Kalman Filtering Made Easy, 1998, section 1.2.6) follows the centre of mass at an
even speed, and the hips take up what it is away from there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
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
# the fraction of the hips' shift that a joint of a leg goes: 1 of all others
SHIFT_FRACTIONS = {"Leg": 0.5, "Foot": 0.0, "ToeBase": 0.0}

GRAVITY_M_PER_S2 = 9.81
LEAST_WEIGHT_FRACTION = 0.2  # of the body's weight: what an acceleration is divided by
LEAST_HEIGHT_M = 0.3  # of the pendulum
MARGIN_M = 0.02  # between the zero moment point and the line between ankles and toes that stand
MAX_ERROR_M = 0.3
MAX_SHIFT_M = 0.08  # of the hips, along and across the path
WINDOW_FRAMES = 13  # in which accelerations are smoothed by a cubic; known is the error of their middle
HARMONICS = 4  # of a stride
LEARNING_HALF_LIFE_S = 2.0  # in which errors are forgotten
PRIOR_VARIANCE = 0.05  # of what each harmonic may be, over that of an error
# m along the path at 1 m/s, cosine and sine of the second and the fourth harmonic, which grow by the square of the speed:
# between what captured styles lack (-0.019, 0.03, -0.022, 0.018) and bodies composed by words (-0.028, 0.104, -0.042, 0.042),
# who surge too little with each step (means after 10 s). What is learnt is added
USUAL_ERRORS_M = {3: -0.023, 4: 0.065, 7: -0.03, 8: 0.03}
MAX_USUAL_SPEED_M_PER_S = 1.5  # up to which they are known
DISTANCE_HALF_LIFE_S = 0.6  # of the mean and the size of the ankles' distance
SPEED_HALF_LIFE_S = 0.03  # of the smoothing of its speed
PHASE_GAIN = 0.15  # of the loop that follows the phase, a frame: fraction of its error
FREQUENCY_GAIN = 0.25 * PHASE_GAIN**2  # and of its frequency: critically damped
USUAL_FREQUENCY_RAD_PER_S = 2.0 * pi * 0.9
FREQUENCY_RANGE_RAD_PER_S = 2.0 * pi * 0.3, 2.0 * pi * 2.0
# along and across the path: as fast as that the centre of mass may change its speed beside what is learnt
SMOOTHING_FREQUENCIES_HZ = np.array([1.0, 2.0])
MAX_SMOOTHING_M = 0.05  # of the hips
MAX_TRACKING_ERROR_M = 0.3  # of the filter: farther away, a body was put elsewhere
FADE_HALF_LIFE_S = 0.25  # in which the correction comes into force and goes
MIN_IN_FORCE_FRACTION = 1e-4  # of it: less is none
UNREACHED_M = 1e3  # to a line on which nothing bears
MIN_SQUARE = 1e-6  # m2 of the ankles' distance, m2/s2 of its speed

_AT = SPORT_SKELETON.index
_FOOT_POINTS = [_AT(name) for name in ("LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase")]
# lines between foot points on which a body may stand: two of one foot each, four across both
_STARTS, _ENDS = np.array([0, 2, 0, 0, 1, 1]), np.array([1, 3, 2, 3, 2, 3])
_LEFT_BEARS, _RIGHT_BEARS = np.array([1, 0, 1, 1, 1, 1]) > 0, np.array([0, 1, 1, 1, 1, 1]) > 0
_MIDDLE = WINDOW_FRAMES // 2
_CUBIC = np.linalg.pinv(np.vander((np.arange(WINDOW_FRAMES) - _MIDDLE) * DT, 4, increasing=True))
_PLACE, _ACCELERATION = _CUBIC[0], 2.0 * _CUBIC[2]
# what the window has of each frame: centre of mass, foot points, which feet stand, planned velocity, phase of the
# stride, and whether the frame is learnt from
_MASS, _POINTS, _STANDS, _VELOCITY, _PHASE, _LEARNS = (
    slice(3),
    slice(3, 11),
    slice(11, 13),
    slice(13, 15),
    15,
    16,
)
_COLUMNS = 17
_TERMS = 1 + 2 * HARMONICS
_ORDERS = (np.arange(_TERMS) + 1) // 2  # the harmonic of each term
_USUAL = np.array([[USUAL_ERRORS_M.get(term, 0.0), 0.0] for term in range(_TERMS)])
_KEEPS = decay(LEARNING_HALF_LIFE_S)
_MEMORY = np.exp(-2.0 * np.pi * SMOOTHING_FREQUENCIES_HZ * DT)
_PLACE_GAINS, _SPEED_GAINS = 1.0 - _MEMORY**2, (1.0 - _MEMORY) ** 2 / DT
_FOLLOWS, _SMOOTHS = 1.0 - decay(DISTANCE_HALF_LIFE_S), 1.0 - decay(SPEED_HALF_LIFE_S)


def _mass_of_joints() -> tuple[Array, float]:
    """Weights of the joints `(31,)` in the centre of mass, and how far that goes with a shift of the hips by 1."""
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
    """Return what makes an array of one character."""
    return lambda: np.zeros((1, *shape)) + start


@dataclass
class StrideBalance:
    """Stride measurements of N characters."""

    window: Array = field(
        default_factory=_one(WINDOW_FRAMES, _COLUMNS), metadata={"shape": (WINDOW_FRAMES, _COLUMNS)}
    )
    # of the ankles along the path: mean, last (m), speed (m/s)
    distance: Array = field(default_factory=_one(3), metadata={"shape": (3,)})
    # of the distance (m2) and its speed (m2/s2)
    mean_squares: Array = field(default_factory=_one(2, start=0.05), metadata={"shape": (2,)})
    # radians
    phase: Array = field(default_factory=_one(), metadata={"shape": ()})
    frequency: Array = field(default_factory=_one(start=USUAL_FREQUENCY_RAD_PER_S), metadata={"shape": ()})
    # m along and across the path, over what is usual: mean, cosine and sine of each harmonic
    errors: Array = field(default_factory=_one(_TERMS, 2), metadata={"shape": (_TERMS, 2)})
    # of the errors
    covariance: Array = field(
        default_factory=_one(_TERMS, _TERMS, start=PRIOR_VARIANCE * np.eye(_TERMS)),
        metadata={"shape": (_TERMS, _TERMS)},
    )
    # of the correction that is in force
    fraction: Array = field(default_factory=_one(), metadata={"shape": ()})
    # 1/s
    fraction_speed: Array = field(default_factory=_one(), metadata={"shape": ()})
    # X and Z of the centre of mass and its velocity, m and m/s, which the filter follows
    mass_place: Array = field(default_factory=_one(2), metadata={"shape": (2,)})
    mass_velocity: Array = field(default_factory=_one(2), metadata={"shape": (2,)})
    # m, X and Z, of the hips in the last frame: what smooths, and all
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
        steadily, and `composed` how far their walk is from any captured one: only composed walks are smoothed.
        """
        path = _direction(velocity)
        joints = positions.astype(np.float64)
        points = joints[:, _FOOT_POINTS][..., [0, 2]]
        self._follow_phase(((points[:, 0] - points[:, 2]) * path).sum(-1))
        mass = JOINT_MASSES @ joints
        mass[:, 1] -= ground
        place = mass[:, [0, 2]] - MASS_SHIFT * self.shift
        mass[:, [0, 2]] = place + MASS_SHIFT * self.smoothing
        smoothing = self._follow_mass(place, velocity, path)
        flags = (
            np.array(stands, np.float64),
            velocity,
            self.phase[:, None],
            np.array(steady, np.float64)[:, None],
        )
        row = np.concatenate([mass, points.reshape(-1, 8), *flags], -1)
        self.window = np.concatenate([self.window[:, 1:], row[:, None]], 1)
        if any(steady):
            self._learn()
        self._fade(steady)
        if not np.count_nonzero(self.fraction):
            self.shift = self.smoothing = np.zeros_like(velocity)
            return self.shift
        terms = _terms(self.phase) / self._pendulum(mass[:, 1])
        balancing = _limited(self._missing(terms, velocity) / MASS_SHIFT, MAX_SHIFT_M)
        self.smoothing = (self.fraction * composed)[:, None] * smoothing
        self.shift = self.fraction[:, None] * _from_path(balancing, path) + self.smoothing
        return self.shift

    def _follow_mass(self, place: Array, velocity: Array, path: Array) -> Array:
        """Follow the centre of mass `(N, 2)`; return by how far the hips are moved for it to move evenly."""
        speed = (
            self.mass_velocity + velocity - self.window[:, -1, _VELOCITY]
        )  # a change of the plan is no shaking
        expected = self.mass_place + DT * speed
        away = place - expected
        lost = (np.abs(away).max(-1) > MAX_TRACKING_ERROR_M) | ~path.any(-1)
        away_along_across = _to_path(away, path)
        followed = expected + _from_path(_PLACE_GAINS * away_along_across, path)
        changed = speed + _from_path(_SPEED_GAINS * away_along_across, path)
        self.mass_place = np.where(lost[:, None], place, followed)
        self.mass_velocity = np.where(lost[:, None], velocity, changed)
        return _limited((self.mass_place - place) / MASS_SHIFT, MAX_SMOOTHING_M)

    def _follow_phase(self, apart: Array) -> None:
        """Follow the phase of the stride by how far `apart` `(N,)` the ankles are along the path."""
        least, most = FREQUENCY_RANGE_RAD_PER_S
        made = []
        for now, (mean, last, speed), (square, speed_square), phase, frequency in zip(
            apart.tolist(),
            self.distance.tolist(),
            self.mean_squares.tolist(),
            self.phase.tolist(),
            self.frequency.tolist(),
            strict=True,
        ):
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
        """Fit the harmonics to the error of the window's middle too: recursive least squares that forget."""
        middle = self.window[:, _MIDDLE]
        known = self.window[..., _LEARNS].min(-1)[:, None]
        terms = _terms(middle[:, _PHASE])
        velocity = middle[:, _VELOCITY]
        missing = _to_path(self._error(), _direction(velocity)) - self._missing(terms, velocity)
        spread = (self.covariance @ terms[..., None])[..., 0]
        gain = known * spread / (_KEEPS + (terms * spread).sum(-1, keepdims=True))
        self.errors = self.errors + gain[..., None] * missing[:, None]
        covariance = self.covariance - gain[..., None] * spread[:, None]
        known_well: Flags = np.trace(covariance, axis1=1, axis2=2) < _KEEPS * _TERMS * PRIOR_VARIANCE
        forgets = known[:, 0] * known_well
        self.covariance = covariance * (1.0 + forgets * (1.0 / _KEEPS - 1.0))[:, None, None]

    def _missing(self, terms: Array, velocity: Array) -> Array:
        """Return the metres `(N, 2)` along and across the path that terms `(N, 9)` make of what is usual and what is learnt."""
        squares = np.minimum((velocity * velocity).sum(-1), MAX_USUAL_SPEED_M_PER_S**2)
        return (terms[:, None] @ (self.errors + squares[:, None, None] * _USUAL))[:, 0]

    def _error(self) -> Array:
        """Return what the zero moment point lacks to the standing feet, `(N, 2)` metres, times the force on them over the weight."""
        mass, middle = self.window[..., _MASS], self.window[:, _MIDDLE]
        place, acceleration = _PLACE @ mass, _ACCELERATION @ mass
        weight = np.maximum(1.0 + acceleration[:, 1:2] / GRAVITY_M_PER_S2, LEAST_WEIGHT_FRACTION)
        pushed = place[:, 1:2] / GRAVITY_M_PER_S2 * acceleration[:, [0, 2]]
        zero_moment = place[:, [0, 2]] - pushed / weight
        points = middle[:, _POINTS].reshape(-1, 4, 2)
        stands: Flags = middle[:, _STANDS] > 0.5
        bears = (stands[:, :1] | ~_LEFT_BEARS) & (stands[:, 1:] | ~_RIGHT_BEARS)
        start = points[:, _STARTS]
        line, there = points[:, _ENDS] - start, zero_moment[:, None] - start
        part = (there * line).sum(-1) / np.maximum((line * line).sum(-1), MIN_DIVISOR)
        lacks = np.minimum(np.maximum(part, 0.0), 1.0)[..., None] * line - there
        distance = np.sqrt((lacks * lacks).sum(-1)) + np.where(bears, 0.0, UNREACHED_M)
        nearest = np.arange(len(lacks)), distance.argmin(-1)
        outside = np.maximum(1.0 - MARGIN_M / np.maximum(distance[nearest], MIN_DIVISOR), 0.0)
        error = np.where(stands[:, :1] | stands[:, 1:], (outside[:, None] * weight) * lacks[nearest], pushed)
        return np.minimum(np.maximum(error, -MAX_ERROR_M), MAX_ERROR_M)

    def _pendulum(self, height: Array) -> Array:
        """Return `(N, 9)` by what each term of an error is divided."""
        k = np.maximum(height, LEAST_HEIGHT_M)[:, None] / GRAVITY_M_PER_S2
        return 1.0 + k * (_ORDERS * self.frequency[:, None]) ** 2

    def _fade(self, steady: Sequence[bool]) -> None:
        """Bring the correction into force for who is `steady`, and out of it for all others."""
        now = zip(self.fraction.tolist(), self.fraction_speed.tolist(), steady, strict=True)
        faded = [damp(fraction, speed, float(on), FADE_HALF_LIFE_S, DT) for fraction, speed, on in now]
        kept = [each if max(each) > MIN_IN_FORCE_FRACTION else (0.0, 0.0) for each in faded]
        self.fraction, self.fraction_speed = np.array(kept).T


def _terms(phase: Array) -> Array:
    """Return 1, then cosine and sine of every harmonic of phases `(N,)`: `(N, 9)`."""
    orders = range(1, HARMONICS + 1)
    return np.array([[1.0, *(f(k * p) for k in orders for f in (cos, sin))] for p in phase.tolist()])


def _direction(velocity: Array) -> Array:
    """Return velocities `(N, 2)` over their speed; 0 of one that is 0."""
    return velocity / np.maximum(np.sqrt((velocity * velocity).sum(-1, keepdims=True)), MIN_SIZE)


def _limited(values: Array, most: float) -> Array:
    """Return values that are `most` at most, nearly as they were where they are small."""
    return values / np.sqrt(1.0 + (values / most) ** 2)


def _to_path(vectors: Array, path: Array) -> Array:
    """Return vectors `(N, 2)` in X and Z as their components along and across a path's direction `(N, 2)`."""
    x, z = path[:, 0], path[:, 1]
    return np.stack([x * vectors[:, 0] + z * vectors[:, 1], x * vectors[:, 1] - z * vectors[:, 0]], -1)


def _from_path(parts: Array, path: Array) -> Array:
    """Return the vectors of which `_to_path` makes `parts`."""
    return _to_path(parts, path * np.array([1.0, -1.0]))
