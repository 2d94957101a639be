"""Phases of three kinds over the same walks: what is told of them is so of walks whose answer is known."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sklearn")
pytest.importorskip("matplotlib")

from runtime.errors import FileError, UsageError
from runtime.motion.features import OUTPUT, OUTPUT_SIZE, C
from runtime.skeleton import PART_JOINTS, SPORT_SKELETON, J
from training.evaluation import phase_spaces
from training.evaluation.experiment import run
from training.evaluation.phase_spaces import PHASES, arm_held, differing, walks_of
from training.evaluation.report.phase_figures import draw


def frames_of(styles: tuple[str, ...], seconds: int = 80) -> SimpleNamespace:
    """A clip of each style that walks at 1 m/s."""
    length = 60 * seconds
    y = np.zeros((length * len(styles), OUTPUT_SIZE), np.float16)
    y[:, OUTPUT["root"].start + 1] = 1.0
    return SimpleNamespace(
        y=y,
        styles=list(styles),
        contents=["walk"] * len(styles),
        mirrored=np.zeros(len(styles), bool),
        start=np.arange(len(styles) + 1) * length,
        clip=np.repeat(np.arange(len(styles)), length),
    )


def test_windows_are_of_walks_and_as_many_of_each_style():
    frames = frames_of(("neutral", "drunk", "old"))
    frames.y[frames.start[2] :, OUTPUT["root"]] = 0.0  # it stands
    with pytest.raises(FileError, match="too few walks"):
        walks_of(frames_of(("neutral",)), 0)
    walks = walks_of(frames, 0)
    assert walks.names == ("drunk", "neutral")
    assert np.bincount(walks.styles).tolist() == [phase_spaces.WINDOWS] * 2
    assert (np.linalg.norm(frames.y[walks.rows][:, OUTPUT["root"]][:, :2], axis=-1) > 0.6).all()


def test_a_held_arm_moves_with_the_chest_and_nothing_else_changes():
    velocities = np.random.default_rng(0).standard_normal((2, 121, J, 3))
    held = arm_held(velocities)
    arm = list(PART_JOINTS["left_arm"])
    rest = [j for j in range(J) if j not in arm]
    assert (held[:, :, rest] == velocities[:, :, rest]).all()
    chest = velocities[:, :, SPORT_SKELETON.index("Spine1")]
    assert all((held[:, :, j] == chest).all() for j in arm)


def test_channels_differ_by_amplitude_or_frequency():
    random = np.random.default_rng(0)
    one = [random.normal(0.0, 1.0, (400, C)) for _ in range(2)]
    other = [part.copy() for part in one]
    other[0][:, 1] += 3.0  # amplitude
    other[1][:, 4] -= 3.0  # frequency
    none = np.zeros((400, C, 2))
    assert differing((none, *one), (none, *other)).tolist() == [False, True, False, False, True]


def test_figures_are_drawn_and_a_known_table_is_made_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    random = np.random.default_rng(0)
    walks = phase_spaces.Walks(np.arange(80), np.repeat([0, 1], 40), ("chicken", "neutral"))
    names = (phase_spaces.FOOTSTEPS, "PAE", phase_spaces.OURS)
    spaces = {name: random.normal(size=(80, 26)) + walks.styles[:, None] for name in names}
    figures = {name: {"silhouette": 0.25, "arm": 0.2, "styles": 0.8, "error": 0.3} for name in names}
    code = (np.zeros((40, C, 2)), random.random((40, C)), random.random((40, C)))
    codes = {name: {0: code, 1: code} for name in names[1:]}
    drawn = draw(tmp_path, spaces, walks.styles, walks.names, figures, (codes, codes), 0)
    assert [path.name for path in drawn] == ["fig6_phase_spaces.png", "fig7_channels.png"]
    assert all(path.stat().st_size > 10_000 for path in drawn)
    known = tmp_path / "figures.json"
    known.write_text(json.dumps(figures), encoding="utf-8")
    assert run(PHASES, ["--known", str(known)], "phases") == 0
    assert "| BP-PAE | 0.250 | 30.0 | 0.20 | 0.80 |" in capsys.readouterr().out
    with pytest.raises(UsageError, match="--run"):
        run(PHASES, ["--clips", str(tmp_path)], "phases")
    with pytest.raises(UsageError, match="--rival x: has no name"):
        run(PHASES, ["--clips", str(tmp_path), "--run", str(tmp_path), "--rival", "x"], "phases")
