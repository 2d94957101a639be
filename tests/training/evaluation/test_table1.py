"""Table I: each row is trained and measured once, a run that was killed goes on, and nothing is made up."""

import json
from pathlib import Path
from typing import Any

import pytest

from runtime.errors import FileError, UsageError
from tests.helpers.synthetic_clips import save_motion
from tests.helpers.walker import walk
from training import table1
from training.ablations import SHARED
from training.evaluation.experiment import run
from training.table1 import CAPTURE, ROWS, SHIPPED, TABLE1, distances_table

CELLS = dict.fromkeys(table1.COLUMNS, 2.0)
SEEDS = 3


class Killed(BaseException):
    """What ends a process that is killed: nothing catches it."""


class Work:
    """What was trained and measured, in its order; `killed_at` stops the run at one of them, once."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.killed_at = ""

    def add(self, what: str) -> None:
        if what == self.killed_at:
            self.killed_at = ""
            raise Killed
        self.done.append(what)


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Work:
    """Stages, other methods and scores that take no time."""
    done = Work()

    def export(folder: Path) -> None:
        folder.mkdir(parents=True)
        (folder / "metadata.json").write_text("{}", encoding="utf-8")

    def stages(argv: list[str]) -> int:
        out = Path(argv[argv.index("--out") + 1])
        done.add(f"{argv[0]} {'/'.join(out.parts[-2:])}")
        assert [path.name for path in sorted(Path(argv[argv.index("--clips") + 1]).glob("*.npz"))] == {
            "100style": ["b.npz"],
            "terrain": ["c.npz"],
        }.get(out.parts[-2], ["a.npz", "b.npz", "c.npz"])
        mixture = "--decoder" in argv
        for file in () if mixture else SHARED["full"]:
            (out / file).touch()
        export(out / ("model-mixture" if mixture else "model"))
        return 0

    def method(order: Any, report: Any) -> None:
        done.add(f"method {'/'.join(order.out.parts[-3:-1])}")
        export(order.out)

    def score(plan: Any, model: Any) -> dict[str, float]:
        done.add(f"score {model} by {plan.seed}")
        return {**CELLS, "fmd_kinematic": float(len(done.done))}

    monkeypatch.setattr("training.pipeline.main", stages)
    for module in ("motion_matching", "train"):
        monkeypatch.setattr(f"training.baselines.{module}.make", method)
    monkeypatch.setattr(
        table1, "plan_of", lambda _, seed, **amounts: type("Plan", (), {"texts": {}, "seed": seed})
    )
    monkeypatch.setattr(table1, "capture_cells", lambda plan: {"fmd_kinematic": 1.0 + plan.seed})
    monkeypatch.setattr(table1, "EvaluatedModel", lambda folder, texts: "/".join(Path(folder).parts[-3:]))
    monkeypatch.setattr(table1, "cells_of", score)
    return done


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clips")
    for name, source in (("a", "accad"), ("b", "100style"), ("c", "pfnn_rollouts")):
        save_motion(folder, name, walk(60), source=source)
    return folder


def lines_of(text: str, title: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith(f"| {title} |")]


@pytest.mark.needs_torch
def test_one_command_trains_and_scores_every_row_with_three_seeds_and_goes_on_after_being_killed(
    clips: Path, tmp_path: Path, work: Work, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--train", "--nice", "0", "--clips", str(clips), "--runs", str(tmp_path / "runs")]
    for killed_at in ("all pae/seed0", "method pfnn/seed1", "score 100style/seed2/model by 2"):
        work.killed_at = killed_at
        with pytest.raises(Killed):
            run(TABLE1, words, "table1")
    assert run(TABLE1, words, "table1") == 0
    assert len(work.done) == len(set(work.done))  # each of them once
    ours = {row.folder for row in ROWS} - {"motion-matching", "pfnn", "mason2022", "style-label"}
    for seed in range(SEEDS):
        assert {f"all {name}/seed{seed}" for name in ours} <= set(work.done)
        assert f"export full/seed{seed}" in work.done
        assert f"method style-label/seed{seed}" in work.done
    assert sum(what.startswith("score ") for what in work.done) == SEEDS * (len(ROWS) + 1)
    # whole tables first
    assert work.done.index("score terrain/seed0/model by 0") < work.done.index("all full/seed1")
    text = capsys.readouterr().out
    assert "| capture, one half against the other | 3 | – | 2.0 ± 1.0 |" in text
    for title in (SHIPPED, *(row.title for row in ROWS)):
        cells = lines_of(text, title)[0].strip("| ").split(" | ")
        assert cells[1] == "3"
        assert all("±" in cell for cell in cells[2:])
    done = list(work.done)
    assert run(TABLE1, words, "table1") == 0
    assert work.done == done  # all of it was kept
    assert run(TABLE1, ["--known", str(tmp_path / "runs" / "table1.json")], "table1") == 0
    assert capsys.readouterr().out.endswith(text[-200:])


@pytest.mark.needs_torch
def test_rows_are_not_mixed_with_those_of_other_options(clips: Path, tmp_path: Path, work: Work) -> None:
    words = ["--train", "--nice", "0", "--clips", str(clips), "--runs", str(tmp_path), "--seeds", "0"]
    work.killed_at = "score pfnn/seed0/model by 0"
    with pytest.raises(Killed):
        run(TABLE1, [*words, "--only", "pfnn"], "table1")
    with pytest.raises(FileError, match=r"pfnn.seed0: trained with other options"):
        run(TABLE1, [*words, "--only", "pfnn", "--baseline-steps", "7"], "table1")
    assert run(TABLE1, [*words, "--only", "pfnn"], "table1") == 0


@pytest.mark.needs_torch
@pytest.mark.parametrize(
    ("more", "problem"),
    [
        ([], "no folder for the rows"),
        (["--runs", "RUNS"], r"no clips of pfnn_rollouts, the training data of row terrain"),
        (["--runs", "RUNS", "--only", "pae", "--nice", "20"], "--nice 20: expected 0 to 19"),
        (["--runs", "RUNS", "--seeds", "0", "-1"], "--seeds -1"),
    ],
)
def test_what_cannot_be_trained_is_refused_before_it_begins(
    clips: Path, tmp_path: Path, work: Work, more: list[str], problem: str
) -> None:
    for name in ("a", "b"):
        (tmp_path / f"{name}.npz").symlink_to(clips / f"{name}.npz")
    with pytest.raises(UsageError, match=problem):
        run(TABLE1, ["--train", "--clips", str(tmp_path), *more], "table1")
    assert work.done == []


@pytest.mark.needs_torch
def test_rows_without_training_say_so(tmp_path: Path, work: Work, capsys: pytest.CaptureFixture[str]) -> None:
    (model := tmp_path / "full" / "seed0" / "model").mkdir(parents=True)
    (model / "metadata.json").write_text("{}", encoding="utf-8")
    run(TABLE1, ["--clips", str(tmp_path), "--runs", str(tmp_path)], "table1")
    text = capsys.readouterr().out
    assert lines_of(text, "ours")[0].startswith("| ours | 1 | 2.0 | 2.0 |")
    for row in ROWS[1:]:
        assert f"| {row.title} | not run | – |" in text
        assert set(lines_of(text, row.title)[0].split(" | ")[2:]) <= {"–", "– |"}


@pytest.mark.needs_torch
def test_a_store_of_other_options_is_not_mixed_in(tmp_path: Path, work: Work) -> None:
    store = tmp_path / "table1.json"
    words = ["--clips", str(tmp_path), "--store", str(store)]
    run(TABLE1, words, "table1")
    assert set(json.loads(store.read_text(encoding="utf-8"))["cells"]) == {CAPTURE, SHIPPED}
    with pytest.raises(FileError, match="of other options"):
        run(TABLE1, [*words, "--quick"], "table1")
    store.write_text("[]", encoding="utf-8")
    with pytest.raises(FileError, match="of other options"):
        run(TABLE1, words, "table1")


RESULT = {
    "fmd": {
        "encoder": {"distance": 109.64, "ratio": 1.9, "takes": {"distance": 98.07, "ratio": 1.2}},
        "kinematic": {"distance": 31.1, "ratio": 1.1, "takes": {"distance": 29.4, "ratio": 0.8}},
    },
    "recognition": {"score": {"angry": 1.0, "old": 0.5}},
}
OTHER_SEED = {
    **RESULT,
    "fmd": {n: {**f, "takes": {"distance": 100.07, "ratio": 1.4}} for n, f in RESULT["fmd"].items()},
}


@pytest.mark.parametrize(
    ("results", "rows"),
    [
        (
            {"ours (diffusion)": RESULT, "other (mixture)": RESULT},
            ["ours (diffusion) | 98.07 (1.2 x, 1.9 x) | 29.40 (0.8 x, 1.1 x) | 75 % |", "other (mixture) | "],
        ),
        (
            {"full (diffusion)": RESULT, "full seed1 (diffusion)": OTHER_SEED},
            ["full (diffusion), 2 seeds | 99.07 ± 1.41 (1.3 x, 1.9 x) |"],
        ),
        ({"full seed1 (diffusion)": RESULT}, ["full seed1 (diffusion) | 98.07 (1.2 x, 1.9 x) |"]),
    ],
)
def test_a_row_for_each_model_with_its_reference_and_one_for_its_seeds(
    results: dict[str, Any], rows: list[str]
) -> None:
    lines = distances_table(results).splitlines()
    assert len(lines) == 2 + len(rows)
    assert all(line.startswith(f"| {row}") for line, row in zip(lines[2:], rows, strict=True))
    assert len({line.count("|") for line in lines}) == 1


@pytest.mark.needs_torch
def test_seeds_may_share_the_encoders_of_the_first(clips: Path, tmp_path: Path, work: Work) -> None:
    words = ["--train", "--nice", "0", "--clips", str(clips), "--runs", str(tmp_path), "--same-encoders"]
    rows = ["--only", "pae", "terrain"]
    with pytest.raises(FileError, match=r"pae.seed0: not trained"):
        run(TABLE1, [*words, *rows, "--seeds", "1"], "table1")
    assert run(TABLE1, [*words, *rows, "--seeds", "0"], "table1") == 0
    for name in ("pae", "terrain"):
        (tmp_path / name / "seed0" / "content_final.pt").write_bytes(b"learnt once")
    assert run(TABLE1, [*words, *rows, "--seeds", "1"], "table1") == 0
    for name in ("pae", "terrain"):
        assert (tmp_path / name / "seed1" / "content_final.pt").read_bytes() == b"learnt once"
    assert "all full/seed1" not in work.done
    (tmp_path / "table1.json").unlink()
    with pytest.raises(FileError, match=r"pae.seed1: trained with other options"):
        run(TABLE1, [*[w for w in words if w != "--same-encoders"], *rows, "--seeds", "1"], "table1")


@pytest.mark.needs_torch
def test_two_commands_fill_one_store(tmp_path: Path, work: Work, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["--clips", str(tmp_path), "--store", str(tmp_path / "table1.json")]

    def score(plan: Any, model: Any) -> dict[str, float]:
        work.add(f"score {model} by {plan.seed}")
        if plan.seed == 0:  # while the first is at work
            run(TABLE1, [*words, "--seeds", "1"], "table1")
        return CELLS

    monkeypatch.setattr(table1, "cells_of", score)
    run(TABLE1, [*words, "--seeds", "0", "1"], "table1")
    cells = json.loads((tmp_path / "table1.json").read_text(encoding="utf-8"))["cells"]
    assert {title: set(seeds) for title, seeds in cells.items()} == {CAPTURE: {"0", "1"}, SHIPPED: {"0", "1"}}
    assert len(work.done) == len(set(work.done))


def test_differences_are_taken_seed_by_seed_and_marked_where_they_are_certain() -> None:
    def cells(*recognised: float) -> dict[str, dict[str, float]]:
        return {str(seed): {**CELLS, "recognition": value} for seed, value in enumerate(recognised)}

    kept = {
        "cells": {
            "ours": cells(0.5, 0.7, 0.9),
            "PAE": cells(0.6, 0.8, 1.01),
            "4 experts": cells(0.9, 0.7, 0.5),
        }
    }
    _, _, differences = table1.markdown(kept).partition("Differences from *ours*")
    assert lines_of(differences, "PAE")[0].endswith("| **0.10 ± 0.01** |")  # though both spread by 0.2
    assert lines_of(differences, "4 experts")[0].endswith("| 0.00 ± 0.40 |")
    assert "Differences" not in table1.markdown({"cells": {"ours": cells(0.5)}})
