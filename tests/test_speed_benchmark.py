"""`python -m training.evaluation speed`: its figures, on speeds that are known and on the shipped model."""

import json
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import UsageError
from runtime.motion.features import FPS
from training.evaluation import on_straight_walks as speed
from training.evaluation.experiment import run


def test_a_steady_walk_has_neither_error_nor_deviation():
    speeds = np.concatenate([np.zeros(FPS), np.full(9 * FPS, 0.5)])
    set_off, highest, lowest, error, deviation = speed.describe(speeds, 0.5)
    assert set_off == pytest.approx(1.0)
    assert (highest, lowest) == pytest.approx((1.0, 1.0))
    assert error == pytest.approx(0.0, abs=1e-9)
    assert deviation == pytest.approx(0.0, abs=1e-9)


def test_a_swinging_walk_and_one_that_never_sets_off_are_told():
    time = np.arange(20 * FPS) / FPS
    _, highest, lowest, error, deviation = speed.describe(1.0 + 0.3 * np.sin(2 * np.pi * time / 4.0), 1.0)
    assert highest == pytest.approx(1.3, abs=0.02)
    assert lowest == pytest.approx(0.7, abs=0.02)
    assert error < 0.05
    assert deviation == pytest.approx(0.3 / np.sqrt(2), abs=0.02)
    assert speed.describe(np.zeros(10 * FPS), 1.0)[0] == float("inf")


def test_the_command_writes_its_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    monkeypatch.setattr(speed, "PROMPTS", speed.PROMPTS[:1])
    monkeypatch.setattr(speed, "TERRAINS", ("flat",))
    monkeypatch.setattr(speed, "STICKS", (1.0,))
    assert run(speed.SPEED, ["--seconds", "7", "--json", str(tmp_path / "speed.json")], "speed") == 0
    (walk,) = json.loads((tmp_path / "speed.json").read_text(encoding="utf-8"))
    assert walk["error"] < 0.15
    assert walk["highest"] < 1.6
    assert "| mean |" in capsys.readouterr().out


def test_too_short_a_walk_is_refused():
    with pytest.raises(UsageError, match="seconds"):
        run(speed.SPEED, ["--seconds", "2"], "speed")
