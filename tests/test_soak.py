"""The endurance run tells a walk from a figure that glides in one pose, and counts what it saw."""

import json

import numpy as np
import pytest
from walker import WalkerModel

from runtime.controls import Controls, Gait
from runtime.errors import UsageError
from runtime.motion.controller import Controller
from runtime.terrain.height_map import Terrain
from training.evaluation.experiment import run
from training.evaluation.motion import soak


def play(controller, frames, controls, frozen_from=None):
    """A segment of steady walking; from `frozen_from` on the pose stays and the root glides on."""
    segment = soak.SoakSegment(controller.terrain)
    for frame in range(frames):
        pose = controller.step(controls)
        if frozen_from is not None and frame > frozen_from:
            held = segment.poses[frozen_from]
            way = pose.root_position - held.root_position
            values = vars(held) | {
                "positions": held.positions + way,
                "hips_position": held.hips_position + way,
                "root_position": pose.root_position,
            }
            pose = type(held)(**values)
        segment.poses.append(pose)
        segment.gaits.append(controls.gait)
        segment.asked.append(controller.requested_speed)
        segment.since_change.append(frame)
    return segment


@pytest.fixture(scope="module")
def segments():
    forward = Controls((0.0, 1.0), gait=Gait.WALK)
    return [
        play(Controller(WalkerModel(), Terrain.flat(size_m=100.0)), 330, forward, frozen)
        for frozen in (None, 200)
    ]


def test_feet_of_a_walk_move_and_those_of_a_frozen_figure_do_not(segments):
    walking, frozen = (np.array([share for _, share in soak.foot_movement(s)]) for s in segments)
    assert len(walking) == len(frozen) == 3  # whole seconds after it settled
    assert walking.min() > 0.6
    assert frozen[0] > 0.6
    assert frozen[2] == pytest.approx(0.0, abs=1e-3)


def test_standing_is_not_frozen():
    segment = play(Controller(WalkerModel(), Terrain.flat()), 200, Controls())
    assert soak.foot_movement(segment) == []


def test_frozen_seconds_and_growing_memory_miss_their_bars(segments):
    good = soak.summarise([soak.measure(segments[0])], [100.0, 110.0])
    assert not {"frozen poses", "memory growth"} & set(good["missed"])
    bad = soak.summarise([soak.measure(s) for s in segments], [100.0, 300.0])
    assert {"frozen poses", "memory growth"} <= set(bad["missed"])
    assert bad["frozen_gaits"] == {"walk": bad["frozen_seconds"]}
    assert bad["frozen_seconds"] >= 1
    json.dumps(bad)


def test_minutes_out_of_range_are_named():
    with pytest.raises(UsageError, match="--minutes 0"):
        run(soak.SOAK, ["--minutes", "0"], "soak")


def test_resident_memory_is_that_of_this_process():
    used = soak.resident_mb()
    assert np.isnan(used) or 10.0 < used < 10_000.0
