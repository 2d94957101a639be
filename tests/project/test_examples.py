"""The numbered examples run as they are, and leave the files that they speak of."""

import json
import os
import re
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from runtime.formats.bvh_clip import load_clip_bvh
from runtime.motion.model import load_model
from runtime.prompts.edit_targets import edited_parts
from runtime.prompts.phrasing import adherence_of
from runtime.prompts.prompter import Prompter
from runtime.terrain.library import load_terrain
from tests.helpers.documents import ROOT, text_of

EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
MAX_LINES = 80  # a page
pytestmark = pytest.mark.usefixtures("quick_clips")


@pytest.fixture
def run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[str], str]:
    """Run an example in this process, in `tmp_path`; what it printed."""

    def here(name: str) -> str:
        path = str(ROOT / "examples" / name)
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [path])
        capsys.readouterr()
        runpy.run_path(path, run_name="__main__")
        return capsys.readouterr().out

    return here


def run_alone(name: str, folder: Path) -> str:
    """Run an example in a process of its own, as one that starts others needs it; what it printed."""
    command = [sys.executable, str(ROOT / "examples" / name)]
    paths = {"PYTHONPATH": os.pathsep.join((str(ROOT), os.environ.get("PYTHONPATH", "")))}
    environment = os.environ | paths
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_examples_are_numbered_pages_that_the_index_names() -> None:
    index = text_of(ROOT / "examples" / "README.md")
    assert [path.name[:2] for path in EXAMPLES] == [f"{n + 1:02}" for n in range(len(EXAMPLES))]
    for path in EXAMPLES:
        assert f"]({path.name})" in index, path
        assert text_of(path).count("\n") <= MAX_LINES, path
        assert f"def test_{path.stem[:2]}_" in text_of(Path(__file__)), f"{path}: no test runs it"


def test_01_clip_from_prompt(tmp_path: Path, run: Callable[[str], str]) -> None:
    shown = run("01_clip_from_prompt.py")
    assert len(load_clip_bvh(tmp_path / "soldier.bvh")) == 90
    assert "left_arm: left arm hanging" in shown


def test_02_drive_by_code(tmp_path: Path, run: Callable[[str], str]) -> None:
    assert "0 way points left" in run("02_drive_by_code.py")
    clip = load_clip_bvh(tmp_path / "way.bvh")
    assert [event.prompt for event in clip.prompts] == ["a proud queen", "a limping old man"]
    assert clip.hips_positions[-1, 2] > 4.0


def test_03_own_ground(tmp_path: Path, run: Callable[[str], str]) -> None:
    run("03_own_ground.py")
    ground, clip = load_terrain(tmp_path / "ramp.npy"), load_clip_bvh(tmp_path / "ramp.bvh")
    assert clip.hips_positions[-1, 1] > clip.hips_positions[0, 1] + 0.3
    hips = clip.hips_positions
    over = hips[:, 1] - ground.height(hips[:, 0], hips[:, 2])
    assert np.all((over > 0.4) & (over < 1.4))


def test_04_own_character(tmp_path: Path, run: Callable[[str], str]) -> None:
    assert "31 of its joints" in run("04_own_character.py")
    assert all((tmp_path / f"posed_{frame}.obj").stat().st_size > 100_000 for frame in (0, 30, 60))


def test_05_blending(tmp_path: Path, run: Callable[[str], str]) -> None:
    heights = [float(cm) for cm in re.findall(r"hands +([-+][\d.]+) cm", run("05_blending.py"))]
    assert len(heights) == 5
    assert heights[-1] > heights[0] + 10.0  # the arms of an aeroplane are out
    assert len(load_clip_bvh(tmp_path / "blend.bvh")) == 120


def test_06_batch_goes_on_where_it_stopped(tmp_path: Path) -> None:
    clips = tmp_path / "clips"
    clips.mkdir()
    kept = {name: {"name": name, "file": f"{name}.bvh"} for name in ("queen_0", "man_0", "man_1")}
    (clips / "manifest.json").write_text(json.dumps(kept), encoding="utf-8")
    assert "3 of 5 are there" in run_alone("06_batch.py", tmp_path)
    manifest = json.loads((clips / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["queen_1"]["frames"] == len(load_clip_bvh(clips / "queen_1.bvh")) == 60
    assert "the moon" in manifest["broken"]["error"]
    assert not (clips / "queen_0.bvh").exists()  # it was in the manifest


@pytest.mark.needs_torch
def test_07_evaluate_model(run: Callable[[str], str]) -> None:
    shown = run("07_evaluate_model.py")
    speeds = [float(share) for share in re.findall(r"speed ([\d.]+) of the request", shown)]
    assert len(speeds) == 6
    assert all(0.8 < share < 1.2 for share in speeds)
    distances = re.findall(r": ([\d.]+), ([\d.]+)$", shown, re.M)
    assert len(distances) == 3
    assert all(float(seeds) < float(styles) for seeds, styles in distances)


def test_prompts_of_the_documents_are_shown_by_the_shipped_model() -> None:
    model = load_model()
    library, adherence = Prompter(model).library, adherence_of(model.name)
    documents = "".join(map(text_of, [ROOT / "README.md", *(ROOT / "docs" / "guide").glob("*.md")]))
    prompts = set(re.findall(r'--(?:prompt|blend) "([^"]+)"', documents)) - {"ein müder Soldat"}
    assert len(prompts) >= 5
    for prompt in prompts:
        words = library.expand(prompt).descriptions
        assert adherence.note(words, words, edited_parts(words)) == "", prompt
