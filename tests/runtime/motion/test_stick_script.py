"""The stick of a clip as text."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.controls import Gait
from runtime.errors import UsageError
from runtime.motion.control_scripts import (
    MAX_CHARACTERS,
    PRESS_SECONDS,
    StickScript,
    StickSegment,
    parse_stick,
)
from tests.helpers.counting import python_calls

STICKS = st.builds(
    StickSegment,
    st.sampled_from([Gait.WALK, Gait.JOG, Gait.CROUCH]),
    st.floats(0.001, 600).map(lambda x: round(x, 6)),
    st.floats(-720, 720).map(lambda x: round(x, 6)),
    st.floats(0, 1).map(lambda x: round(x, 6)),
    st.none() | st.floats(-720, 720).map(lambda x: round(x, 6)),
)
SECONDS = st.floats(0.001, 600).map(lambda x: round(x, 6))
RESTS = st.builds(StickSegment, st.sampled_from([Gait.STAND, Gait.JUMP]), SECONDS)


def test_a_script_of_the_greatest_length_is_looked_up_at_once() -> None:
    script = parse_stick(("walk@9 1;" * MAX_CHARACTERS)[: MAX_CHARACTERS // 9 * 9])
    assert script(0.0).move[1] > 0.9  # sums up the segments once
    for second in range(0, 1000, 50):
        assert python_calls(lambda second=second: script(second)) < 50  # and not one for each segment


@given(st.lists(STICKS | RESTS, min_size=1, max_size=8).map(tuple))
def test_what_is_written_is_read_again(segments: tuple[StickSegment, ...]) -> None:
    script = StickScript(segments)
    assert parse_stick(str(script)) == script


@given(st.lists(STICKS | RESTS, min_size=1, max_size=8).map(tuple), st.floats(0, 5000))
def test_every_moment_has_controls_of_at_most_a_full_stick(
    segments: tuple[StickSegment, ...], time: float
) -> None:
    controls = StickScript(segments)(time)
    assert math.hypot(*controls.move) <= 1.0 + 1e-9
    assert controls.facing is None or math.hypot(*controls.facing) == pytest.approx(1.0)


def test_headings_amounts_and_facings() -> None:
    script = parse_stick("stand 2; walk 1; walk@90 1; jog@180*0.5 1; walk@90>0 1; crouch*0 1")
    assert script.seconds == 7.0
    assert script(1.99).move == (0.0, 0.0)
    assert script(2.0).move == (0.0, 1.0)
    assert script(3.5).move == pytest.approx((1.0, 0.0))
    assert (script(4.5).gait, script(4.5).move) == (Gait.JOG, pytest.approx((0.0, -0.5)))
    assert script(5.5).facing == (0.0, 1.0)
    assert (script(6.5).gait, script(6.5).move) == (Gait.CROUCH, (0.0, 0.0))
    assert script(7.5).move == (0.0, 0.0)


def test_a_jump_is_pressed_and_let_go_while_the_stick_stays() -> None:
    script = parse_stick("jog@90 1; jump 2")
    pressed, let_go = script(1.0), script(1.0 + PRESS_SECONDS)
    assert (pressed.gait, let_go.gait) == (Gait.JUMP, Gait.JOG)
    assert pressed.move == let_go.move == pytest.approx((1.0, 0.0))
    assert parse_stick("jump 1")(0.0).move == (0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "no segment"),
        ("walk", "'walk' is not GAIT"),
        ("walk 1; run 2", "no gait 'run'; expected stand, walk"),
        ("walk 0", "0 seconds"),
        ("walk nan", "is not GAIT"),
        ("walk*1.5 2", "amount 1.5; expected 0 to 1"),
        ("stand@90 2", "stand takes seconds only"),
        ("walk@x 2", "'walk@x 2'"),
        ("walk 1;" * 20000, "characters"),
    ],
)
def test_errors_name_the_segment(text: str, part: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_stick(text)
    assert part in str(caught.value)
    assert "stand 2; walk 3" in caught.value.remedy
