"""Calibration of a model: signs of the phases in the mirror, and leads measured on walks."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from runtime.motion.features import C
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.phrasing import ModelPhrasing
from runtime.skeleton import PART_NAMES
from training.augmentation.catalogue import part_edits
from training.export import calibrate

PLAIN = PartDescriptions(**{part: f"{part} as it is" for part in PART_NAMES})
PAIRS = ("arm.on_hip", "arm.behind_back", "leg.dragging")


def test_the_signs_of_the_phases_are_those_of_clips_and_their_mirror_images() -> None:
    random, signs = np.random.default_rng(0), np.array([1, -1, -1, 1, -1])
    clips = [random.standard_normal((90, C, 2)) for _ in range(3)]
    phase = np.concatenate([*clips, *(clip * signs[:, None] + 0.3 for clip in clips)])
    table = SimpleNamespace(names=["a", "b", "c", "a_m", "b_m", "c_m"], start=np.arange(0, 541 + 90, 90))
    assert calibrate.phase_signs(table, phase) == signs.tolist()  # type: ignore[arg-type]
    alone = SimpleNamespace(names=["a", "b"], start=[0, 90, 180])
    assert calibrate.phase_signs(alone, phase) is None  # type: ignore[arg-type]


class Told:
    """A prompter whose codes say which edits are asked for."""

    def expand(self, _prompt: str) -> SimpleNamespace:
        return SimpleNamespace(descriptions=PLAIN)

    def __call__(self, said: PartDescriptions) -> np.ndarray:
        code = np.zeros((6, 64), np.float32)
        for k, part in enumerate(PART_NAMES):
            words = getattr(said, part)
            numbers = [
                n for n, name in enumerate(part_edits()) if words in part_edits()[name].phrases.get(part, ())
            ]
            code[k, :2] = (1 + numbers[0], 1) if numbers else 0
        return code


class Codes:
    """In place of walks: their codes."""

    def make(self, codes: list) -> list:
        return codes


def test_sides_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [f"{side}_{name}" for name in PAIRS for side in ("left", "right")] + ["torso.sway", "legs.long"]
    shown = {"left_arm.on_hip": 0.62, "right_arm.on_hip": 0.22, "left_arm.behind_back": 1.0}
    monkeypatch.setattr(calibrate, "part_edits", lambda: {name: part_edits()[name] for name in names})
    monkeypatch.setattr(calibrate, "neutral_motion", lambda *_: None)
    monkeypatch.setattr(calibrate, "described_edits", lambda _: dict.fromkeys(part_edits()))
    monkeypatch.setattr(calibrate, "edit_fraction", lambda name, *_: shown.get(name, 0.95))
    monkeypatch.setattr(calibrate, "_rule_sentences", lambda _told: [{"head": ("head up",)}])
    found = calibrate.calibrated(None, Told(), Codes(), ModelPhrasing())  # type: ignore[arg-type]
    *edits, rule = found
    number = {1.0 + k: name for k, name in enumerate(part_edits())}
    rows = {(number[row["code"][0]], row["part"]): row for row in edits}
    assert len(rows) == len(edits)
    assert rows["left_arm.on_hip", "left_arm"]["lead"] == 0.4
    # training never saw the left one: whatever a walk shows, the right one is the better
    assert rows["left_arm.behind_back", "left_arm"]["lead"] == -calibrate.UNTRAINED_FRACTION
    assert rows["left_leg.dragging", "left_leg"]["lead"] == calibrate.UNTRAINED_FRACTION
    assert rows["torso.sway", "torso"]["lead"] == rows["legs.long", "left_leg"]["lead"] == rule["lead"] == 0.0
    assert ("legs.long", "right_leg") not in rows  # once for both legs
    assert rule["part"] == "head"


def test_a_model_is_measured_as_it_is_without_calibration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    (tmp_path / "metadata.json").write_text("{}", "utf-8")
    monkeypatch.setattr(
        calibrate, "read_metadata", lambda _folder: {"name": "m", "calibration": {"phase": [1] * C}}
    )
    monkeypatch.setattr(calibrate, "Prompter", lambda *_args, **_options: None)

    def load(folder: Path) -> SimpleNamespace:
        seen.append("calibration" in json.loads((folder / "metadata.json").read_text("utf-8")))
        return SimpleNamespace(name="m")

    monkeypatch.setattr(calibrate, "load_model", load)
    monkeypatch.setattr(calibrate, "phrasing_of", lambda name: name)
    monkeypatch.setattr(calibrate, "calibrated", lambda *_: [])
    calibrate.calibrate(tmp_path, [1, -1, 1, 1, 1])
    assert seen == [False]
    written = json.loads((tmp_path / "metadata.json").read_text("utf-8"))
    assert written["calibration"] == {"phase": [1, -1, 1, 1, 1], "codes": []}
