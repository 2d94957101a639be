"""Text of other encodings, numbers without sense and names that are no text: read where they can be, else a sentence."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from runtime.controls import Controls, Gait
from runtime.errors import FileError, PromptError, TerrainError, UsageError
from runtime.formats.bvh import parse_bvh, read_bvh
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.generate import parse_prompts
from runtime.motion.controller import Controller
from runtime.takes.clip import Clip
from runtime.terrain.files import read_terrain
from runtime.terrain.height_map import Terrain
from sport import cli
from tests.helpers.shipped import shipped_model
from tests.runtime.test_hostile_files import MOTION, chain


def test_latin_1_and_byte_order_marks_are_read(tmp_path: Path) -> None:
    clip = Clip("c", 60.0, np.zeros((2, 3), np.float32), np.tile(np.float32([1, 0, 0, 0]), (2, 31, 1)),
                np.zeros((2, 4), np.float32))  # fmt: skip
    text = save_bvh(clip, tmp_path / "a.bvh").read_text(encoding="utf-8")
    corners = "v 0 0 0\nv 3 0 0\nv 3 0.5 3\nf 1 3 2\n"
    facet = "solid é\nfacet normal 0 1 0\nouter loop\nvertex 0 0 0\nvertex 3 0 3\nvertex 3 0 0\nendloop\nendfacet\nendsolid é\n"
    off = "OFF\n# é\n3 1 0\n0 0 0\n3 0 0\n3 0 3\n3 0 2 1\n"
    for encoding in ("latin-1", "utf-8-sig", "utf-16"):
        (tmp_path / "b.bvh").write_bytes(text.encode(encoding))
        assert len(load_clip_bvh(tmp_path / "b.bvh")) == 2
        for suffix, ground in (("obj", f"# é\n{corners}"), ("stl", facet), ("off", off)):
            path = tmp_path / f"b.{suffix}"
            path.write_bytes(ground.encode(encoding))
            assert read_terrain(path).heights.shape == (31, 31)
    named = text.replace("LeftHandIndex1", "Zeigefingerä").encode("latin-1")
    assert "Zeigefingerä" in parse_bvh(named).skeleton.names


@pytest.mark.parametrize(
    ("old", "new"),
    [("CHANNELS 3", "CHANNELS"), ("CHANNELS 3", "CHANNELS ²"), ("Xposition Y", "Yposition Y"),
     ("OFFSET 0", "OFFSET 1e39"), ("1 2 3", "1 1e300 3"), ("1 2 3", "1 nan 3"), ("Frames: 1", "Frames: " + "9" * 5000)],
)  # fmt: skip
def test_a_bvh_without_sense_is_a_sentence(old: str, new: str) -> None:
    text = chain(2, "Xposition Yposition Zposition") + MOTION.format(1) + "1 2 3\n"
    parse_bvh(text)
    with pytest.raises(FileError):
        parse_bvh(text.replace(old, new, 1))


def test_a_clip_on_another_planet_is_refused(tmp_path: Path) -> None:
    clip = Clip("c", 60.0, np.full((2, 3), 2e7, np.float32), np.tile(np.float32([1, 0, 0, 0]), (2, 31, 1)),
                np.zeros((2, 4), np.float32))  # fmt: skip
    with pytest.raises(FileError):
        load_clip_bvh(save_bvh(clip, tmp_path / "far.bvh", unit="m"))


def test_prompts_with_times_that_are_none() -> None:
    assert [e.seconds for e in parse_prompts("4.5: b ;0:a: c")] == [0.0, 4.5]
    for script in ("9" * 400 + ":a", "1e400:a", "inf:a", "nan:a", "٣:a", "4000:a", ";".join(["0:a"] * 1001)):
        with pytest.raises(PromptError, match="Prompts with times"):
            parse_prompts(script)


def test_the_command_refuses_what_its_own_reader_would_refuse(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "long.bvh"
    assert cli.main(["generate", "--seconds", "1000", "--fps", "1000", "--out", str(out)]) == 2
    assert "a BVH may have" in capsys.readouterr().err
    assert not out.exists()


def test_the_library_refuses_what_has_no_sense() -> None:
    nan, inf = float("nan"), float("inf")
    for wrong in (
        {"facing": (nan, 0.0)}, {"move": (inf, 0.0)}, {"gait": 99}, {"move": None}, {"move": (0.0,)},
        {"gait": "walk"}, {"move": ("a", 1)},
    ):  # fmt: skip
        with pytest.raises(UsageError, match="Controls"):
            Controls(**wrong)
    assert Controls((0.0, 2.0), (0.0, 1.0), Gait.JOG).gait == Gait.JOG
    odd = [np.full((3, 3), value) for value in (nan, inf)]
    for heights in (np.zeros((1, 1)), np.zeros((1, 5)), np.zeros(4), *odd):
        with pytest.raises(TerrainError):
            Terrain("t", heights, 0.1, (0.0, 0.0))
    with pytest.raises(TerrainError):
        Terrain("t", np.zeros((3, 3)), nan, (0.0, 0.0))
    model = shipped_model()
    for options in ({"seed": -1}, {"temperature": nan}, {"strength": inf}):
        with pytest.raises(UsageError, match="Controller"):
            Controller(model, Terrain.flat(), **options)
    controller = Controller(model, Terrain.flat())
    for call in (lambda: controller.reset(nan), lambda: controller.set_style(model.neutral, nan)):
        with pytest.raises(UsageError, match="Controller"):
            call()


def test_messages_can_be_shown_whatever_a_file_is_called(tmp_path: Path) -> None:
    name = os.fsdecode(b"caf\xe9\n.bvh")
    with pytest.raises(FileError) as caught:
        read_bvh(tmp_path / name)
    str(caught.value).encode()
    assert "\n" not in str(caught.value)
    assert json.dumps(caught.value.problem)
