"""From the stick to the first change that the eye sees: two frames, with weight and without."""

import numpy as np
import pytest

from runtime.controls import Controls, Gait
from runtime.motion.controller import Controller
from runtime.motion.snapshot import take_snapshot
from runtime.terrain.height_map import Terrain
from tests.helpers.shipped import shipped_model

FRAMES = 2
SEEN_M = 0.005  # two pixels of a body that is 700 pixels high
STAND, AHEAD = Controls(), Controls(move=(0.0, 1.0))
CHANGES = {
    "start": (STAND, AHEAD, 20),
    "jog": (STAND, Controls(move=(0.0, 1.0), gait=Gait.JOG), 20),
    "turn on the spot": (STAND, Controls(facing=(1.0, 0.0)), 20),
    "turn": (AHEAD, Controls(move=(1.0, 0.0)), 40),
    "stop": (AHEAD, STAND, 40),
}


@pytest.mark.parametrize("response", [0.0, 1.0])
@pytest.mark.parametrize("change", CHANGES)
def test_the_body_answers_the_stick_within_two_frames(change: str, response: float) -> None:
    before, after, frames = CHANGES[change]
    goes_on, changes = (Controller(shipped_model(), Terrain.flat(), 1, response=response) for _ in range(2))
    for _ in range(frames):
        goes_on.step(before)
    take_snapshot(goes_on).restore(changes)
    poses = [(goes_on.step(before).positions, changes.step(after).positions) for _ in range(FRAMES)]
    assert max(float(np.linalg.norm(a - b, axis=-1).max()) for a, b in poses) > SEEN_M
