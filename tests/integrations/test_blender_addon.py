"""The Blender add-on: what it reads from files, and in Blender what it imports and follows."""

import json
import subprocess
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from runtime.assets import PROJECT_ROOT
from runtime.character.character import load_character
from runtime.character.joints import CONVENTIONS
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.table import save_motion
from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.library import load_terrain
from tests.helpers.blender_addon import ADDON, blender_command, load_addon, needs_blender
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.walker import walk
from viewer.live.link import Address, LiveLink
from viewer.messages import Messages

IN_BLENDER = PROJECT_ROOT / "tests" / "helpers" / "in_blender.py"
HILLS = load_terrain("hills")
MARKS = [("walk", 0), ("a proud queen", 0), ("jog", 18), ("drunk", 15)]  # at 30 frames a second


def to_blender(points: Any) -> np.ndarray:
    points = np.asarray(points)
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], -1)


@pytest.fixture(scope="module")
def addon() -> ModuleType:
    return load_addon()


@pytest.fixture(scope="module")
def clip() -> Clip:
    hips, local, contacts = walk(61, drift=(0.3, 0.0), terrain=HILLS)
    prompts = (PromptEvent(0.0, "a proud queen"), PromptEvent(0.5, "drunk", 1.0))
    gaits = np.array([1] * 36 + [2] * 25, np.int8)
    return Clip("walk", 60.0, hips, local, contacts, prompts=prompts, terrain="hills", gaits=gaits)


