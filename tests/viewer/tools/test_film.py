"""Moving pictures of a clip: which moments, what is written under them, and files that open again."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from runtime.errors import FileError, UsageError
from runtime.formats.bvh_clip import save_bvh
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from tests.helpers.walker import walk
from viewer.tools import film

PROMPTS = (PromptEvent(0.0, "a proud queen"), PromptEvent(1.0, "walk like a drunk"))
SIZE = ["--size", "96", "64"]


@pytest.fixture(scope="module")
def clip() -> Clip:
    return Clip("walk", 60.0, *walk(91), prompts=PROMPTS)


def _pictures(path: Path) -> list[np.ndarray]:
    with Image.open(path) as image:
        frames = []
        for k in range(image.n_frames):
            image.seek(k)
            frames.append(np.asarray(image.convert("RGB"), np.float64))
    return frames


def test_the_part_of_a_clip_that_is_filmed(clip: Clip) -> None:
    assert len(film.cut(clip, 0.0, None)) == 91
    assert len(film.cut(clip, 1.0, 9.0)) == 31
    assert film.cut(clip, 1.0, 9.0).prompts[0].prompt == "walk like a drunk"
    for start in (-1.0, 1.5, 7.0):
        with pytest.raises(UsageError, match=r"lasts 1\.5 s"):
            film.cut(clip, start, None)


@pytest.mark.parametrize("suffix", [".webp", ".gif"])
def test_a_film_of_a_take_on_its_own_ground(clip: Clip, tmp_path: Path, suffix: str) -> None:
    bvh, out = save_bvh(clip, tmp_path / "walk.bvh"), tmp_path / f"walk{suffix}"
    assert film.main([str(bvh), "--out", str(out), "--fps", "10", *SIZE]) == 0
    pictures = _pictures(out)
    assert len(pictures) == 15
    assert pictures[0].shape == (64, 96, 3)
    upper = [p[:40] for p in pictures]  # above the captions
    assert min(np.abs(a - b).max() for a, b in zip(upper[1:], upper, strict=False)) > 8.0  # it moves


def test_the_camera_stays_before_the_character(clip: Clip, tmp_path: Path) -> None:
    bvh, out = save_bvh(clip, tmp_path / "walk.bvh"), tmp_path / "walk.gif"
    film.main([str(bvh), "--out", str(out), "--fps", "10", "--no-captions", *SIZE])
    pictures = _pictures(out)
    middle = np.array([p[8:56, 32:64].std() for p in pictures])
    sides = np.array([p[8:56, :16].std() for p in pictures])
    assert (middle > sides).all()


def test_what_cannot_be_drawn_is_named(clip: Clip, tmp_path: Path) -> None:
    bvh = str(save_bvh(clip, tmp_path / "walk.bvh"))
    for options, message in (
        (["--out", str(tmp_path / "walk.avi")], r"walk\.avi: no film"),
        (["--out", "a.gif", "--fps", "0"], "fps 0: a film has 1 to 60"),
        (["--out", "a.gif", "--size", "8", "64"], "expected 16 to"),
        (["--out", str(tmp_path / "a.gif"), "--start", "9"], "lasts 1.5 s"),
    ):
        with pytest.raises(UsageError, match=message):
            film.main([bvh, *SIZE, "--fps", "4", *options])
    with pytest.raises(FileError, match="this is a folder"):
        film.main([bvh, *SIZE, "--fps", "4", "--out", str(_folder(tmp_path / "b.gif"))])


def _folder(path: Path) -> Path:
    path.mkdir()
    return path


def test_two_clips_stand_side_by_side(clip: Clip, tmp_path: Path) -> None:
    save_bvh(clip, tmp_path / "a.bvh")
    save_bvh(Clip("short", 60.0, *walk(31)), tmp_path / "b.bvh")
    clips = [str(tmp_path / "a.bvh"), str(tmp_path / "b.bvh")]
    out = tmp_path / "both.gif"
    assert film.main([*clips, "--labels", "captured", "ours", *SIZE, "--fps", "4", "--out", str(out)]) == 0
    frames = _pictures(out)
    assert frames[0].shape == (64, 192, 3)
    assert len(frames) == 6
    with pytest.raises(UsageError, match="1 for 2 clips"):
        film.main([*clips, "--labels", "one", "--out", str(out)])
