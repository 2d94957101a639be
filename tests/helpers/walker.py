"""A synthetic walker for tests without a trained network: a gait on the SPORT skeleton, and a model that plays it."""

from dataclasses import dataclass
from functools import partialmethod
from pathlib import Path

import numpy as np

import runtime.generate
import runtime.motion.model
from runtime import rotations
from runtime.feet import ik
from runtime.motion import features
from runtime.motion.controller import Controller
from runtime.motion.features import OutputParts, build_output
from runtime.motion.style import Style, StyleMix
from runtime.skeleton import ANKLE_HEIGHT, REST_HIPS_HEIGHT, SPORT_SKELETON, J

CYCLE_FRAMES = 64
STRIDE_M = 1.2  # of a whole cycle
WALK_SPEED = STRIDE_M * 60 / CYCLE_FRAMES


def walk(frames, drift=(0.0, 0.0), terrain=None, speed_share=1.0, straight=False):
    """Return hips `(T, 3)`, local rotations `(T, 31, 4)` and contacts `(T, 4)` of a walk along +Z.

    `drift` (m/s in x and z) is added to the root, so that feet skate; `speed_share` scales stride and speed. With a
    terrain the hips follow its height smoothed over a metre; the feet ignore it. `straight`: the hips vault over the
    standing leg, which is as straight as in capture (3 degrees) from heel strike to mid-stance.
    """
    t = np.arange(frames) / CYCLE_FRAMES
    z = STRIDE_M * speed_share * t
    x = np.zeros(frames)
    local = rotations.identity((frames, J)).astype(np.float64)
    ankles, pitch, contacts = [], [], []
    for side, sign in ((0, 1.0), (1, -1.0)):
        phase = np.mod(t + 0.5 * side, 1.0)
        stance = phase < 0.6
        swing = np.clip((phase - 0.6) / 0.4, 0.0, 1.0)
        ease = swing * swing * (3 - 2 * swing)
        planted = (np.floor(t + 0.5 * side) + 0.3 - 0.5 * side) * STRIDE_M * speed_share
        ankle_z = planted + ease * STRIDE_M * speed_share
        ankle_y = ANKLE_HEIGHT + 0.10 * np.sin(np.pi * swing) * speed_share
        ankles.append(np.stack([np.full(frames, 0.0753 * sign), ankle_y, ankle_z], -1))
        pitch.append(0.25 * np.sin(np.pi * swing))
        contacts += [stance.astype(float)] * 2
    hips = np.stack([x, np.full(frames, REST_HIPS_HEIGHT - 0.06), z + 0.0], -1)
    if straight:
        hips[:, 1] = _vault(z, np.stack(ankles, 1))
    axis = np.broadcast_to([1.0, 0.0, 0.0], (frames, 2, 3))
    feet = rotations.from_axis_angle(axis, np.stack(pitch, -1))
    local[:, [3, 8]] = rotations.from_axis_angle(axis, np.full((frames, 2), 0.2))
    local = ik.solve_legs(hips, local, np.stack(ankles, 1), feet)
    seconds = np.arange(frames) / 60.0
    hips = hips + np.stack([drift[0] * seconds, np.zeros(frames), drift[1] * seconds], -1)
    if terrain is not None:
        around = np.linspace(-0.5, 0.5, 11)
        hips[:, 1] += terrain.height(hips[:, :1] + 0 * around, hips[:, 2:] + around).mean(-1)
    return hips.astype(np.float32), local.astype(np.float32), np.stack(contacts, -1).astype(np.float32)


def _vault(z, ankles):
    """Return heights of hips `(T,)` at `z` over ankles `(T, 2, 3)`: the highest within reach of both legs, smoothed."""
    _, down, ahead = SPORT_SKELETON.offsets[2]
    thigh, shin = (float(np.linalg.norm(SPORT_SKELETON.offsets[j])) for j in (3, 4))
    across = ankles[:, :, 2] - z[:, None] - ahead
    reach = ankles[..., 1] + np.sqrt((0.9996 * (thigh + shin)) ** 2 - across**2)
    highest = np.pad(reach.min(axis=1) - down, 3, "edge")
    return np.lib.stride_tricks.sliding_window_view(highest, 7).mean(axis=1)


