"""A short random play on hurdles, where a pop was found, with the shipped model."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.random_play import GROUNDS, PROMPTS, play, ready, report
from runtime.motion.controller import Controller
from runtime.terrain.height_map import Terrain
from tests.helpers.shipped import shipped_model, shipped_prompter


def test_a_while_of_random_play_has_no_pop() -> None:
    codes = [np.asarray(shipped_prompter()(prompt), np.float32) for prompt in PROMPTS[:2]]
    counts = [
        play(Controller(shipped_model(), Terrain.flat()), 0.05, seed, grounds, codes)
        for seed, grounds in ((1, [partial(ready, name="hurdles")]), (2, GROUNDS))
    ]
    assert [count.failures for count in counts] == [0, 0], [count.first[:3] for count in counts]
    assert "| compact | 2 | 360 | 0 | 0 |" in report(counts, "compact")[2]
