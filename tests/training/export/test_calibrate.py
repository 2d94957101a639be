"""Calibration of a model: signs of the phases in the mirror, and leads and gains measured on walks."""

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
            told = [edit.phrases.get(part, ()) for edit in part_edits().values()]
            numbers = [n for n, phrases in enumerate(told) if words in phrases]
            code[k, :2] = (1 + numbers[0], 1) if numbers else 0
        return code


class Gains:
    """In place of walks: by how much their codes are drawn out, and whether more is asked of them than one edit asks."""

    def make(self, codes: list) -> list:
        return [(float(z[:, 1].max()), (z[:, 1] > 0).sum() > 3) for z in codes]


def test_sides_and_gains_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [f"{side}_{name}" for name in PAIRS for side in ("left", "right")]
    names += ["torso.sway", "legs.long", "head.nodding", "head.up_far"]
    names += [name for group in calibrate.COMPANIONS for name in group]
    shown = {"left_arm.on_hip": 0.62, "right_arm.on_hip": 0.22, "left_arm.behind_back": 1.0}
    shown |= {"torso.sway": 0.44, "head.nodding": 0.3}
    beside = {"legs.long": 0.7, "torso.sway": 0.4, "torso.slump": 0.1}
    asked: list[tuple[str, float, bool]] = []

    def share(name: str, _example: object, _plain: object, walked: tuple[float, bool]) -> float:
        gain, others = walked
        asked.append((name, gain, others))
        return min(1.0, (beside if others else shown).get(name, 0.95) * gain)

    monkeypatch.setattr(calibrate, "part_edits", lambda: {name: part_edits()[name] for name in names})
    monkeypatch.setattr(calibrate, "neutral_motion", lambda *_: None)
    monkeypatch.setattr(calibrate, "described_edits", lambda _: dict.fromkeys(part_edits()))
    monkeypatch.setattr(calibrate, "edit_fraction", share)
    monkeypatch.setattr(calibrate, "_rule_sentences", lambda _told: [])
    found = calibrate.calibrated(None, Told(), Gains(), ModelPhrasing())  # type: ignore[arg-type]
    number = {1.0 + k: name for k, name in enumerate(part_edits())}
    rows = {(number[row["code"][0]], row["part"]): row for row in found}

    def gains(name: str) -> tuple[float, float]:
        row = rows[name, part_edits()[name].slot.replace("legs", "left_leg")]
        return row["gain"], row["gain_beside"]

    assert len(rows) == len(found)
    assert rows["left_arm.on_hip", "left_arm"]["lead"] == 0.4
    assert gains("left_arm.on_hip") == (1.5, 1.5)
    # training never saw the left one: whatever a walk shows, the right one is the better
    assert rows["left_arm.behind_back", "left_arm"]["lead"] == -calibrate.UNTRAINED
    assert rows["left_leg.dragging", "left_leg"]["lead"] == calibrate.UNTRAINED
    assert gains("left_arm.behind_back") == gains("left_leg.dragging") == gains("head.up_far") == (1.0, 1.0)
    assert gains("head.nodding") == (1.0, 1.0)  # not shown wholly by any gain
    assert gains("legs.long") == (1.0, 1.25)  # shown less beside others
    assert gains("torso.sway") == (2.0, 2.0)
    assert gains("torso.slump") == (1.0, 1.0)
    assert ("legs.long", "right_leg") not in rows  # once for both legs
    assert not {name for name, _, others in asked if others} & {"left_arm.on_hip", "left_arm.folded"}


def test_a_model_is_measured_as_it_is_without_calibration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    (tmp_path / "metadata.json").write_text("{}", "utf-8")
    metadata = {"name": "m", "calibration": {"phase": [1] * C}}
    monkeypatch.setattr(calibrate, "read_metadata", lambda _folder: metadata)
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
