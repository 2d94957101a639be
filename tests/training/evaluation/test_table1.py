"""Table I: what is there is measured once, a run that was stopped goes on, and nothing is made up."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from runtime.errors import FileError
from training.evaluation import compared_models as table1
from training.evaluation.compared_models import CAPTURE, ROWS, SHIPPED, TABLE1, distances_table
from training.evaluation.experiment import run

CELLS = dict.fromkeys(table1.COLUMNS, 2.0)


def trained(runs: Path, folder: str, seed: int, model: str = "model") -> None:
    path = runs / folder / f"seed{seed}" / model
    path.mkdir(parents=True)
    (path / "metadata.json").write_text("{}", encoding="utf-8")


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of what was measured; the third one stops the run the first time."""
    done: list[str] = []

    def score(plan: Any, subject: Any, report: Any) -> dict[str, Any]:
        if len(done) == 2 and "stopped" not in done:
            done.append("stopped")
            raise KeyboardInterrupt
        done.append(subject)
        return {}

    monkeypatch.setattr(table1, "plan_of", lambda setting: type("Plan", (), {"texts": {}}))
    monkeypatch.setattr(table1, "capture_cells", lambda plan, report: {"fmd_kinematic": 1.0})
    monkeypatch.setattr(table1, "EvaluatedModel", lambda folder, texts: "/".join(Path(folder).parts[-3:]))
    monkeypatch.setattr(table1, "score_model", score)
    monkeypatch.setattr(table1, "cells_of", lambda scores: {**CELLS, "fmd_kinematic": 2.0 + len(done)})
    return done


def test_a_stopped_run_goes_on_and_rows_without_training_say_so(
    tmp_path: Path, measured: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    runs, store = tmp_path / "runs", tmp_path / "table1.json"
    for seed in range(3):
        trained(runs, "full", seed)
    trained(runs, "full", 0, "model-mixture")
    words = ["--clips", str(tmp_path), "--runs", str(runs), "--store", str(store)]
    with pytest.raises(KeyboardInterrupt):
        run(TABLE1, words, "table1")
    assert set(json.loads(store.read_text(encoding="utf-8"))["cells"]) == {CAPTURE, SHIPPED, "ours"}
    assert run(TABLE1, words, "table1") == 0
    names = [m for m in measured if m != "stopped"]
    assert len(names) == len(set(names)) == 5  # each of them once
    text = capsys.readouterr().out
    lines = {line.split(" | ")[0].strip("| "): line for line in text.splitlines() if line.startswith("| ")}
    ours = next(line for line in text.splitlines() if line.startswith("| ours | 3 |"))
    # 4, 7 and 8, as the row without diffusion came between: seeds' mean and deviation
    assert "| 6.3 ± 2.1 |" in ours
    assert "| without diffusion | 1 |" in text
    for row in ROWS:
        if row.title not in ("ours", "without diffusion"):
            assert f"| {row.title} | not run | – |" in text
            assert set(lines_of(text, row.title)[0].split(" | ")[2:]) <= {"–", "– |"}
    assert CAPTURE in lines
    assert run(TABLE1, words, "table1") == 0
    assert len([m for m in measured if m != "stopped"]) == 5  # all of it was kept


def lines_of(text: str, title: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith(f"| {title} |")]


def test_a_store_of_other_options_is_not_mixed_in(tmp_path: Path, measured: list[str]) -> None:
    store = tmp_path / "table1.json"
    run(TABLE1, ["--clips", str(tmp_path), "--store", str(store)], "table1")
    with pytest.raises(FileError, match="of these options"):
        run(TABLE1, ["--clips", str(tmp_path), "--store", str(store), "--seed", "1"], "table1")
    store.write_text("[]", encoding="utf-8")
    with pytest.raises(FileError, match="of these options"):
        run(TABLE1, ["--clips", str(tmp_path), "--store", str(store)], "table1")


RESULT = {
    "fmd": {
        "encoder": {"distance": 109.64, "ratio": 1.9, "takes": {"distance": 98.07, "ratio": 1.2}},
        "kinematic": {"distance": 31.1, "ratio": 1.1, "takes": {"distance": 29.4, "ratio": 0.8}},
    },
    "recognition": {"score": {"angry": 1.0, "old": 0.5}},
}


def test_a_row_for_each_model_with_its_reference():
    lines = distances_table({"ours (diffusion)": RESULT, "other (mixture)": RESULT}).splitlines()
    assert len(lines) == 4
    assert lines[2] == "| ours (diffusion) | 98.07 (1.2 x, 1.9 x) | 29.40 (0.8 x, 1.1 x) | 75 % |"
    assert len({line.count("|") for line in lines}) == 1


def test_seeds_of_a_model_share_a_row():
    other = {
        **RESULT,
        "fmd": {n: {**f, "takes": {"distance": 100.07, "ratio": 1.4}} for n, f in RESULT["fmd"].items()},
    }
    lines = distances_table({"full (diffusion)": RESULT, "full seed1 (diffusion)": other}).splitlines()
    assert len(lines) == 3
    assert lines[2].startswith("| full (diffusion), 2 seeds | 99.07 ± 1.41 (1.3 x, 1.9 x) |")
    alone = distances_table({"full seed1 (diffusion)": RESULT}).splitlines()
    assert alone[2].startswith("| full seed1 (diffusion) | 98.07 (1.2 x, 1.9 x) |")
