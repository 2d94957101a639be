"""Which side a model shows better: signs of the phases in the mirror, and leads measured on walks."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from runtime.errors import FileError
from runtime.motion.features import C
from runtime.motion.model import load_model
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES
from tests.test_layering import walker
from training.export import sides
from training.layering.catalog import EDITS
from training.layering.measured_edits import summarise

PLAIN = PartDescriptions(**{part: f"{part} as it is" for part in PART_NAMES})
PAIRS = ("arm.on_hip", "arm.behind_back", "leg.dragging")


def test_the_signs_of_the_phases_are_those_of_clips_and_their_mirror_images() -> None:
    random, signs = np.random.default_rng(0), np.array([1, -1, -1, 1, -1])
    clips = [random.standard_normal((90, C, 2)) for _ in range(3)]
    phase = np.concatenate([*clips, *(clip * signs[:, None] + 0.3 for clip in clips)])
    table = SimpleNamespace(names=["a", "b", "c", "a_m", "b_m", "c_m"], start=np.arange(0, 541 + 90, 90))
    assert sides.phase_signs(table, phase) == signs.tolist()  # type: ignore[arg-type]
    with pytest.raises(FileError, match="mirror image"):
        sides.phase_signs(SimpleNamespace(names=["a", "b"], start=[0, 90, 180]), phase)  # type: ignore[arg-type]


class Told:
    """A prompter whose codes say which edits are asked for."""

    def expand(self, _prompt: str) -> SimpleNamespace:
        return SimpleNamespace(descriptions=PLAIN)

    def __call__(self, said: PartDescriptions) -> np.ndarray:
        code = np.zeros((6, 64), np.float32)
        for k, part in enumerate(PART_NAMES):
            words = getattr(said, part)
            numbers = [n for n, name in enumerate(EDITS) if words in EDITS[name].phrases.get(part, ())]
            code[k, 0] = 1 + numbers[0] if numbers else 0
        return code


class OneSided:
    """Walks that show whatever is asked of the left limbs and nothing of the right ones."""

    def make(self, walks: list) -> list:
        from training.layering.apply import apply

        made = []
        for walk in walks:
            numbers = np.frombuffer(walk.z, np.float32).reshape(6, 64)[:, 0]
            motion = walker(420)
            asked = [list(EDITS)[int(n) - 1] for n in numbers if n]
            if asked and asked[0].startswith("left"):
                motion = apply(motion, EDITS[asked[0]], np.random.default_rng(0))
            made.append(summarise(motion.hips, motion.local, motion.contacts))
        return made


def test_a_side_that_is_not_shown_falls_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = {f"{side}_{name}": EDITS[f"{side}_{name}"] for name in PAIRS for side in ("left", "right")}
    monkeypatch.setattr(sides, "EDITS", kept)
    monkeypatch.setattr(sides, "neutral_motion", lambda _model, _z: walker(420))
    found = sides.measured_sides(None, Told(), OneSided())  # type: ignore[arg-type]
    assert [each["part"] for each in found] == ["left_arm", "left_arm", "left_leg"]
    on_hip, behind_back, dragging = (each["lead"] for each in found)
    assert on_hip > 0.9
    assert dragging > 0.8
    assert behind_back == -sides.UNTRAINED  # training never saw the left one, whatever a walk shows
    assert found[0]["code"][0] == pytest.approx(1 + list(EDITS).index("left_arm.on_hip"))


def test_the_shipped_models_know_their_mirror_image() -> None:
    for name in ("compact", "open"):
        mirror = load_model(name).mirror
        assert mirror is not None, name
        pairs = [edit for edit in EDITS if re.search("left", edit) and edit.replace("left", "right") in EDITS]
        assert len(mirror.measured) == len(pairs), name
        assert set(np.abs(mirror.phase).tolist()) == {1.0}


def test_sides_are_measured_without_the_mirror(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    (tmp_path / "metadata.json").write_text("{}", "utf-8")
    monkeypatch.setattr(sides, "read_metadata", lambda _folder: {"name": "m", "mirror": {"phase": [1] * C}})
    monkeypatch.setattr(sides, "Prompter", lambda *_args, **_options: None)

    def load(folder: Path) -> None:
        seen.append("mirror" in json.loads((folder / "metadata.json").read_text("utf-8")))

    monkeypatch.setattr(sides, "load_model", load)
    monkeypatch.setattr(sides, "measured_sides", lambda *_: [])
    sides.fit_sides(tmp_path, [1, -1, 1, 1, 1])
    assert seen == [False]
    written = json.loads((tmp_path / "metadata.json").read_text("utf-8"))
    assert written["mirror"] == {"phase": [1, -1, 1, 1, 1], "codes": []}
