"""Sampling weight of every frame: styles balanced, fixed fractions of terrain and edits, transitions oversampled."""

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.motion import features
from runtime.motion.features import FPS, INPUT, OUTPUT
from runtime.skeleton import SPORT_SKELETON
from training.frames import LAYERED, FrameTable

FAVOURED_FACTOR = 3.0
TERRAIN_FRACTION, LAYERED_FRACTION = 0.18, 0.36  # of drawn frames; the rest is captured
# Exponent on a style's frames: one with a sixteenth of another's is drawn half as often. Some have one short take.
STYLE_EXPONENT = 0.25
# Starts, stops, turns and changes of gait are rare in captures but frequent in play.
MOMENT_FACTOR = 4.0
MIN_TURN_RAD = np.deg2rad(50.0)  # within a second
SPRINT_TILT_RAD = np.deg2rad(24.0)  # forward tilt of the trunk
SPRINT_M_PER_S = 2.2  # speed reached within a second from a stand
_SPRINTING = ("accad", "o3de")  # data sets whose runs from a stand are sprint starts


def sampling_weights(table: FrameTable, favoured: NDArray[np.bool_] | None = None) -> Array:
    """Return frame weights `(N,)`, sum one: fixed fractions for terrain rollouts and layered clips, the rest by style.

    Frames of `favoured` clips `(clips,)` weigh `FAVOURED_FACTOR` times as much. Held-out frames, sprint starts and the
    first frame of each clip (no previous pose) have weight 0.
    """
    weights = np.zeros(len(table))
    styles = np.array(table.styles)[table.clip]
    layered = np.array([c == LAYERED for c in table.contents])[table.clip]
    rollouts = np.array([s == "pfnn_rollouts" for s in table.sources])[table.clip] & ~layered
    usable = ~table.held_out[table.clip] & ~sprint_starts(table)
    usable[table.start[:-1]] = False
    captured = usable & ~rollouts & ~layered
    for style in np.unique(styles):
        chosen = captured & (styles == style)
        if chosen.any():
            weights[chosen] = float(chosen.sum()) ** (STYLE_EXPONENT - 1.0)
    groups = [(captured, 1.0 - TERRAIN_FRACTION - LAYERED_FRACTION), (usable & rollouts, TERRAIN_FRACTION)]
    for chosen, fraction in [*groups, (usable & layered, LAYERED_FRACTION)]:
        if chosen.any():
            own = np.where(weights[chosen] > 0, weights[chosen], 1.0)
            if favoured is not None:
                own *= np.where(favoured[table.clip[chosen]], FAVOURED_FACTOR, 1.0)
            weights[chosen] = fraction * own / own.sum()
    weights *= np.where(moments(table), MOMENT_FACTOR, 1.0)
    return weights / weights.sum()


def moments(table: FrameTable) -> NDArray[np.bool_]:
    """Return frames `(N,)` whose ±1 s window contains a start, a stop, a change between walk and jog, or a turn."""
    gait = _gaits(table)
    changes = np.zeros(len(table), bool)
    for kind in (Gait.STAND, Gait.JOG):
        own = gait[:, :, kind]
        changes |= (own.min(1) < 0.3) & (own.max(1) > 0.7)
    facing = np.asarray(table.x[:, INPUT["trajectory_directions"]], np.float32).reshape(-1, features.L, 2)
    yaw = np.arctan2(facing[..., 0], facing[..., 1])
    turned = np.angle(np.exp(1j * (yaw[:, features.L * 3 // 4] - yaw[:, features.L // 4])))
    return changes | (np.abs(turned) > MIN_TURN_RAD)


def sprint_starts(table: FrameTable) -> NDArray[np.bool_]:
    """Return frames `(N,)` of runs that start from a stand with the trunk far forward, unlike jogs."""
    captured = np.isin(np.array(table.sources), _SPRINTING)[table.clip]
    joints = table.y[:, OUTPUT["joint_positions"]].reshape(len(table), -1, 3)
    trunk = joints[:, SPORT_SKELETON.index("Neck")] - joints[:, 0].astype(np.float32)
    tilted = np.arctan2(trunk[:, 2], trunk[:, 1]) > SPRINT_TILT_RAD
    gait = _gaits(table)
    stood = gait[:, : features.L // 2 + 2, Gait.STAND].max(1) > 0.5
    path = np.asarray(table.x[:, INPUT["trajectory_positions"]], np.float32).reshape(-1, features.L, 2)
    runs = np.linalg.norm(path[:, -1] - path[:, -2], axis=1) * FPS / features.SAMPLE_STEP > SPRINT_M_PER_S
    return captured & tilted & stood & runs


def _gaits(table: FrameTable) -> Array:
    """Return gait weights `(N, 12, 6)` of the trajectory samples."""
    return table.x[:, INPUT["gait"]].reshape(len(table), features.L, features.GAITS)
