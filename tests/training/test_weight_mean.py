"""The mean of two runs' generators, and what is no pair of runs."""

from __future__ import annotations

from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

from runtime.errors import FileError, UsageError  # noqa: E402
from training.session import load_checkpoint, save_checkpoint  # noqa: E402
from training.weight_mean import average  # noqa: E402


def run(folder: Path, value: float, size: int = 3) -> Path:
    (folder / "logs").mkdir(parents=True)
    (folder / "logs" / "stage2.txt").write_text("step 5 of 5")
    for name in ("stage2_final.pt", "stage3_final.pt"):
        weights = {"w": torch.full((size,), value), "count": torch.tensor([int(value)])}
        save_checkpoint(folder / name, {"module": weights})
    save_checkpoint(folder / "content_final.pt", {"module": {"w": torch.full((2,), value)}})
    return folder


def test_generators_are_averaged_and_the_rest_is_the_later_ones(tmp_path: Path) -> None:
    average(run(tmp_path / "a", 1.0), run(tmp_path / "b", 3.0), tmp_path / "mean")
    made = load_checkpoint(tmp_path / "mean" / "stage3_final.pt")["module"]
    assert made["w"].tolist() == [2.0, 2.0, 2.0]
    assert made["count"].tolist() == [3]
    assert load_checkpoint(tmp_path / "mean" / "content_final.pt")["module"]["w"].tolist() == [3.0, 3.0]
    assert (tmp_path / "mean" / "logs" / "stage2.txt").read_text() == "step 5 of 5"


def test_runs_that_do_not_fit_and_folders_that_exist_are_refused(tmp_path: Path) -> None:
    one, other = run(tmp_path / "a", 1.0), run(tmp_path / "b", 3.0, size=4)
    with pytest.raises(FileError, match="another shape"):
        average(one, other, tmp_path / "mean")
    assert not (tmp_path / "mean").exists()
    with pytest.raises(UsageError, match="exists"):
        average(one, one, other)