@pytest.fixture(scope="module")
def files(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A BVH in centimetres and one in metres, each with its ground beside it, and a GLB with a character of others."""
    folder = tmp_path_factory.mktemp("takes")
    (folder / "m").mkdir()
    rig = RIGS["mixamo"](folder / "rig.glb")
    made = {"cm": folder / "walk.bvh", "m": folder / "m" / "walk.bvh", "glb": folder / "own.glb", "rig": rig}
    ground = folder / "walk-ground.obj", folder / "m" / "ground.glb"
    save_motion(clip, made["cm"], ExportOptions(fps=30.0, ground_out=ground[0]), HILLS)
    save_motion(clip, made["m"], ExportOptions(fps=60.0, unit="m", ground_out=ground[1]), HILLS)
    options = ExportOptions(fps=30.0, character=rig, with_ground=True, fit_to_motion=True)
    save_motion(clip, made["glb"], options, HILLS)
    return made


def test_the_files_tell_rate_markers_unit_and_ground(addon: ModuleType, files: dict[str, Path]) -> None:
    centimetres, metres, glb = (addon.read_take(files[name]) for name in ("cm", "m", "glb"))
    assert (centimetres.fps, centimetres.frames, centimetres.scale) == (30.0, 31, 0.01)
    assert (metres.fps, metres.frames, metres.scale) == (60.0, 61, 1.0)
    assert (glb.fps, glb.frames, glb.scale) == (30.0, 31, 1.0)
    for facts in (centimetres, glb):
        assert sorted(facts.markers) == sorted(MARKS)
        assert facts.terrain == "hills"
    assert addon.find_ground(files["cm"]) == files["cm"].with_name("walk-ground.obj")
    assert addon.find_ground(files["m"]) == files["m"].with_name("ground.glb")


def test_a_take_without_its_json_and_files_of_others(
    addon: ModuleType, files: dict[str, Path], tmp_path: Path
) -> None:
    alone = tmp_path / "alone.bvh"
    alone.write_bytes(files["cm"].read_bytes())
    facts = addon.read_take(alone)
    assert (facts.markers, facts.frames, addon.find_ground(alone)) == ((), 31, None)
    (tmp_path / "alone.bvh.json").write_text('["no take"]')
    assert addon.read_take(alone).markers == ()
    (tmp_path / "text.bvh").write_text("MOTION")
    with pytest.raises(ValueError, match=r"text\.bvh: not a BVH"):
        addon.read_take(tmp_path / "text.bvh")
    with pytest.raises(ValueError, match="use File > Import > glTF"):
        addon.read_take(files["rig"])
    (tmp_path / "short.glb").write_bytes(b"glT")
    with pytest.raises(ValueError, match="not a GLB"):
        addon.read_take(tmp_path / "short.glb")


@needs_blender
def test_blender_imports_takes_with_markers_and_ground(
    clip: Clip, files: dict[str, Path], tmp_path: Path
) -> None:
    target = tmp_path / "found.json"
    paths = [files[name] for name in ("cm", "m", "glb")]
    done = subprocess.run(blender_command(IN_BLENDER, ADDON, "take", target, *paths),
                          capture_output=True, text=True, timeout=600, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(target.read_text())
    for taken, fps in zip(found, (30.0, 60.0, 30.0), strict=True):
        assert taken["done"] == ["FINISHED"]
        assert taken["fps"] == fps
        assert taken["range"] == [1, 31 if fps == 30.0 else 61]
        assert taken["markers"] == sorted([1 + round(f * fps / 30.0), name] for name, f in MARKS)
        (ground,) = (np.array(points) for points in taken["grounds"])
        assert np.allclose(HILLS.height(ground[:, 0], -ground[:, 1]), ground[:, 2], atol=2e-3)
    for taken in found[:2]:
        ours = to_blender(clip.resampled(taken["fps"]).world()[0])
        theirs = np.array([[frame[name] for name in SPORT_SKELETON.names] for frame in taken["frames"]])
        assert np.linalg.norm(ours - theirs, axis=-1).max() < 1e-3
    character = load_character(files["rig"])
    take = prepare(clip, ExportOptions(fps=30.0, character=files["rig"]), HILLS)
    matrices = character.joint_matrices(*character.adapted(*take.clip.world(), take.clip.contacts))
    ours = to_blender(matrices[..., :3, 3])
    theirs = np.array([[frame[name] for name in character.joint_names] for frame in found[2]["frames"]])
    assert np.linalg.norm(ours - theirs, axis=-1).max() < 1e-3
    assert found[2]["skinned"] == 1
    assert found[2]["materials"] >= 2


@needs_blender
def test_a_damaged_take_is_a_sentence_in_blender(files: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "damaged.bvh"
    frames = files["cm"].read_text("utf-8").rstrip().rsplit(" ", 1)[0]
    path.write_text(f"{frames} 1e\n", encoding="utf-8")
    done = subprocess.run(blender_command(IN_BLENDER, ADDON, "take", tmp_path / "found.json", path),
                          capture_output=True, text=True, timeout=600, check=False)  # fmt: skip
    assert done.stderr.rstrip().endswith("Error: damaged.bvh: damaged; Blender's importer cannot read it")


@needs_blender
@pytest.mark.parametrize("suffix", [".bvh", ".glb"])
def test_takes_at_rates_of_video_lie_on_their_frames(clip: Clip, tmp_path: Path, suffix: str) -> None:
    path, target = tmp_path / f"take{suffix}", tmp_path / "found.json"
    options = ExportOptions(fps=30000 / 1001, with_ground=suffix == ".glb")
    save_motion(clip, path, options, HILLS)
    subprocess.run(blender_command(IN_BLENDER, ADDON, "take", target, path), check=True, capture_output=True,
                   timeout=600)  # fmt: skip
    (found,) = json.loads(target.read_text())
    assert found["fps"] == pytest.approx(30000 / 1001, abs=1e-3)
    assert found["range"] == [1, len(clip.resampled(options.fps))]
    theirs = np.array([[frame[name] for name in SPORT_SKELETON.names] for frame in found["frames"]])
    ours = to_blender(clip.resampled(options.fps).world()[0])
    assert np.linalg.norm(ours - theirs, axis=-1).max() < 1e-3


def start_live(target: Path, poses: int, *rig: Path) -> tuple[subprocess.Popen[str], int]:
    """Blender following the link, and the port that it listens at."""
    process = subprocess.Popen(blender_command(IN_BLENDER, ADDON, "live", target, poses, *rig),
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # fmt: skip
    assert process.stdout is not None
    for line in process.stdout:
        if line.strip().isdigit():
            return process, int(line)
    raise AssertionError(process.stderr.read() if process.stderr else "")


@needs_blender
def test_blender_follows_the_live_link_and_records_it(clip: Clip, tmp_path: Path) -> None:
    process, port = start_live(tmp_path / "found.json", 60)
    link = LiveLink(Messages(), address=Address(port=port))
    link.start()
    poses: list[Pose] = [clip.pose(k) for k in range(60)]
    for pose in poses:
        link.publish([pose])
        time.sleep(1.0 / 60.0)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 0, errors
    found = json.loads((tmp_path / "found.json").read_text())
    assert (found["received"], found["lost"]) == (60, 0)
    last = to_blender(poses[-1].positions)
    for shown in (found["shown"], found["recorded"]):
        theirs = np.array([shown[name] for name in SPORT_SKELETON.names])
        assert np.linalg.norm(theirs - last, axis=-1).max() < 1e-3
    assert found["range"][0] == 1
    assert found["keys"] == 60, "a key in each frame, at whatever rate Blender came to look"


@needs_blender
def test_the_live_link_drives_a_rig_of_others(clip: Clip, tmp_path: Path) -> None:
    """Its limbs point as the viewer's do, its hips are as high as its legs are long."""
    rig = RIGS["mixamo"](tmp_path / "rig.glb")
    process, port = start_live(tmp_path / "found.json", 20, rig)
    link = LiveLink(Messages(), address=Address(port=port))
    link.start()
    for k in range(20):
        link.publish([clip.pose(k)])
        time.sleep(1.0 / 60.0)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 0, errors
    shown, character = json.loads((tmp_path / "found.json").read_text())["shown"], load_character(rig)
    bones = {
        SPORT_SKELETON.names[joint]: np.array(shown[bone])
        for bone, joint in zip(character.joint_names, character.sport_joints, strict=True)
        if joint >= 0
    }
    ours = dict(zip(SPORT_SKELETON.names, to_blender(clip.pose(19).positions), strict=True))
    for side in ("Left", "Right"):
        for a, b in (("UpLeg", "Leg"), ("Leg", "Foot"), ("Arm", "ForeArm"), ("ForeArm", "Hand")):
            there, here = (at[side + b] - at[side + a] for at in (bones, ours))
            cosine = there @ here / np.linalg.norm(there) / np.linalg.norm(here)
            assert np.degrees(np.arccos(min(cosine, 1.0))) < 0.5, side + a
    legs = [
        np.linalg.norm(at["LeftUpLeg"] - at["LeftLeg"]) + np.linalg.norm(at["LeftLeg"] - at["LeftFoot"])
        for at in (bones, ours)
    ]
    for joint in ("LeftFoot", "RightFoot"):
        assert bones[joint][2] / legs[0] == pytest.approx(ours[joint][2] / legs[1], abs=0.06)


def test_the_addons_names_are_those_of_the_program(addon: ModuleType) -> None:
    """One table in two places: Blender has nothing of the program."""
    for convention, table in CONVENTIONS.items():
        if convention == "SPORT":
            continue
        found = addon.guess_joints([f"Rig_{name}" for name in table.values()])
        assert found == {joint: f"Rig_{name}" for joint, name in table.items()}, convention
    assert addon.guess_joints(["Cube", "Lamp"]) == {}
