"""Per-frame labels of a retargeted motion: foot contacts and gait."""

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from training.data.retarget import FPS, speed

FOOT_JOINTS = (4, 5, 9, 10)  # left heel (ankle joint), left toe, right heel, right toe
_REST = np.array([ANKLE_HEIGHT, TOE_HEIGHT, ANKLE_HEIGHT, TOE_HEIGHT])
_NEAR = np.array([0.05, 0.03, 0.05, 0.03])  # m above rest height that still count as contact
_CONTACT_ON_M_PER_S, _CONTACT_OFF_M_PER_S = 0.25, 0.45  # hysteresis
# of the root's speed above 1 m/s, added to the thresholds: 30 fps captures blur a runner's short stance
_PACE_FRACTION = 0.12
JOG_SPEED = 2.2
STAND_SPEED = 0.15
CROUCH_HEIGHT = 0.72  # m of the hips above the ground; upright is 1.0


def smooth(x: Array, seconds: float) -> Array:
    """Return the box average over time (axis 0) of about `seconds`, with repeated edges."""
    from scipy.ndimage import uniform_filter1d

    return uniform_filter1d(np.asarray(x, np.float64), max(1, round(seconds * FPS)), axis=0, mode="nearest")


def foot_contacts(positions: Array, ground: Array, slack: float = 1.0) -> NDArray[np.uint8]:
    """Return contacts `(T, 4)` from joint positions `(T, 31, 3)` and the ground height under the feet `(T, 4)`.

    `slack` scales the speed limits of contact, for captures with sliding feet.
    """
    feet = np.asarray(positions[:, FOOT_JOINTS], np.float64)
    height = feet[..., 1] - ground - _REST
    return _hysteresis(positions, feet, height < _NEAR, height < 1.3 * _NEAR, slack)


def contacts_without_ground(positions: Array) -> NDArray[np.uint8]:
    """Return contacts `(T, 4)` on unknown ground: slow, and near the joint's lowest point within half a second."""
    from scipy.ndimage import minimum_filter1d

    feet = np.asarray(positions[:, FOOT_JOINTS], np.float64)
    lowest = minimum_filter1d(feet[..., 1], round(0.5 * FPS), axis=0)
    return _hysteresis(positions, feet, feet[..., 1] < lowest + 0.02, feet[..., 1] < lowest + 0.03, 1.0)


def _hysteresis(
    positions: Array, feet: Array, near: NDArray[np.bool_], close: NDArray[np.bool_], slack: float
) -> NDArray[np.uint8]:
    from scipy.ndimage import median_filter

    pace = speed(feet)
    allowance = _PACE_FRACTION * np.maximum(speed(smooth(positions[:, 0], 0.35)) - 1.0, 0.0)[:, None]
    on = (pace < slack * _CONTACT_ON_M_PER_S + allowance) & near
    keep = (pace < slack * _CONTACT_OFF_M_PER_S + 1.5 * allowance) & close
    state = np.zeros(on.shape, bool)
    current = on[0]
    for t in range(len(on)):
        current = on[t] | (current & keep[t])
        state[t] = current
    return median_filter(state.astype(np.uint8), size=(5, 1), mode="nearest")


def label_gait(hips: Array, contacts: Array | NDArray[np.uint8], ground: Array, content: str) -> Array:
    """Return soft one-hot gait `(T, 6)` from root speed, hip height above `ground` `(T,)`, contacts and the clip's content."""
    pace = np.linalg.norm(np.gradient(smooth(hips[:, [0, 2]], 0.35), axis=0), axis=-1) * FPS
    flight = smooth(contacts.sum(1) == 0, 0.8)
    run = ("run" in content or "dash" in content) or ("mixed" in content)
    jog = (pace > JOG_SPEED) | ((flight > 0.12) & (pace > 1.2)) | (("run" in content) & (pace > 0.8) & run)
    gait = np.full(len(hips), Gait.WALK)
    gait[jog] = Gait.JOG
    gait[pace < STAND_SPEED] = Gait.STAND
    gait[smooth(hips[:, 1] - ground, 0.5) < CROUCH_HEIGHT] = Gait.CROUCH
    if "jump" in content or "hop" in content:
        from scipy.ndimage import binary_dilation, binary_opening

        air = binary_opening(contacts.sum(1) == 0, iterations=4)
        gait[binary_dilation(air, iterations=round(0.35 * FPS))] = Gait.JUMP
    if "wave" in content or "raise" in content:
        gait[:] = Gait.STAND
    return soften(np.eye(len(Gait))[gait])


def soften(gait: Array) -> Array:
    """Blend gait weights `(T, 6)` over 0.2 s at changes, without short flickers; rows sum to one."""
    from scipy.ndimage import median_filter

    hard = np.eye(gait.shape[1])[median_filter(np.argmax(gait, axis=1), size=21, mode="nearest")]
    soft = smooth(hard, 0.2)
    return (soft / soft.sum(1, keepdims=True)).astype(np.float32)
