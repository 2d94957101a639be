"""A walk that the tests of edits bend."""

import numpy as np
import pytest

from runtime import rotations
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON, J
from runtime.takes.clip import Clip

FRAMES, SPEED_M_PER_S = 180, 0.6


@pytest.fixture(scope="session")
def walk() -> Clip:
    """Legs and arms swing once a second; each foot bears while its leg swings back."""
    t = np.arange(FRAMES) / 60.0
    local = np.tile(rotations.identity((J,)), (FRAMES, 1, 1)).astype(float)
    x, z, swing = np.eye(3)[0], np.eye(3)[2], 0.35 * np.sin(2 * np.pi * t)
    for name, sign in (("LeftUpLeg", 1.0), ("RightUpLeg", -1.0)):
        local[:, SPORT_SKELETON.index(name)] = rotations.from_axis_angle(x, sign * swing)
    for name in ("LeftLeg", "RightLeg"):
        local[:, SPORT_SKELETON.index(name)] = rotations.from_axis_angle(x, np.full(FRAMES, 0.25))
    for name, angle, sign in (("LeftArm", -1.2, -1.0), ("RightArm", 1.2, 1.0)):
        down = rotations.from_axis_angle(z, np.full(FRAMES, angle))
        turn = rotations.from_axis_angle(x, sign * swing)
        local[:, SPORT_SKELETON.index(name)] = rotations.multiply(turn, down)
    hips = np.stack([0 * t, np.full(FRAMES, REST_HIPS_HEIGHT - 0.03), SPEED_M_PER_S * t], -1)
    back = np.gradient(swing) > 0
    contacts = np.stack([back, back, ~back, ~back], -1)
    return Clip("walk", 60.0, *(a.astype(np.float32) for a in (hips, local, contacts)))
