"""Captions must be true of the motion they describe: poses made for the purpose, and what is said of them."""

import json
from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.errors import FileError
from runtime.measures.table import measure
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import SPORT_SKELETON, mirror_motion
from tests.helpers.synthetic_clips import save_motion
from training.text.clip_measures import average, captions_of, measure_clips, write_clip_captions
from training.text.descriptions import describe

FRAMES = 240
Z = np.array([0.0, 0.0, 1.0])
X = np.array([1.0, 0.0, 0.0])
Y = np.array([0.0, 1.0, 0.0])


def _motion(turns: dict[str, tuple[np.ndarray, np.ndarray | float]], yaw: float = 0.0, speed: float = 0.0):
    """Hips, local rotations and contacts of a standing pose with joints turned about an axis by degrees (T,)."""
    local = rotations.identity((FRAMES, len(SPORT_SKELETON)))
    for joint, (axis, degrees) in turns.items():
        angle = np.radians(np.broadcast_to(np.asarray(degrees, float), FRAMES))
        local[:, SPORT_SKELETON.index(joint)] = rotations.from_axis_angle(axis, angle)
    local[:, 0] = rotations.multiply(rotations.from_yaw(np.full(FRAMES, yaw)), local[:, 0])
    forward = np.array([np.sin(yaw), 0, np.cos(yaw)])
    hips = np.array([0.0, 1.0, 0.0]) + np.arange(FRAMES)[:, None] / 60 * speed * forward
    return hips, local.astype(np.float32), np.ones((FRAMES, 4), np.uint8)


HANGING = {"LeftArm": (Z, -85.0), "RightArm": (Z, 85.0)}
SWING = 25 * np.sin(np.arange(FRAMES) / 60 * 2 * np.pi)


@pytest.mark.parametrize(
    ("turns", "part", "said", "unsaid"),
    [
        (HANGING, "left_arm", "hanging", "swinging widely"),
        (HANGING, "right_arm", "elbow straight", "bent"),
        ({}, "left_arm", "out to the side at shoulder height", "hanging"),
        ({"LeftArm": (Z, 80.0)}, "left_arm", "raised overhead", "hanging"),
        ({**HANGING, "LeftForeArm": (Y, -100.0)}, "left_arm", "bent sharply", "straight"),
        ({"LeftArm": (Y, -85.0)}, "left_arm", "in front", "hanging"),
        ({"LeftShoulder": (X, SWING), **HANGING}, "left_arm", "swinging", "still"),
        ({"LowerBack": (X, 14.0)}, "torso", "leaning forward", "upright"),
        ({"LowerBack": (X, -14.0)}, "torso", "back", "forward"),
        ({"LowerBack": (Z, -12.0)}, "torso", "leaning to the left", "to the right"),
        ({"LowerBack": (Z, SWING)}, "torso", "tilting widely", "still"),
        ({"Head": (X, 40.0)}, "head", "hanging down", "raised"),
        ({"Head": (X, -30.0)}, "head", "tilted back", "down"),
        ({"Head": (Z, -20.0)}, "head", "tilted to the left", "to the right"),
        ({"Head": (Y, SWING)}, "head", "turning from side to side", "steady"),
        ({}, "head", "upright", "down"),
        ({}, "left_leg", "standing still", "step"),
        ({"LeftUpLeg": (X, -30.0), "LeftLeg": (X, 50.0)}, "left_leg", "bent deeply", "straight"),
    ],
)
@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_words_are_true_of_the_pose(turns: dict, part: str, said: str, unsaid: str, yaw: float) -> None:
    text = getattr(describe(measure(*_motion(turns, yaw)), 0), part)
    assert said in text
    assert unsaid not in text


def test_a_mirrored_motion_has_mirrored_words() -> None:
    turns = {"LeftArm": (Z, 80.0), "RightArm": (Z, 85.0), "LowerBack": (Z, -12.0), "Head": (Y, 30.0)}
    hips, local, contacts = _motion(turns)
    there = describe(measure(hips, local, contacts), 0)
    back = describe(measure(*mirror_motion(hips, local), contacts), 0)
    # wordings differ between the sides on purpose; the facts may not
    assert "raised" in there.left_arm
    assert "raised" in back.right_arm
    assert "hanging" in back.left_arm
    assert "leaning to the left" in there.torso
    assert "leaning to the right" in back.torso


def test_the_average_is_a_weighted_median() -> None:
    low, high = (measure(*_motion({"LowerBack": (X, a)})) for a in (0.0, 20.0))
    assert average([(low, 1.0), (high, 9.0)]).torso.pitch == high.torso.pitch
    assert average([(low, 9.0), (high, 1.0)]).torso.pitch == low.torso.pitch


def test_wordings_differ_and_are_usable() -> None:
    captions = captions_of(measure(*_motion(HANGING, speed=3.0)))
    assert "running" in captions[0]["left_leg"]
    assert len(captions) >= 3
    for caption in captions:
        assert PartDescriptions.from_mapping(caption).to_mapping() == caption


def _clip(directory: Path, name: str, style: str, turns: dict, **changed: object) -> None:
    hips, local, contacts = _motion(turns, speed=1.0)
    save_motion(directory, name, (hips, local, contacts), style=style, content="walk forward", **changed)


def test_a_capture_s_own_neutral_is_no_style(tmp_path: Path) -> None:
    bias = {**HANGING, "Head": (X, 9.0)}
    _clip(tmp_path, "cap_neutral", "neutral", bias)
    _clip(tmp_path, "cap_sad", "sad", {**HANGING, "Head": (X, 30.0)})
    _clip(tmp_path, "other_happy", "happy", bias)
    pitches = {clip.style: clip.body.head.pitch for clip in measure_clips(tmp_path)}
    assert pitches == pytest.approx({"neutral": 0.0, "sad": 21.0, "happy": 9.0}, abs=0.1)


def test_unmirrored_training_clips_are_described(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="clips"):
        write_clip_captions(tmp_path, tmp_path / "captions.json")
    _clip(tmp_path, "a_1", "kept", HANGING)
    _clip(tmp_path, "a_2", "held", HANGING, split="held_out")
    _clip(tmp_path, "a_3_m", "mirrored", HANGING, mirrored=True)
    write_clip_captions(tmp_path, tmp_path / "captions.json")
    written = json.loads((tmp_path / "captions.json").read_text())
    assert set(written) == {"a_1"}
    assert "evenly" in written["a_1"][0]["left_leg"]
