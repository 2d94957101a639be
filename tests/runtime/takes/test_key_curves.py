"""Curves through pose and camera keys: what edits of single keys leave as it was."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.takes.camera_keys import CameraKey
from runtime.takes.key_curves import Channel, Curve, CurveKey, KeyedCurves, span_of
from runtime.takes.pose_layer import PoseKey, PoseLayer, Tangent

FPS, FRAMES = 60.0, 240
HEAD, HIPS = 16, 0


def curves_of(frames: list[int]) -> KeyedCurves:
    """Keys of the head's turn and the hips' shift at frames, and of the camera at the same ones."""
    keys = [
        PoseKey(frame / FPS)
        .with_value(Curve.TURN, HEAD, np.array([0.1, 0.01 * n, -0.2]))
        .with_value(Curve.MOVE, HIPS, np.array([0.0, -0.02 * n, 0.1]))
        for n, frame in enumerate(frames)
    ]
    cameras = [CameraKey(frame / FPS, 0.1 * n, 0.2, 3.0 + n) for n, frame in enumerate(frames)]
    return KeyedCurves(PoseLayer(tuple(keys)), tuple(cameras), FPS, FRAMES)


FRAMES_OF_KEYS = st.lists(st.integers(0, FRAMES - 1), min_size=2, max_size=6, unique=True).map(sorted)
CHANNELS = [Channel(Curve.TURN, HEAD, 1), Channel(Curve.MOVE, HIPS, 0), Channel(Curve.CAMERA, -1, 2)]


def test_channels_are_joints_in_order_then_the_camera():
    found = curves_of([10, 40]).channels()
    assert [(each.curve, each.joint) for each in found[::3]] == [
        (Curve.MOVE, HIPS), (Curve.TURN, HEAD), (Curve.CAMERA, -1), (Curve.CAMERA, -1),
    ]  # fmt: skip
    assert [each.unit for each in found[::3]] == ["cm", "°", "°", "m"]


@given(FRAMES_OF_KEYS)
def test_a_curve_passes_its_keys(frames):
    curves = curves_of(frames)
    for channel in curves.channels():
        keys = curves.keys(channel)
        assert list(keys) == frames
        shown = curves.values(channel, np.array(frames) / FPS)
        assert shown == pytest.approx(list(keys.values()), abs=1e-6)


@given(FRAMES_OF_KEYS, st.sampled_from(CHANNELS), st.integers(-300, 300), st.floats(-2.0, 2.0), st.data())
def test_a_moved_key_takes_its_curve_along_and_no_other(frames, channel, by, value, data):
    curves = curves_of(frames)
    key = CurveKey(channel, data.draw(st.sampled_from(frames)))
    went = curves.bounded([key], by)
    made = curves.moved([key], by, lambda _: value)
    assert 0 <= key.frame + went < FRAMES
    expected = max(curves.keys(channel)[key.frame] + value, 0.1 if channel.curve is Curve.CAMERA else -1e9)
    assert made.keys(channel)[key.frame + went] == pytest.approx(expected, abs=1e-6)
    one = (channel.curve, channel.joint)
    others = [each for each in curves.channels() if (each.curve, each.joint) != one]
    assert all(made.keys(each) == curves.keys(each) for each in others)
    left = {f: v for f, v in curves.keys(channel).items() if f not in (key.frame, key.frame + went)}
    assert left.items() <= made.keys(channel).items()


@given(FRAMES_OF_KEYS, st.integers(-100, 100))
def test_all_keys_together_keep_their_distances(frames, by):
    curves = curves_of(frames)
    every = [CurveKey(channel, frame) for channel in curves.channels() for frame in frames]
    went, made = curves.bounded(every, by), curves.moved(every, by, lambda _: 0.0)
    for channel in curves.channels():
        moved = {frame + went: value for frame, value in curves.keys(channel).items()}
        assert made.keys(channel) == pytest.approx(moved)
    assert made.moved([key._replace(frame=key.frame + went) for key in every], -went, lambda _: 0.0) == curves


@given(FRAMES_OF_KEYS, st.sampled_from(CHANNELS), st.data())
def test_a_removed_key_is_gone_from_its_curve_alone(frames, channel, data):
    curves = curves_of(frames)
    frame = data.draw(st.sampled_from(frames))
    made = curves.removed([CurveKey(channel, frame)])
    for each in curves.channels():
        own = (each.curve, each.joint) == (channel.curve, channel.joint)
        assert (frame in made.keys(each)) is not own


@given(FRAMES_OF_KEYS, st.sampled_from(CHANNELS), st.integers(0, FRAMES - 1))
def test_a_key_that_is_set_lies_on_the_curve(frames, channel, frame):
    curves = curves_of(frames)
    before = curves.values(channel, np.array([frame / FPS]))[0]
    assert curves.inserted(channel, frame).keys(channel)[frame] == pytest.approx(before, abs=1e-6)


def test_tangents_belong_to_pose_keys():
    curves = curves_of([10, 40])
    keys = [CurveKey(CHANNELS[0], 10), CurveKey(CHANNELS[2], 10)]
    made = curves.with_tangent(keys, Tangent.STEP)
    assert [made.tangent(key) for key in keys] == [Tangent.STEP, None]
    assert made.tangent(CurveKey(CHANNELS[0], 40)) is Tangent.SMOOTH
    moved = made.moved(keys[:1], 5, lambda _: 0.0)
    assert moved.tangent(CurveKey(CHANNELS[0], 15)) is Tangent.STEP


@pytest.mark.parametrize(
    ("values", "least", "span"), [([], 4.0, 4.0), ([1.0], 4.0, 4.0), ([0.0, 10.0], 4.0, 12.0)]
)
def test_what_a_plot_shows_has_room_around_the_keys(values, least, span):
    low, high = span_of(values, least)
    assert high - low == pytest.approx(span)
    assert all(low <= value <= high for value in values)
