"""The mannequin's anatomy on the SPORT skeleton: the left half of an adult body as signed-distance shapes.

Rest coordinates: metres, sole at y = 0, facing +Z, left on +X. The right half is the mirror image.
"""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON
from training.character.shapes import (
    Ellipsoid,
    Loft,
    Mirrored,
    RoundCone,
    SolidShape,
    smooth_max,
    smooth_min,
    union,
)

REST_POSITIONS = SPORT_SKELETON.rest_positions + np.array([0.0, REST_HIPS_HEIGHT, 0.0])

_ARM_Y, _ARM_Z = 1.3007, -0.0309  # the arm's axis in the T-pose
_LEG_X, _LEG_Z = 0.0753, 0.0474  # the leg's axis


def _torso() -> list[SolidShape]:
    trunk = Loft(
        1,
        (
            (0.810, -0.050, 0.050, -0.010, 0.060),
            (0.845, -0.125, 0.125, -0.060, 0.098),
            (0.880, -0.150, 0.150, -0.080, 0.113),
            (0.925, -0.160, 0.160, -0.086, 0.118),
            (0.970, -0.155, 0.155, -0.079, 0.117),
            (1.020, -0.142, 0.142, -0.068, 0.112),
            (1.070, -0.132, 0.132, -0.065, 0.107),
            (1.120, -0.132, 0.132, -0.073, 0.105),
            (1.180, -0.142, 0.142, -0.092, 0.107),
            (1.230, -0.152, 0.152, -0.107, 0.111),
            (1.280, -0.155, 0.155, -0.116, 0.108),
            (1.325, -0.142, 0.142, -0.114, 0.086),
            (1.360, -0.108, 0.108, -0.102, 0.052),
            (1.390, -0.068, 0.068, -0.084, 0.030),
            (1.410, -0.050, 0.050, -0.068, 0.020),
        ),
        power=2.45,
    )
    return [
        trunk,
        Mirrored(Ellipsoid((0.070, 1.272, 0.058), (0.080, 0.056, 0.044), roll=0.2), 0.03),  # pectoral
        Mirrored(Ellipsoid((0.080, 1.268, -0.082), (0.068, 0.088, 0.036), roll=0.15), 0.03),  # shoulder blade
        Mirrored(Ellipsoid((0.072, 0.905, -0.033), (0.072, 0.080, 0.068)), 0.012),  # buttock
        RoundCone((0.028, 1.420, -0.030), (0.150, 1.352, -0.038), 0.034, 0.030),  # trapezius
        RoundCone((0.020, 1.372, 0.030), (0.160, 1.350, -0.010), 0.011, 0.012),  # collar bone
    ]


def _neck() -> list[SolidShape]:
    return [RoundCone((0.0, 1.350, -0.032), (0.0, 1.490, 0.002), 0.058, 0.052)]


def _head() -> list[SolidShape]:
    return [
        Ellipsoid((0.0, 1.596, -0.002), (0.076, 0.092, 0.097)),  # skull
        Ellipsoid((0.0, 1.545, 0.026), (0.063, 0.086, 0.071)),  # face
        Ellipsoid((0.0, 1.495, 0.042), (0.050, 0.036, 0.052)),  # jaw
        Ellipsoid((0.0, 1.472, 0.072), (0.024, 0.016, 0.020)),  # chin
    ]


def _features() -> list[SolidShape]:
    return [
        RoundCone((0.0, 1.578, 0.084), (0.0, 1.532, 0.106), 0.009, 0.0115),  # nose
        Mirrored(RoundCone((0.010, 1.588, 0.088), (0.044, 1.588, 0.074), 0.008, 0.006), 0.012),  # brow
        Ellipsoid((0.073, 1.545, -0.006), (0.008, 0.026, 0.016), pitch=-0.15),  # ear
    ]


