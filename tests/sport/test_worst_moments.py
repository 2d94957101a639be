"""What goes wrong outside the program: names that are too long, leftovers, numbers that are none."""

import os
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runtime.atomic import sweep, write_atomic
from runtime.controls import Controls
from runtime.errors import FileError
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.pose import Pose
from runtime.takes.input_recording import InputFrame, InputFrames, InputRecording, Keyframe, resimulated_take
from runtime.terrain.height_map import Terrain
from tests.fuzz.files import clip
from viewer.scene.simulation import Simulation


def standing(x: float = 0.0) -> Pose:
    pose = Simulation.standing(Terrain.flat()).current
    pose.hips_position[0] = x
    return pose


def test_a_bvh_with_a_name_of_250_characters_keeps_what_is_known_of_it(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 246 + ".bvh")
    save_bvh(clip(), path)
    assert load_clip_bvh(path).prompts == clip().prompts


def test_what_a_killed_program_left_is_swept(tmp_path: Path) -> None:
    endings = ("ffffff6789ab", "ffffff6789ac")
    for name in (*(f".x-sport-{end}.mp4" for end in endings), ".hidden.mp4", "x-sport-ffffff6789ab.mp4"):
        (tmp_path / name).touch()
    old = time.time() - 3600
    for name in (".x-sport-ffffff6789ab.mp4", ".hidden.mp4", "x-sport-ffffff6789ab.mp4"):
        os.utime(tmp_path / name, (old, old))
    assert [path.name for path in sweep(tmp_path)] == [".x-sport-ffffff6789ab.mp4"]
    assert sweep(tmp_path / "none") == []
    write_atomic(tmp_path / ("ü" * 100 + ".json"), "{}")  # the temporary name is no longer than the name


class Lost:
    """Driven again, it is nowhere."""

    temperature = strength = 1.0
    response = 0.0

    def __init__(self, x: float) -> None:
        self.x = x

    def step(self, _: Controls) -> Pose:
        return standing(self.x)


@pytest.mark.parametrize("x", [np.nan, np.inf, 4e11])
def test_a_take_that_is_driven_to_nowhere_is_refused(x: float, monkeypatch: pytest.MonkeyPatch) -> None:
    state: Any = SimpleNamespace(restore=lambda _: None)
    frames = InputFrames.of(InputFrame(Controls(), 1.0, 1.0) for _ in range(len(clip())))
    monkeypatch.setattr("runtime.takes.input_recording.take_snapshot", lambda _: state)
    controller: Any = Lost(x)
    with pytest.raises(FileError, match="invalid poses"):
        resimulated_take(clip(), InputRecording(frames, (), (Keyframe(0, state),)), controller, 0)
