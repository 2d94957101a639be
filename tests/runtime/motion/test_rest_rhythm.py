"""A clock for what goes on moving in a standing body."""

import numpy as np
import pytest

from runtime.motion.features import FPS, PHASE_OFFSETS, C
from runtime.motion.phase import RestRhythm
from tests.helpers.shipped import shipped_model, shipped_prompter

PRESENT = int(-PHASE_OFFSETS[0])
STILL = np.tile(np.array([0.3, 0.4]), (PHASE_OFFSETS[-1] - PHASE_OFFSETS[0] + 1, C, 1))
WAVING = np.zeros((C, 2))
WAVING[3] = 2.0, 1.6


def run(clock: RestRhythm, rest: np.ndarray, standing: float, seconds: float) -> np.ndarray:
    """The window of every frame, `(T, 121, C, 2)`, of a network whose forecast stands still."""
    rest, standing = rest[None], np.array([standing])
    return np.concatenate([clock.apply(STILL[None], rest, standing) for _ in range(round(seconds * FPS))])


def test_a_waving_channel_turns_at_its_rate_and_the_others_stand_still():
    windows = run(RestRhythm.silent(), WAVING, 1.0, 5.0)
    wanted = np.broadcast_to(STILL[:, [0, 1, 2, 4]], windows[:, :, :4].shape)
    assert windows[:, :, [0, 1, 2, 4]] == pytest.approx(wanted)
    hand = windows[3 * FPS :, :, 3]
    assert np.linalg.norm(hand, axis=-1) == pytest.approx(np.full(hand.shape[:2], 2.0), abs=0.01)
    angle = np.unwrap(np.arctan2(hand[:, PRESENT, 0], hand[:, PRESENT, 1]))
    assert (angle[-1] - angle[0]) / (2 * np.pi) * FPS / (len(angle) - 1) == pytest.approx(1.6, abs=0.01)
    coming = hand[:-1, PRESENT + 1]  # what is forecast is what comes
    assert coming == pytest.approx(hand[1:, PRESENT], abs=0.02)


def test_it_leaves_when_the_body_sets_off_and_does_nothing_for_a_quiet_style():
    clock = RestRhythm.silent()
    wanted = np.broadcast_to(STILL, (FPS, *STILL.shape))
    assert run(clock, np.zeros((C, 2)), 1.0, 1.0) == pytest.approx(wanted)
    run(clock, WAVING, 1.0, 4.0)
    left = run(clock, WAVING, 0.0, 4.0)
    assert np.abs(left[0] - STILL).max() > 0.5  # not at once
    assert left[-1] == pytest.approx(STILL)


@pytest.mark.needs_torch
def test_the_rhythm_of_standing_clips_is_read_off_their_words():
    import torch

    from runtime.controls import Gait
    from runtime.motion.features import INPUT, MOTION_INPUT_SIZE, OUTPUT_SIZE, L
    from training.export.pace import rest_rhythm
    from training.frames import FrameTable
    from training.styles import StyleTable

    frames, clips = 120, 3  # a quiet one, a waving one, and one that walks
    gait = np.zeros((clips, frames, L, len(Gait)), np.float16)
    gait[:2, :, :, Gait.STAND] = gait[2, :, :, Gait.WALK] = 1.0
    x = np.zeros((clips * frames, MOTION_INPUT_SIZE), np.float16)
    x[:, INPUT["gait"]] = gait.reshape(clips * frames, -1)
    nothing = np.zeros((len(x), 1), np.float32)
    table = FrameTable(
        x=x, y=np.zeros((len(x), OUTPUT_SIZE), np.float16), heights=nothing, ground=nothing,
        previous_ground=nothing, upper=nothing, clip=np.repeat(np.arange(clips), frames), start=np.arange(clips + 1) * frames,
        styles=["a", "b", "c"], sources=["made"] * clips, contents=["stand"] * clips, names=["a", "b", "c"],
        mirrored=np.zeros(clips, bool), held_out=np.zeros(clips, bool), patches=np.ones(clips, int),
    )  # fmt: skip
    turns = 1.6 * np.arange(frames) / FPS
    phase = np.zeros((clips, frames, C, 2)) + np.array([0.3, 0.4])
    phase[1, :, 3] = 2.0 * np.stack([np.sin(2 * np.pi * turns), np.cos(2 * np.pi * turns)], -1)
    phase[2] = 9.0
    words = [torch.tensor([[1.0] * 64, [-1.0] * 64, [0.0] * 64])] * 6
    style = StyleTable(words, torch.arange(clips)[:, None, None].expand(-1, 1, 6).contiguous())
    fitted = rest_rhythm(table, phase.reshape(-1, C, 2), style)
    quiet, waving = (np.full(384, sign) @ fitted[:-1] + fitted[-1] for sign in (1.0, -1.0))
    assert quiet[:C] == pytest.approx(np.full(C, 0.5), abs=0.05)
    assert (waving[3], waving[C + 3]) == pytest.approx((2.0, 1.6), abs=0.05)


@pytest.mark.parametrize(
    ("prompt", "swings"),
    [("waving with the left hand", True), ("waving with the right hand", True), ("a person who waves", True),
     ("walk like a giant", False), ("a proud queen", False), ("an angry man", False)],
)  # fmt: skip
def test_who_was_asked_to_wave_waves_and_nobody_else(prompt: str, swings: bool) -> None:

    model = shipped_model()
    clock = RestRhythm.silent()
    clock.apply(STILL[None], model.fold_style(shipped_prompter()(prompt)).rest[None], np.ones(1))
    assert bool(clock.fraction.any()) == swings