def _arm() -> list[SolidShape]:
    arm = Loft(
        0,
        (
            (0.150, 1.256, 1.346, -0.078, 0.018),
            (0.200, 1.250, 1.357, -0.084, 0.026),
            (0.250, 1.248, 1.352, -0.083, 0.023),
            (0.310, 1.251, 1.347, -0.081, 0.022),
            (0.370, 1.256, 1.344, -0.078, 0.018),
            (0.425, 1.261, 1.340, -0.072, 0.010),
            (0.4655, 1.259, 1.341, -0.074, 0.009),
            (0.505, 1.255, 1.345, -0.073, 0.015),
            (0.545, 1.258, 1.343, -0.072, 0.013),
            (0.590, 1.267, 1.335, -0.066, 0.005),
            (0.635, 1.276, 1.326, -0.061, -0.001),
            (0.662, 1.279, 1.322, -0.060, -0.002),
            (0.685, 1.281, 1.320, -0.062, 0.000),
        ),
        power=2.05,
    )
    deltoid = Ellipsoid((0.200, 1.308, -0.031), (0.068, 0.056, 0.060))
    return [arm, deltoid]


def _palm() -> list[SolidShape]:
    palm = Loft(
        0,
        (
            (0.640, 1.288, 1.312, -0.046, -0.016),
            (0.662, 1.281, 1.320, -0.060, -0.002),
            (0.685, 1.280, 1.319, -0.067, 0.006),
            (0.712, 1.281, 1.316, -0.073, 0.012),
            (0.736, 1.285, 1.313, -0.075, 0.014),
            (0.752, 1.290, 1.310, -0.073, 0.012),
            (0.758, 1.295, 1.306, -0.066, 0.005),
        ),
        power=2.5,
    )
    return [palm, Ellipsoid((0.695, 1.287, 0.000), (0.034, 0.015, 0.019))]


# root and tip z offsets from the arm's axis, length, thickness, how much more than the first finger it bends (degrees)
_FINGERS = (
    (0.0310, 0.0350, 0.092, 0.0098, 0.0),
    (0.0105, 0.0115, 0.104, 0.0102, 2.0),
    (-0.0105, -0.0130, 0.096, 0.0098, 6.0),
    (-0.0305, -0.0360, 0.074, 0.0088, 10.0),
)
_KNUCKLES = 0.738  # x
# Of the three phalanges: share of the length, degrees below the palm. A hand at rest is half closed.
_PHALANGES = ((0.46, 13.0), (0.30, 37.0), (0.24, 56.0))


def _finger(root: float, tip: float, length: float, radius: float, bend: float) -> list[SolidShape]:
    thickness = radius * np.array((1.05, 0.97, 0.92, 0.82))
    joints = [(_KNUCKLES, _ARM_Y - 0.001, _ARM_Z + root)]
    for share, angle in _PHALANGES:
        x, y, z = joints[-1]
        down = np.radians(angle + bend)
        joints.append(
            (
                x + share * length * np.cos(down),
                y - share * length * np.sin(down),
                z + share * (tip - root),
            )
        )
    return [RoundCone(joints[i], joints[i + 1], thickness[i], thickness[i + 1]) for i in range(3)]


def finger_drop(x: Array) -> Array:
    """How far the fingers' axes, on average, lie below the palm's at `x` `(N,)`, metres."""
    _, _, length, _, bend = np.mean(_FINGERS, axis=0)
    shares, angles = np.array(_PHALANGES).T
    down = np.radians(angles + bend)
    along = _KNUCKLES + np.concatenate([[0.0], np.cumsum(shares * length * np.cos(down))])
    drop = np.concatenate([[0.0], np.cumsum(shares * length * np.sin(down))])
    return np.interp(x, along, drop) + np.tan(down[-1]) * np.maximum(x - along[-1], 0.0)


def _thumb() -> list[SolidShape]:
    a, b, c, d = (0.676, 1.291, -0.010), (0.706, 1.283, 0.016), (0.735, 1.273, 0.034), (0.756, 1.264, 0.041)
    return [
        RoundCone(a, b, 0.0150, 0.0130),
        RoundCone(b, c, 0.0125, 0.0108),
        RoundCone(c, d, 0.0110, 0.0090),
    ]


