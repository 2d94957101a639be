"""Motion that comes in as GLB: every rig's animation is the one that was written, on our skeleton or as a reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.assets import asset_path
from runtime.errors import FileError
from runtime.formats.glb import MANNEQUIN, save_glb
from runtime.formats.gltf_motion import contents, read_gltf_motion
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.reference import open_take
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from tests.fuzz.files import keys_glb
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.gltf_characters import join_glb, split_glb
from tests.helpers.walker import walk

BONES = [("LeftUpLeg", "LeftLeg"), ("RightLeg", "RightFoot"), ("LeftArm", "LeftForeArm"), ("Hips", "Head")]


@pytest.fixture(scope="module")
def clip() -> Clip:
    hips, local, contacts = walk(60)
    turn = rotations.from_rotation_vector(
        0.2 * np.sin(np.arange(60)[:, None, None] / 9 + np.arange(93).reshape(31, 3))
    )
    return Clip("walk", 30.0, hips, rotations.multiply(local, turn).astype(np.float32), contacts)


def written(clip: Clip, path: Path, character: Path, **options: object) -> Path:
    chosen = ExportOptions(character=character, fps=30.0, **options)  # type: ignore[arg-type]
    save_glb(prepare(clip, chosen, None), path, chosen, None)
    return path


def directions(clip: Clip) -> np.ndarray:
    positions = clip.world()[0]
    ends = [[SPORT_SKELETON.index(name) for name in bone] for bone in BONES]
    return np.stack([rotations.normalize(positions[:, b] - positions[:, a]) for a, b in ends], 1)


def test_the_mannequin_is_our_skeleton(clip: Clip, tmp_path: Path) -> None:
    opened = open_take(written(clip, tmp_path / "a.glb", asset_path(MANNEQUIN)))
    assert opened.reference is None
    assert (len(opened.clip), opened.clip.fps) == (60, 30.0)
    assert np.abs(opened.clip.world()[0] - clip.world()[0]).max() < 1e-3


@pytest.mark.parametrize("rig", sorted(RIGS))
def test_other_rigs_are_references(clip: Clip, rig: str, tmp_path: Path) -> None:
    path = written(clip, tmp_path / "b.glb", RIGS[rig](tmp_path / "rig.glb"))
    assert contents(path) == (True, True)
    assert contents(tmp_path / "rig.glb") == (True, False)
    opened = open_take(path)
    assert opened.reference is not None
    assert (len(opened.clip), round(opened.clip.fps, 3)) == (60, 30.0)
    apart = np.degrees(np.arccos(np.clip((directions(opened.clip) * directions(clip)).sum(-1), -1.0, 1.0)))
    assert np.median(apart) < 3.0
    assert apart.max() < 15.0


def test_cubic_and_stepped_keys_are_read_as_specified(tmp_path: Path) -> None:
    path = tmp_path / "keys.glb"
    path.write_bytes(keys_glb())
    motion = read_gltf_motion(path)
    assert motion.fps == pytest.approx(24.0)
    middle = motion.positions[12, 0, 0]
    assert middle == pytest.approx(
        0.5 * 3.0 + 0.125 * 3.0 + 0.0, abs=1e-5
    )  # half of the way, and the tangent's part
    assert np.allclose(motion.local_rotations[23, 0], [1, 0, 0, 0])
    assert np.allclose(np.abs(motion.local_rotations[24, 0]), [0, 0, 1, 0])


def _change(document: dict, what: str, value: object) -> None:
    *way, last = what.split(".")
    for step in way:
        document = document[int(step) if step.isdigit() else step]
    document[int(last) if last.isdigit() else last] = value


@pytest.mark.parametrize(
    ("what", "value", "message"),
    [
        ("animations.0.samplers.0.output", 2, "damaged"),
        ("animations.0.samplers.0.interpolation", "LINEAR", "keys of an animation that do not fit"),
        ("animations.0.samplers", [], "damaged"),
        ("animations.0.channels", [{"sampler": 0, "target": {"node": 7, "path": "scale"}}], "moves no node"),
        ("animations", {"0": 1}, "its list of animations is damaged"),
        ("accessors.0.count", 10**9, "more keys than"),
        ("nodes", [{"children": [1]}, {"children": [0]}], "cycle"),
        ("times", [1.0, 0.0], "keys of an animation that do not fit"),
        ("times", [0.0, np.nan], "not finite"),
        ("times", [0.0, 9e8], "an animation of"),
        ("nodes", [{}, {"scale": [9e8, 9e8, 9e8], "children": [0]}], "moves joints further than"),
        ("skins", [{"joints": [0] * 60_000, "inverseBindMatrices": 0}], "bind matrices"),
    ],
)
def test_damage_is_one_sentence(what: str, value: object, message: str, tmp_path: Path) -> None:
    document, blob = split_glb(keys_glb())
    if what == "times":
        blob = np.array(value, "<f4").tobytes() + blob[8:]
    else:
        _change(document, what, value)
    path = tmp_path / "keys.glb"
    path.write_bytes(join_glb(document, blob))
    with pytest.raises(FileError, match=message):
        read_gltf_motion(path)


def test_a_file_without_animation_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no animation"):
        read_gltf_motion(asset_path(MANNEQUIN))
    document, _ = split_glb(asset_path(MANNEQUIN).read_bytes())
    assert not document.get("animations")
