"""The mannequin's anatomy on the SPORT skeleton: the left half of an adult body as signed-distance shapes.

Rest coordinates: metres, sole at y = 0, facing +Z, left on +X. The right half is the mirror image.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON
from training.character.shapes import Ellipsoid, Loft, RoundCone, Shape, smooth_max, smooth_min, union

Array = NDArray[np.floating]

REST_POSITIONS = SPORT_SKELETON.rest_positions + np.array([0.0, REST_HIPS_HEIGHT, 0.0])

_ARM_Y, _ARM_Z = 1.3007, -0.0309  # the arm's axis in the T-pose
_LEG_X, _LEG_Z = 0.0753, 0.0474  # the leg's axis


def _torso() -> list[Shape]:
    trunk = Loft(
        "Spine1",
        1,
        (
            (0.815, -0.060, 0.060, -0.010, 0.060),
            (0.845, -0.130, 0.130, -0.062, 0.100),
            (0.880, -0.157, 0.157, -0.084, 0.116),
            (0.925, -0.166, 0.166, -0.091, 0.122),
            (0.970, -0.158, 0.158, -0.082, 0.119),
            (1.020, -0.138, 0.138, -0.068, 0.112),
            (1.070, -0.125, 0.125, -0.064, 0.107),
            (1.120, -0.125, 0.125, -0.073, 0.105),
            (1.180, -0.138, 0.138, -0.093, 0.108),
            (1.230, -0.150, 0.150, -0.108, 0.114),
            (1.280, -0.154, 0.154, -0.117, 0.113),
            (1.325, -0.140, 0.140, -0.115, 0.090),
            (1.360, -0.105, 0.105, -0.102, 0.052),
            (1.390, -0.066, 0.066, -0.086, 0.030),
            (1.410, -0.050, 0.050, -0.070, 0.022),
        ),
        power=2.35,
    )
    return [
        trunk,
        Ellipsoid("Spine1", (0.070, 1.262, 0.078), (0.075, 0.050, 0.040), roll=0.25),  # pectoral
        Ellipsoid("Spine1", (0.080, 1.270, -0.088), (0.065, 0.085, 0.034), roll=0.15),  # shoulder blade
        Ellipsoid("Hips", (0.073, 0.905, -0.040), (0.074, 0.082, 0.072)),  # buttock
        RoundCone("Spine1", (0.030, 1.415, -0.030), (0.150, 1.350, -0.038), 0.036, 0.030),  # trapezius
    ]


def _neck() -> list[Shape]:
    return [RoundCone("Neck1", (0.0, 1.350, -0.032), (0.0, 1.490, 0.004), 0.058, 0.050)]


def _head() -> list[Shape]:
    return [
        Ellipsoid("Head", (0.0, 1.592, 0.000), (0.073, 0.092, 0.094)),  # skull
        Ellipsoid("Head", (0.0, 1.545, 0.028), (0.062, 0.085, 0.068)),  # face
        Ellipsoid("Head", (0.0, 1.492, 0.045), (0.046, 0.036, 0.050)),  # jaw
        Ellipsoid("Head", (0.0, 1.470, 0.075), (0.022, 0.016, 0.018)),  # chin
    ]


def _features() -> list[Shape]:
    return [
        RoundCone("Head", (0.0, 1.572, 0.090), (0.0, 1.532, 0.108), 0.008, 0.0115),  # nose
        Ellipsoid("Head", (0.030, 1.588, 0.080), (0.030, 0.009, 0.016)),  # brow
        Ellipsoid("Head", (0.074, 1.545, -0.004), (0.009, 0.028, 0.017), pitch=-0.15),  # ear
    ]


def _arm() -> list[Shape]:
    upper = Loft(
        "LeftArm",
        0,
        (
            (0.150, 1.256, 1.346, -0.078, 0.018),
            (0.200, 1.250, 1.357, -0.084, 0.026),
            (0.250, 1.247, 1.353, -0.084, 0.024),
            (0.310, 1.250, 1.347, -0.080, 0.019),
            (0.370, 1.255, 1.344, -0.075, 0.017),
            (0.430, 1.261, 1.340, -0.070, 0.010),
            (0.4655, 1.261, 1.340, -0.070, 0.009),
        ),
        power=2.05,
    )
    lower = Loft(
        "LeftForeArm",
        0,
        (
            (0.4655, 1.261, 1.340, -0.070, 0.009),
            (0.500, 1.256, 1.343, -0.073, 0.013),
            (0.540, 1.259, 1.342, -0.072, 0.011),
            (0.590, 1.268, 1.334, -0.065, 0.003),
            (0.640, 1.275, 1.326, -0.061, -0.002),
            (0.675, 1.277, 1.323, -0.062, -0.001),
        ),
        power=2.05,
    )
    deltoid = Ellipsoid("LeftArm", (0.200, 1.308, -0.031), (0.066, 0.056, 0.060))
    return [upper, lower, deltoid, RoundCone("LeftForeArm", (0.462, 1.3, -0.035), (0.470, 1.3, -0.035), 0.037, 0.037)]


def _palm() -> list[Shape]:
    palm = Loft(
        "LeftHand",
        0,
        (
            (0.650, 1.278, 1.322, -0.060, -0.002),
            (0.680, 1.279, 1.319, -0.066, 0.005),
            (0.710, 1.280, 1.317, -0.072, 0.011),
            (0.738, 1.282, 1.315, -0.074, 0.013),
            (0.752, 1.286, 1.312, -0.071, 0.010),
        ),
        power=2.6,
    )
    return [palm, Ellipsoid("LeftHand", (0.695, 1.287, 0.000), (0.034, 0.015, 0.019))]


# root and tip z offsets from the arm's axis, tip x, thickness
_FINGERS = ((0.0310, 0.0400, 0.826, 0.0094), (0.0105, 0.0125, 0.840, 0.0098),
            (-0.0105, -0.0145, 0.831, 0.0094), (-0.0305, -0.0410, 0.808, 0.0084))


def _finger(root: float, tip: float, reach: float, radius: float) -> list[Shape]:
    knuckle = (0.742, _ARM_Y - 0.001, _ARM_Z + root)
    middle = (0.742 + 0.52 * (reach - 0.742), _ARM_Y - 0.005, _ARM_Z + root + 0.5 * (tip - root))
    end = (reach, _ARM_Y - 0.016, _ARM_Z + tip)
    return [
        RoundCone("LeftHandIndex1", knuckle, middle, radius * 1.05, radius * 0.95),
        RoundCone("LeftHandIndex1", middle, end, radius * 0.95, radius * 0.80),
    ]


def _thumb() -> list[Shape]:
    a, b, c, d = (0.676, 1.291, -0.010), (0.706, 1.286, 0.016), (0.736, 1.282, 0.036), (0.757, 1.280, 0.045)
    return [
        RoundCone("LThumb", a, b, 0.0150, 0.0130),
        RoundCone("LThumb", b, c, 0.0125, 0.0108),
        RoundCone("LThumb", c, d, 0.0110, 0.0090),
    ]


def _leg() -> list[Shape]:
    thigh = Loft(
        "LeftUpLeg",
        1,
        (
            (0.4893, 0.026, 0.125, 0.000, 0.103),
            (0.530, 0.025, 0.128, -0.004, 0.104),
            (0.580, 0.021, 0.136, -0.014, 0.111),
            (0.650, 0.014, 0.147, -0.028, 0.121),
            (0.720, 0.009, 0.156, -0.040, 0.128),
            (0.790, 0.006, 0.163, -0.053, 0.129),
            (0.850, 0.004, 0.168, -0.064, 0.126),
            (0.910, 0.010, 0.166, -0.060, 0.112),
            (0.950, 0.030, 0.150, -0.030, 0.090),
        ),
        power=2.1,
    )
    shin = Loft(
        "LeftLeg",
        1,
        (
            (0.070, 0.043, 0.107, 0.012, 0.082),
            (0.110, 0.044, 0.107, 0.008, 0.078),
            (0.170, 0.041, 0.110, -0.003, 0.080),
            (0.250, 0.034, 0.116, -0.019, 0.088),
            (0.320, 0.026, 0.124, -0.031, 0.095),
            (0.380, 0.023, 0.128, -0.033, 0.098),
            (0.430, 0.024, 0.127, -0.021, 0.100),
            (0.4893, 0.026, 0.125, 0.000, 0.103),
        ),
        power=2.1,
    )
    kneecap = Ellipsoid("LeftLeg", (_LEG_X, 0.492, 0.078), (0.034, 0.044, 0.030))
    return [thigh, shin, kneecap]


def _foot() -> list[Shape]:
    foot = Loft(
        "LeftFoot",
        2,
        (
            (-0.026, 0.068, 0.082, 0.018, 0.040),
            (-0.018, 0.052, 0.098, 0.004, 0.066),
            (0.005, 0.043, 0.108, -0.010, 0.096),
            (0.040, 0.041, 0.111, -0.010, 0.108),
            (0.075, 0.039, 0.114, -0.006, 0.096),
            (0.110, 0.035, 0.119, -0.004, 0.078),
            (0.150, 0.029, 0.125, -0.010, 0.060),
            (0.180, 0.028, 0.128, -0.010, 0.048),
            (0.210, 0.033, 0.124, -0.010, 0.039),
            (0.232, 0.045, 0.110, -0.008, 0.032),
            (0.242, 0.062, 0.092, 0.004, 0.022),
        ),
        power=2.5,
    )
    return [
        foot,
        Ellipsoid("LeftFoot", (0.043, 0.077, 0.042), (0.012, 0.014, 0.014)),  # inner ankle bone
        Ellipsoid("LeftFoot", (0.107, 0.067, 0.036), (0.012, 0.014, 0.014)),  # outer ankle bone
    ]


_BLENDS = {"torso": 0.045, "neck": 0.03, "head": 0.03, "features": 0.006, "arm": 0.028, "palm": 0.014,
           "thumb": 0.008, "leg": 0.03, "foot": 0.02}


@dataclass(frozen=True)
class Frames:
    """Rigid motions of the joints from the rest pose: rotations `(31, 4)` and joint positions `(31, 3)`."""

    rotations: Array
    positions: Array

    def to_rest(self, joint: str, points: Array) -> Array:
        """Points `(N, 3)` of the posed body carried back to rest coordinates with `joint`."""
        j = SPORT_SKELETON.index(joint)
        local = rotations.rotate(rotations.inverse(self.rotations[j]), points - self.positions[j])
        return local + REST_POSITIONS[j]


@dataclass(frozen=True)
class _Posed:
    shape: Shape
    frames: Frames

    @property
    def joint(self) -> str:
        return self.shape.joint

    def distance(self, points: Array) -> Array:
        return self.shape.distance(self.frames.to_rest(self.shape.joint, points))


class Body:
    """The implicit surface of the left half, x >= 0, in the rest pose or in the pose given by `frames`."""

    def __init__(self, frames: Frames | None = None) -> None:
        self.frames = frames

    @cached_property
    def parts(self) -> dict[str, list[Shape]]:
        """Shapes by part name; fingers are `finger0` (index) to `finger3`."""
        parts = {"torso": _torso(), "neck": _neck(), "head": _head(), "features": _features(), "arm": _arm(),
                 "palm": _palm(), "thumb": _thumb(), "leg": _leg(), "foot": _foot()}
        parts |= {f"finger{i}": _finger(*row) for i, row in enumerate(_FINGERS)}
        if self.frames is None:
            return parts
        return {name: [_Posed(s, self.frames) for s in shapes] for name, shapes in parts.items()}

    def part_distance(self, name: str, points: Array) -> Array:
        """Signed distance `(N,)` to one part."""
        return union(self.parts[name], points, _BLENDS.get(name, 0.004))

    def distance(self, points: Array) -> Array:
        """Signed distance `(N,)` to the whole body."""
        part = {name: self.part_distance(name, points) for name in self.parts}
        head = smooth_min(smooth_min(part["head"], part["neck"], 0.02), part["features"], 0.012)
        hand = part["palm"]
        for i in range(4):
            hand = smooth_min(hand, part[f"finger{i}"], 0.006)
        hand = smooth_min(hand, part["thumb"], 0.010)
        leg = smooth_min(part["leg"], self._above_sole(part["foot"], points), 0.03)
        body = smooth_min(part["torso"], head, 0.04)
        body = smooth_min(body, smooth_min(part["arm"], hand, 0.015), 0.045)
        return smooth_min(body, leg, 0.03)

    def _above_sole(self, foot: Array, points: Array) -> Array:
        rest = points if self.frames is None else self.frames.to_rest("LeftFoot", points)
        y = rest[:, 1]
        arch = 0.010 * np.exp(-(((rest[:, 2] - 0.085) / 0.035) ** 2)) * np.clip((0.085 - rest[:, 0]) / 0.05, 0, 1)
        return smooth_max(foot, arch - y, 0.010)

    def gradient(self, points: Array, step: float = 1e-4) -> Array:
        """Central-difference gradient `(N, 3)` of the distance."""
        result = np.empty_like(points)
        for axis in range(3):
            h = np.zeros(3)
            h[axis] = step
            result[:, axis] = (self.distance(points + h) - self.distance(points - h)) / (2 * step)
        return result

    def project(self, points: Array, iterations: int = 4) -> Array:
        """Move points `(N, 3)` onto the surface; points on the mirror plane x = 0 stay on it."""
        points = points.copy()
        middle = points[:, 0] < 1e-7
        for _ in range(iterations):
            gradient = self.gradient(points)
            gradient[middle, 0] = 0.0
            square = np.maximum(np.sum(gradient**2, axis=1), 0.05)
            move = (self.distance(points) / square)[:, None] * gradient
            length = np.linalg.norm(move, axis=1, keepdims=True)
            points -= move * np.minimum(1.0, 0.01 / np.maximum(length, 1e-9))
            points[middle, 0] = 0.0
        return points