@dataclass(eq=False)
class WalkerModel:
    """Cycles the walk along its trajectory input, with the interface of `runtime.motion.model.MotionModel`.

    `style` tilts the head, so that another Z^t gives another motion; frame `broken_at` is not finite.
    """

    broken_at: int = -1

    def __post_init__(self):
        self.name, self.provider = "walker", "Test"
        self.noise_shape = (2, 2, features.OUTPUT_SIZE)
        self.batches = False
        self.style_shape = (6, 64)
        self.neutral = np.zeros(self.style_shape, np.float32)
        self.prompt_path = None
        self.calibration = None
        self.folder = Path("walker")
        self.frame = 0
        hips, local, self._contacts = walk(CYCLE_FRAMES)
        positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
        self._positions = positions - hips[:, None] * np.array([1.0, 0.0, 1.0])
        self._rotations = rotations.to_6d(world)
        phase = np.zeros((features.L + 1, features.C, 2))
        output = self._y(0, np.zeros(2), 0.0, 0.0)[0].tolist()
        self.metadata = {"start": {"output": output, "phase": phase.ravel().tolist()}, "name": self.name}

    def crosses(self, obstacle):
        """Return False."""
        return False

    def fold_style(self, z, strength=1.0):
        z = np.asarray(z, np.float32)
        return Style(z, z[:1], z[:1], z[:1], WALK_SPEED, 2.5)

    def neutral_style(self, mirrored):
        return self.fold_style(self.neutral)

    def step(self, x, noise, style):
        self.frame += 1
        ahead = x[0, features.INPUT["trajectory_positions"]].reshape(features.L, 2)
        facing = x[0, features.INPUT["trajectory_directions"]].reshape(features.L, 2)
        velocity = (ahead[8] - ahead[6]) * 3.0  # 20 frames ahead
        turn = np.arctan2(*facing[8]) * 3.0
        y = self._y(self.frame, velocity, turn, float(style.z.mean()) + 1e-4 * float(noise.mean()))
        if self.frame == self.broken_at:
            y[:] = np.nan
        return y, np.ones((1, 2), np.float32)

    def _y(self, frame, velocity, turn, tilt):
        k = frame % CYCLE_FRAMES
        seconds = np.arange(6) / 6.0
        rotation = self._rotations[k].copy()
        head = SPORT_SKELETON.index("Head")
        rotation[head] = rotations.to_6d(rotations.from_axis_angle(np.array([0.0, 0, 1]), np.array(tilt)))
        parts = OutputParts(
            trajectory_positions=seconds[:, None] * velocity,
            trajectory_directions=np.stack([np.sin(turn * seconds), np.cos(turn * seconds)], -1),
            joint_positions=self._positions[k],
            joint_velocities=np.zeros((J, 3)),
            root=np.array([velocity[0], velocity[1], turn]),
            contacts=self._contacts[k],
            phase=np.zeros((7, features.C, 2)),
            joint_rotations=rotation,
        )
        return build_output(parts)[None]


class OtherStyles:
    """A fake prompt encoder: different prompts give different Z^t."""

    def style(self, prompt, exact_legs):
        code = np.full((6, 64), (sum(map(ord, prompt)) % 100) / 200.0, np.float32)
        return StyleMix((1.0,), (code,))


def settle_soon(patch):
    """Let characters settle for a tenth of a second, instead of two, before they are shown."""
    patch.setattr(Controller, "settle", partialmethod(Controller.settle, seconds=0.1))


def generate_by_walker(patch, prompter=lambda *_: OtherStyles()):
    """Let `generate_clip` and its command use the synthetic walker, in styles of the fake encoder."""
    patch.setattr(runtime.motion.model, "load_model", lambda folder=None, threads=1: WalkerModel())
    patch.setattr(runtime.generate, "Prompter", prompter)
    settle_soon(patch)
