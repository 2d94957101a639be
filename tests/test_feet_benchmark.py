"""Skating of exported clips from the command line: the same at any rate of the file, and mistakes in one sentence."""

import re
import subprocess
import sys

import numpy as np
import pytest
from walker import walk

from runtime.assets import PROJECT_ROOT
from runtime.errors import UsageError
from runtime.formats.bvh_clip import save_bvh
from runtime.takes.clip import Clip
from training.evaluation.metrics import feet


def sliding(frames):
    """The first pose of a walk, with its toes on the ground, pushed forwards by 1 cm in each frame of 1/60 s."""
    hips, local, contacts = (np.repeat(a[:1], frames, axis=0) for a in walk(2))
    hips[:, 2] += 0.01 * np.arange(frames)
    clip = Clip("slide", 60.0, hips, local, contacts)
    lowest = clip.world()[0][..., 1].min()
    hips[:, 1] -= lowest
    return Clip("slide", 60.0, hips, local, contacts)


def measured(path, capsys):
    assert feet.main([str(path)]) == 0
    text = capsys.readouterr().out
    found = re.search(r"skating (\S+) cm per frame \(at the sole (\S+)\)", text)
    assert found is not None
    return text, tuple(map(float, found.groups()))


@pytest.mark.parametrize("fps", [30, 120])
def test_the_rate_of_the_file_does_not_change_what_is_measured(tmp_path, capsys, fps):
    clip = sliding(121)
    text, at_60 = measured(save_bvh(clip, tmp_path / "a.bvh", 60), capsys)
    assert at_60[0] > 0.2
    assert "frames a second" not in text
    text, other = measured(save_bvh(clip, tmp_path / "b.bvh", fps), capsys)
    assert other == pytest.approx(at_60, rel=0.01)
    assert f"{fps} frames a second" in text


def test_one_frame_has_no_skating(tmp_path):
    with pytest.raises(UsageError, match=r"a\.bvh.*one frame"):
        feet.main([str(save_bvh(sliding(1), tmp_path / "a.bvh"))])


def test_a_missing_file_is_one_sentence_and_exit_code_2(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "training.evaluation.metrics.feet", str(tmp_path / "none.bvh")],
        cwd=PROJECT_ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("feet: ")
    assert "none.bvh" in done.stderr
    assert done.stderr.count("\n") == 1