def _leg() -> list[SolidShape]:
    leg = Loft(
        1,
        (
            (0.050, 0.046, 0.104, 0.016, 0.080),
            (0.080, 0.044, 0.106, 0.010, 0.081),
            (0.110, 0.044, 0.107, 0.008, 0.078),
            (0.170, 0.041, 0.110, -0.003, 0.080),
            (0.250, 0.034, 0.116, -0.019, 0.088),
            (0.320, 0.026, 0.124, -0.031, 0.095),
            (0.380, 0.023, 0.128, -0.032, 0.098),
            (0.430, 0.026, 0.126, -0.020, 0.099),
            (0.4893, 0.029, 0.124, -0.003, 0.103),
            (0.530, 0.027, 0.126, -0.005, 0.105),
            (0.580, 0.022, 0.135, -0.014, 0.111),
            (0.650, 0.015, 0.147, -0.028, 0.121),
            (0.720, 0.010, 0.155, -0.040, 0.127),
            (0.790, 0.007, 0.161, -0.053, 0.128),
            (0.850, 0.006, 0.162, -0.060, 0.122),
            (0.900, 0.020, 0.150, -0.046, 0.106),
            (0.940, 0.050, 0.120, -0.010, 0.070),
        ),
        power=2.1,
    )
    kneecap = Ellipsoid((_LEG_X, 0.494, 0.080), (0.032, 0.040, 0.027))
    return [leg, kneecap]


def _foot() -> list[SolidShape]:
    foot = Loft(
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
            (0.241, 0.060, 0.094, 0.002, 0.025),
            (0.246, 0.070, 0.084, 0.008, 0.018),
        ),
        power=2.5,
    )
    return [
        foot,
        Ellipsoid((0.043, 0.077, 0.042), (0.012, 0.014, 0.014)),  # inner ankle bone
        Ellipsoid((0.107, 0.067, 0.036), (0.012, 0.014, 0.014)),  # outer ankle bone
    ]


_BLENDS = {"torso": 0.045, "neck": 0.03, "head": 0.03, "features": 0.006, "arm": 0.028, "palm": 0.014,
           "thumb": 0.008, "leg": 0.03, "foot": 0.02}  # fmt: skip


def _above_sole(foot: Array, points: Array) -> Array:
    """The foot cut flat at y = 0, with an arch on the inner side."""
    x, y, z = points.T
    arch = 0.010 * np.exp(-(((z - 0.085) / 0.035) ** 2)) * np.clip((0.085 - x) / 0.05, 0, 1)
    return smooth_max(foot, arch - y, 0.010)


class Body:
    """The implicit surface of the left half, x >= 0, of the rest pose."""

    def __init__(self) -> None:
        self.parts: dict[str, list[SolidShape]] = {
            "torso": _torso(), "neck": _neck(), "head": _head(), "features": _features(), "arm": _arm(),
            "palm": _palm(), "thumb": _thumb(), "leg": _leg(), "foot": _foot(),
        }  # fmt: skip
        self.parts |= {f"finger{i}": _finger(*row) for i, row in enumerate(_FINGERS)}

    def part_distance(self, name: str, points: Array) -> Array:
        """Signed distance `(N,)` to one part: torso, neck, head, features, arm, palm, thumb, finger0..3, leg, foot."""
        return union(self.parts[name], points, _BLENDS.get(name, 0.004))

    def distance(self, points: Array) -> Array:
        """Signed distance `(N,)` to the whole body."""
        part = {name: self.part_distance(name, points) for name in self.parts}
        head = smooth_min(smooth_min(part["head"], part["neck"], 0.02), part["features"], 0.012)
        fingers = np.min([part[f"finger{i}"] for i in range(4)], axis=0)
        hand = smooth_min(smooth_min(part["palm"], fingers, 0.009), part["thumb"], 0.012)
        leg = smooth_min(part["leg"], _above_sole(part["foot"], points), 0.03)
        body = smooth_min(part["torso"], head, 0.04)
        body = smooth_min(body, smooth_min(part["arm"], hand, 0.02), 0.045)
        return smooth_min(body, leg, 0.035)

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
