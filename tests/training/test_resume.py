"""A run that is killed in the middle and goes on from its checkpoint gives the same bytes as one without a break."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.training.test_composition import frames, table, texts  # noqa: F401
from training import session as training_session
from training.presets import preset
from training.sampling import sampling_weights
from training.session import Session, StageLength, load_checkpoint
from training.stages import content, diffusion, ground, motion, phase
from training.styles import StyleTable

pytestmark = pytest.mark.needs_torch

STEPS = 5
CONFIG = replace(preset("tiny"), measures=False, text_size=4, direction_words=False, one_sided_words=False)


class Killed(Exception):
    """In place of the signal that ends a process."""


def data(frames, table) -> motion.MotionData:  # noqa: F811
    generator = torch.Generator().manual_seed(1)
    style = [torch.randn(3, 64, generator=generator) for _ in range(6)]
    index = torch.randint(3, (len(table.styles), 8, 6), generator=generator)
    weights = sampling_weights(table)
    normal = motion.measure(frames, weights, Session(Path("unused"), torch.device("cpu")), 200)
    return motion.MotionData(frames, normal, StyleTable(style, index), weights)


def with_words(texts):  # noqa: F811
    """Two sentences of every part."""
    words = np.random.default_rng(0).normal(size=(2, 4)).astype(np.float32)
    index = np.arange(texts.index.size).reshape(texts.index.shape) % 2
    return replace(texts, sentences=[["a", "b"]] * 6, embeddings=[words] * 6, index=index)


def run(stage: str, out: Path, frames, table, texts, steps=STEPS, recorded=False) -> bytes:  # noqa: F811
    """What the stage leaves, as bytes."""
    session = Session(out, torch.device("cpu"), recorded=recorded, checkpoint_seconds=0.0)
    weights = sampling_weights(table)
    if stage == "phase":
        phase.run(session, CONFIG, table, weights, StageLength(steps, 8))
    elif stage == "content":
        known = content.ContentData(table, frames, weights, with_words(texts))
        content.run(session, CONFIG, known, StageLength(steps, 2))
    elif stage == "stage2":
        motion.run_stage2(session, CONFIG, data(frames, table), StageLength(steps, 8))
    elif stage == "ground":
        torch.manual_seed(4)
        neutral = np.zeros((6, CONFIG.style_size // 6), np.float32)
        known, courses = data(frames, table), data(frames, table)
        ground.run_ground(session, known, courses, motion.Generator(CONFIG), neutral, StageLength(steps, 8))
    else:
        torch.manual_seed(4)
        generator = motion.Generator(CONFIG)
        diffusion.run_stage3(session, data(frames, table), generator, StageLength(steps, 8))
    saved = load_checkpoint(out / f"{stage}.pt")
    assert saved["step"] == steps
    return b"".join(saved["average"][name].numpy().tobytes() for name in sorted(saved["average"]))


@pytest.mark.parametrize("stage", ["phase", "content", "stage2", "stage3", "ground"])
def test_a_killed_stage_goes_on_to_the_same_bytes(stage, frames, table, texts, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.setattr(diffusion, "measure_codes", lambda *_, **__: None)
    monkeypatch.setattr(phase, "encode_table", lambda *_: None)
    monkeypatch.setattr(content, "STATISTICS_WINDOWS", 16)
    whole = run(stage, tmp_path / "whole", frames, table, texts)
    optimise = training_session._optimise
    done = []

    def killed_at_the_fourth(state) -> None:
        if len(done) == 3:
            raise Killed
        done.append(state.step)
        optimise(state)

    monkeypatch.setattr(training_session, "_optimise", killed_at_the_fourth)
    with pytest.raises(Killed):
        run(stage, tmp_path / "broken", frames, table, texts)
    monkeypatch.setattr(training_session, "_optimise", optimise)
    assert done == [0, 1, 2]
    torch.manual_seed(99)  # a new process has other random numbers
    assert run(stage, tmp_path / "broken", frames, table, texts) == whole
