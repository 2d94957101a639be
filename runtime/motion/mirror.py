"""Mirror images of the network's input and output.

Training uses every capture with its mirror image, so that turns are symmetric. Some asymmetric styles (one limb acts) were
captured for one side only, and the other side is shown badly or not at all (`runtime.motion.calibration`). Such a code is
walked mirrored: the network gets the mirrored state and Z^t, and its output is mirrored back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Float32Array
from runtime.motion.features import INPUT, OUTPUT, C
from runtime.skeleton import MIRROR_JOINTS, PART_JOINTS, PART_NAMES

LIMBS = 4  # the first four of the six parts: arms and legs

_POINT, _PLANE = np.array([-1, 1, 1], np.float32), np.array([-1, 1], np.float32)  # x changes its sign
# in the first two columns of a rotation, the elements that couple x with another axis
_ROTATION = np.array([1, -1, -1, -1, 1, 1], np.float32)
_ROOT = np.array([-1, 1, -1], np.float32)  # velocity x and z, yaw rate
_CONTACTS = [2, 3, 0, 1]


def _twin(part: str) -> str:
    side, _, limb = part.partition("_")
    return f"{'right' if side == 'left' else 'left'}_{limb}" if limb else part


TWINS = [PART_NAMES.index(_twin(part)) for part in PART_NAMES]
_MIDLINE = [i for i, part in enumerate(PART_NAMES) if _twin(part) == part]


def mirrored_code(z: Float32Array) -> Float32Array:
    """Return the mirrored Z^t `(6, 64)`: limb codes swapped, second half of torso and head negated.

    Requires a text network that encodes every sentence as if it spoke of the left side (`training.networks.content`).
    """
    result = z[TWINS]
    result[_MIDLINE, z.shape[1] // 2 :] *= -1.0
    return result


def _columns(limb: int) -> NDArray[np.int64]:
    """Return the columns of y that describe a limb."""
    joints = np.array(PART_JOINTS[PART_NAMES[limb]])
    found = [
        OUTPUT[name].start + (joints[:, None] * size + np.arange(size)).ravel()
        for name, size in (("joint_positions", 3), ("joint_velocities", 3), ("joint_rotations", 6))
    ]
    if limb >= 2:  # a leg
        found.append(OUTPUT["contacts"].start + 2 * (limb - 2) + np.arange(2))
    return np.concatenate(found)


_LIMB_COLUMNS = [_columns(limb) for limb in range(LIMBS)]


@dataclass(frozen=True)
class Ways:
    """Whether the network simulates a mirrored walk, and whether some limbs are taken from the opposite one."""

    mirrored: bool
    both: bool


@dataclass(frozen=True, eq=False)
class Mirror:
    """Mirrors a model's inputs and outputs; `phase` `(C,)` is -1 for phase channels that change sign."""

    phase: Float32Array

    def of_input(self, x: Float32Array) -> Float32Array:
        """Return mirrored inputs `(B, 472)`."""
        result = x.copy()
        for name in ("trajectory_positions", "trajectory_directions"):
            _turn(result, INPUT[name], lambda a: a.reshape(len(a), -1, 2) * _PLANE)
        _turn(result, INPUT["heights"], lambda a: a.reshape(len(a), -1, 3)[..., ::-1])
        for name in ("joint_positions", "joint_velocities"):
            _turn(result, INPUT[name], _mirrored_joints)
        _turn(result, INPUT["phase"], self._mirrored_phase)
        return result

    def of_output(self, y: Float32Array) -> Float32Array:
        """Return mirrored outputs `(B, 473)`."""
        result = y.copy()
        for name in ("trajectory_positions", "trajectory_directions"):
            _turn(result, OUTPUT[name], lambda a: a.reshape(len(a), -1, 2) * _PLANE)
        for name in ("joint_positions", "joint_velocities"):
            _turn(result, OUTPUT[name], _mirrored_joints)
        _turn(result, OUTPUT["root"], lambda a: a * _ROOT)
        _turn(result, OUTPUT["contacts"], lambda a: a[:, _CONTACTS])
        _turn(result, OUTPUT["phase"], self._mirrored_phase)
        _turn(
            result,
            OUTPUT["joint_rotations"],
            lambda a: a.reshape(len(a), -1, 6)[:, MIRROR_JOINTS] * _ROTATION,
        )
        return result

    def with_limbs(self, y: Float32Array, opposite: Float32Array, fractions: Float32Array) -> Float32Array:
        """Return outputs `(B, 473)` with limbs blended by `fractions` `(B, 4)` towards those of the `opposite` output."""
        result = y.copy()
        for limb, columns in enumerate(_LIMB_COLUMNS):
            result[:, columns] += fractions[:, limb : limb + 1] * (opposite[:, columns] - y[:, columns])
        return result

    def _mirrored_phase(self, phase: Float32Array) -> Float32Array:
        return np.asarray(phase.reshape(len(phase), -1, C, 2) * self.phase[:, None])


def _turn(rows: Float32Array, columns: slice, by: Any) -> None:
    rows[:, columns] = by(rows[:, columns]).reshape(len(rows), -1)


def _mirrored_joints(values: Float32Array) -> Float32Array:
    return np.asarray(values.reshape(len(values), -1, 3)[:, MIRROR_JOINTS] * _POINT)
