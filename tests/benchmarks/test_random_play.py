"""A short random play on hurdles, where a pop was found, with the shipped model."""

from functools import partial

import numpy as np

from benchmarks.random_play import PROMPTS, play, ready, report
from runtime.motion.controller import Controller
from runtime.terrain.height_map import Terrain
from tests.helpers.shipped import shipped_model, shipped_prompter


def test_a_while_of_random_play_has_no_pop() -> None:
    codes = [np.asarray(shipped_prompter()(prompt), np.float32) for prompt in PROMPTS[:2]]
    grounds = [partial(ready, name="hurdles")]
    count = play(Controller(shipped_model(), Terrain.flat()), 0.05, 1, grounds, codes)
    assert count.failures == 0, count.first[:3]
    table = report({"model": "compact", "runs": [vars(count)]})
    assert "| compact | 1 | 180 | 0 | 0 |" in table.splitlines()[2]
