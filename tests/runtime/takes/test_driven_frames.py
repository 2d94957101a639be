"""The stick of a take as one array: what is read back is what was asked for, and a frame costs 64 bytes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.controls import MAX_STICK, Controls, Gait
from runtime.takes.input_recording import InputFrame, InputFrames, InputRecorder, Keyframe, are_asked
from runtime.takes.metadata import gait_of
from tests.helpers.counting import allocated

sticks = st.tuples(*[st.floats(-MAX_STICK, MAX_STICK)] * 2)
settings_ = st.floats(-10.0, 10.0)
controls = st.builds(Controls, sticks, st.none() | sticks, st.sampled_from(Gait))
asked = st.builds(InputFrame, controls, settings_, settings_, settings_)


@given(st.lists(asked, max_size=8), st.integers(0, 8), st.integers(0, 8))
def test_frames_come_back_as_they_were_asked_for(frames: list[InputFrame], first: int, last: int) -> None:
    kept = InputFrames.of(frames)
    assert list(kept) == frames
    assert list(kept[first:last]) == frames[first:last]
    assert list(kept[:first] + kept[last:]) == frames[:first] + frames[last:]
    assert kept.gaits().tolist() == [gait_of(frame.controls) for frame in frames]
    assert are_asked(kept.rows)


@pytest.mark.parametrize(
    ("column", "value"),
    [(0, np.nan), (1, 2e6), (2, 0.5), (3, np.inf), (4, 6.0), (4, 0.5), (4, np.nan), (5, np.nan), (7, 11.0)],
)
def test_rows_that_no_step_was_asked_for_are_told_apart(column: int, value: float) -> None:
    rows = InputFrames.of([InputFrame(Controls((0.0, 1.0)), 0.7, 1.0)] * 4).rows.copy()
    assert are_asked(rows)
    rows[2, column] = value
    assert not are_asked(rows)


def test_what_is_kept_of_the_stick_is_small_and_lets_go_of_old_frames() -> None:
    controller: Any = SimpleNamespace(temperature=0.7, strength=1.0, response=0.25)
    recorder, frames = InputRecorder(), 20_000
    recorder._keyframes.append(Keyframe(0, SimpleNamespace()))  # type: ignore[arg-type]
    recorder._keyframes.append(Keyframe(15_000, SimpleNamespace()))  # type: ignore[arg-type]
    with allocated() as peak:
        for i in range(frames):
            recorder.add(Controls((i / frames, 1.0)), controller)
        inputs = recorder.cut(0)
    assert inputs is not None
    assert peak[0] < 5 * 64 * frames  # those of the recorder, one larger piece of them, and those of the take
    recorder.drop_before(16_000)
    later = recorder.cut(16_000)
    assert later.start == -1000
    assert later.frame(0).controls.move == inputs.frame(16_000).controls.move == (0.8, 1.0)
    assert later.frames == inputs.frames[15_000:]
