"""The reel of moments: where its rows begin, in ours and in captures."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.controls import Gait
from runtime.motion.stick_script import parse_stick
from viewer.tools import reel


def test_every_moment_begins_just_before_the_stick_moves() -> None:
    stick = parse_stick(reel.SCRIPT)
    changes, second = [], 0.0
    for segment in stick.segments:
        changes.append(second)
        second += segment.seconds
    for moment in reel.MOMENTS:
        coming = min(c for c in changes if c > moment.seconds)
        assert coming - moment.seconds == pytest.approx(0.1), moment.title
        gait = stick.segments[changes.index(coming)].gait
        assert ("jump" in moment.title) == (gait == Gait.JUMP), moment.title
    assert max(m.seconds for m in reel.MOMENTS) + reel.COLUMNS * reel.INTERVAL_S <= stick.seconds


def test_a_capture_begins_where_it_sets_off_and_where_it_slows() -> None:
    t = np.arange(360) / 60
    speed = np.interp(t, [1.0, 2.0, 4.0, 5.0], [0.0, 1.2, 1.2, 0.0])
    hips = np.stack([np.cumsum(speed) / 60, np.ones(360), np.zeros(360)], -1)
    assert reel.begins(hips, 60.0, "start") == pytest.approx(1.17, abs=0.05)
    assert reel.begins(hips, 60.0, "stop") == pytest.approx(4.2, abs=0.05)
    assert reel.heading(hips) == pytest.approx(np.pi / 2)
