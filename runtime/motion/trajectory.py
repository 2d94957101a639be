"""Where the character was and is requested to go: ±1 s of root path, facing and gait, blended from stick and network."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.motion import features, momentum
from runtime.motion.features import FPS, GAITS, SAMPLE_STEP, TRAJECTORY_OFFSETS
from runtime.motion.momentum import Plan
from runtime.motion.phase import unwrapped
from runtime.spring import decay
from runtime.terrain.height_map import Terrain

PRESENT = 60  # index of the current frame in the dense ±60 frame window
LENGTH = 2 * PRESENT + 1
SAMPLES = TRAJECTORY_OFFSETS + PRESENT  # the network's 12 samples

# How strongly the stick overrules the network along the coming second: 1 - (1 - t)^bias at time t of it.
POSITION_BIAS = 8.0
DIRECTION_BIAS = 3.0

_AT = features.FUTURE_OFFSETS.astype(float)  # the network's coming samples,
_FRAMES = np.arange(1, LENGTH - PRESENT)  # the coming frames,
_BEYOND = np.maximum(_FRAMES - _AT[-1], 0.0) / SAMPLE_STEP  # and how far each lies after the last sample
_TIME = _FRAMES / (LENGTH - PRESENT - 1)
_ALONG = (1 - (1 - _TIME) ** POSITION_BIAS)[:, None]
_AROUND = 1 - (1 - _TIME) ** DIRECTION_BIAS
# shares (60, 6) of the samples in every coming frame, the last one kept beyond it; and going on as it went
_KEPT = np.maximum(1.0 - np.abs(np.minimum(_FRAMES, _AT[-1])[:, None] - _AT) / SAMPLE_STEP, 0.0)
_GOING_ON = _KEPT.copy()
_GOING_ON[:, -1] += _BEYOND
_GOING_ON[:, -2] -= _BEYOND


def wrap_angle(angle: Array | float) -> Array:
    """Angles in radians brought to -pi..pi."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


@dataclass(frozen=True)
class TrajectoryView:
    """What the viewer draws: the 12 samples in world space."""

    positions: Array  # (12, 3)
    directions: Array  # (12, 2)


@dataclass
class Trajectory:
    """Dense windows of 121 frames of N characters."""

    xz: Array = field(metadata={"shape": (LENGTH, 2)})  # (N, 121, 2)
    yaw: Array = field(metadata={"shape": (LENGTH,)})  # (N, 121) unwrapped
    gait: Array = field(metadata={"shape": (LENGTH, GAITS)})  # (N, 121, 6)
    wish: Array = field(metadata={"shape": (2,)})  # (N, 2) the stick's velocity, smoothed, m/s
    wish_yaw: Array = field(metadata={"shape": ()})  # (N,) the stick's facing, smoothed, radians
    velocity: Array = field(metadata={"shape": (2,)})  # (N, 2) planned, m/s
    requested_yaw: Array = field(metadata={"shape": ()})  # (N,)

    @staticmethod
    def standing(x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Trajectory:
        """Of one character that stands at x, z."""
        gait = np.zeros((1, LENGTH, GAITS))
        gait[..., 0] = 1.0
        xz = np.tile(np.array([x, z], np.float64), (1, LENGTH, 1))
        return Trajectory(
            xz,
            np.full((1, LENGTH), float(yaw)),
            gait,
            np.zeros((1, 2)),
            np.array([float(yaw)]),
            np.zeros((1, 2)),
            np.array([float(yaw)]),
        )

    @property
    def here(self) -> Array:
        """XZ of the roots in this frame, `(N, 2)`."""
        return self.xz[:, PRESENT]

    def view(self, terrain: Terrain, index: int = 0) -> TrajectoryView:
        """The 12 samples of one character, laid on the terrain."""
        xz, yaw = self.xz[index, SAMPLES], self.yaw[index, SAMPLES]
        height = terrain.height(xz[:, 0], xz[:, 1])
        directions = np.stack([np.sin(yaw), np.cos(yaw)], axis=-1)
        return TrajectoryView(np.stack([xz[:, 0], height, xz[:, 1]], -1), directions)

    def plan(
        self,
        wish: Array,
        facing: Array,
        gait: NDArray[np.integer],
        walk: Array,
        jog_from: Array,
        response: Array,
    ) -> Plan:
        """The coming second on the way to velocities `(N, 2)` (m/s), facings `(N,)` (radians, not a number keeps it) and gaits.

        `walk` `(N,)` are the styles' walking speeds, `response` `(N,)` is 0 (capture) to 1 (game). Moves `wish`, `wish_yaw`,
        `velocity` and `requested_yaw` on by a frame.
        """
        seconds = momentum.change_seconds(walk, response)
        quick = decay(momentum.WISH_HALF_LIFE) ** (momentum.GAME**-response)
        self.wish = wish + (self.wish - wish) * quick[:, None]
        velocities = momentum.velocities(self.velocity, self.wish, walk, seconds)
        goal = np.where(np.isnan(facing), self.requested_yaw, facing)
        # a plan that turns at once makes the network's pose jump: elbows by 10 degrees in a frame
        self.wish_yaw = goal + wrap_angle(self.wish_yaw - goal) * quick
        around = momentum.turn_seconds(np.sqrt((self.velocity**2).sum(-1)), walk, response)
        yaws = momentum.facings(self.requested_yaw, self.wish_yaw, around)
        self.velocity, self.requested_yaw = velocities[:, 1], yaws[:, 1]
        speeds = np.sqrt((velocities * velocities).sum(-1))
        return Plan(
            velocities, yaws, momentum.labels(speeds, self.gait[:, PRESENT], gait, jog_from, response)
        )

    def steer(self, plan: Plan) -> None:
        """Blend a plan into the coming second."""
        self.xz, self.yaw, self.gait = self.xz.copy(), self.yaw.copy(), self.gait.copy()
        ahead = self.xz[:, PRESENT:]
        steps = ahead[:, 1:] - ahead[:, :-1]
        steps += (plan.velocities[:, 1:] / FPS - steps) * _ALONG
        ahead[:, 1:] = ahead[:, :1] + np.cumsum(steps, axis=1)
        turning = self.yaw[:, PRESENT + 1 :]
        turning += wrap_angle(plan.yaws[:, 1:] - turning) * _AROUND
        self.gait[:, PRESENT:] = plan.gaits

    def advance(self, displacement: Array, turn: Array, positions: Array, directions: Array) -> None:
        """Move on by one frame, after `steer`, in its windows: displacements `(N, 2)` metres and turns `(N,)` radians.

        `positions`, `directions` `(N, 6, 2)` are the network's coming samples (0, 10 ... 50 frames on); all in world space.
        """
        for window in (self.xz, self.yaw, self.gait):
            window[:, :PRESENT] = window[:, 1 : PRESENT + 1]
        self.xz[:, PRESENT] += displacement
        self.yaw[:, PRESENT] += turn
        self.xz[:, PRESENT + 1 :] = self.xz[:, PRESENT, None] + _GOING_ON @ (positions - positions[:, :1])
        angle = np.arctan2(directions[..., 0], directions[..., 1]) - self.yaw[:, PRESENT, None]
        relative = unwrapped(wrap_angle(angle)[..., None])
        self.yaw[:, PRESENT + 1 :] = self.yaw[:, PRESENT, None] + (_KEPT @ relative)[..., 0]
