"""A take as NPZ and CSV: read with numpy and the csv module alone, compared with the clip."""

import csv
import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import UsageError
from runtime.formats import arrays
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.table import check_export, save_motion
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.height_map import Terrain
from tests.helpers.counting import allocated
from tests.helpers.walker import walk

CLIP = Clip("walk", 60.0, *walk(180), prompts=(PromptEvent(0.0, 'a "proud", walk'), PromptEvent(1.0, "=drunk")),
            gaits=np.ones(180, np.int8))  # fmt: skip
FLAT = Terrain.flat()


def test_an_npz_has_the_motion_and_what_is_known_of_it(tmp_path: Path) -> None:
    save_motion(CLIP, tmp_path / "a.npz", ExportOptions(), FLAT)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as found:
        positions, parents, offsets = found["positions"], found["parents"], found["offsets"]
        rotations = found["rotations"]
        assert np.abs(positions - CLIP.world()[0]).max() < 1e-4
        assert found["fps"] == 60.0
        assert list(found["gaits"][:2]) == ["walk", "walk"]
        assert [marker["name"] for marker in json.loads(str(found["prompts"]))][-1] == "=drunk"
        assert set(np.unique(found["contacts"])) <= {0.0, 1.0}
        phase, contacts = found["phase"], found["contacts"]
        assert found["root_positions"].shape == (180, 3)
    # the bones by their own quaternions, in plain numpy
    for j in range(1, 31):
        w, v = rotations[:, parents[j], :1], rotations[:, parents[j], 1:]
        turned = offsets[j] + 2 * np.cross(v, np.cross(v, offsets[j]) + w * offsets[j])
        assert np.abs(positions[:, j] - positions[:, parents[j]] - turned).max() < 1e-4, j
    steps = np.flatnonzero(np.diff(contacts[:, :2].max(axis=1)) > 0) + 1
    assert np.allclose(phase[steps[:-1], 0], 0.0)
    assert np.nanmax(phase) < 2 * np.pi


def test_a_csv_has_a_row_a_frame(tmp_path: Path) -> None:
    save_motion(CLIP, tmp_path / "a.csv", ExportOptions(fps=30.0), FLAT)
    with (tmp_path / "a.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 90
    assert rows[0]["prompt"] == 'a "proud", walk'
    assert rows[-1]["gait"] == "walk"
    at = [float(rows[45][f"LeftHand_{axis}"]) for axis in "xyz"]
    assert np.abs(np.array(at) - CLIP.world()[0][90, 20]).max() < 1e-4


@pytest.mark.parametrize("prompt", ["=1+1", "+1", "-1", "@a", "\t=1", "a=1"])
def test_no_cell_of_a_csv_is_a_formula(prompt: str, tmp_path: Path) -> None:
    save_motion(replace(CLIP, prompts=(PromptEvent(0.0, prompt),)), tmp_path / "a.csv", ExportOptions(), FLAT)
    with (tmp_path / "a.csv").open(newline="", encoding="utf-8") as file:
        (cell,) = {row["prompt"] for row in csv.DictReader(file)}
    assert cell == (prompt if prompt == "a=1" else f"'{prompt}")


def test_a_csv_of_a_longer_take_needs_no_more_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrays, "ROWS", 64)

    def peak(times: int) -> int:
        hips, local, contacts = (np.tile(part, (times, *[1] * (part.ndim - 1))) for part in walk(128))
        take = prepare(Clip("walk", 60.0, hips, local, contacts), ExportOptions(), FLAT)
        with allocated() as most:
            arrays.save_csv(take, tmp_path / "a.csv", None, None, lambda: None)
        return most[0]

    assert peak(4) < 1.2 * peak(1)


def test_parquet_has_the_columns_of_the_table(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="needs the extra [tables]")
    pytest.importorskip("pyarrow", reason="needs the extra [tables]")
    for name in ("take.csv", "take.parquet"):
        save_motion(CLIP, tmp_path / name, ExportOptions(), FLAT)
    table, again = pandas.read_csv(tmp_path / "take.csv"), pandas.read_parquet(tmp_path / "take.parquet")
    assert list(again.columns) == list(table.columns)
    numbers = [name for name in table.columns if name not in ("gait", "prompt")]
    np.testing.assert_allclose(again[numbers], table[numbers], atol=1e-6)
    assert again["prompt"].tolist() == table["prompt"].str.lstrip("'").tolist()


def test_without_pandas_the_sentence_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match="pip install pandas pyarrow"):
        check_export(Path("take.parquet"), ExportOptions())
