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
    times = np.array([0.0, 1.0], "<f4")
    cubic = np.array([[0, 0, 0], [0, 0, 0], [3, 0, 0], [0, 0, 0], [3, 0, 0], [0, 0, 0]], "<f4")
    step = np.array([[0, 0, 0, 1], [0, 1, 0, 0]], "<f4")
    blob = b"".join(array.tobytes() for array in (times, cubic, step))
    views = [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in ((0, 8), (8, 72), (80, 32))]
    accessors = [
        {"bufferView": k, "componentType": 5126, "count": count, "type": kind}
        for k, (count, kind) in enumerate(((2, "SCALAR"), (6, "VEC3"), (2, "VEC4")))
    ]
    samplers = [
        {"input": 0, "output": k, "interpolation": kind} for k, kind in ((1, "CUBICSPLINE"), (2, "STEP"))
    ]
    channels = [
        {"sampler": k, "target": {"node": 0, "path": path}}
        for k, path in enumerate(("translation", "rotation"))
    ]
    document = {
        "asset": {"version": "2.0"}, "nodes": [{"name": "Hips"}], "scenes": [{"nodes": [0]}],
        "buffers": [{"byteLength": len(blob)}], "bufferViews": views, "accessors": accessors,
        "animations": [{"samplers": samplers, "channels": channels}],
    }  # fmt: skip
    path = tmp_path / "keys.glb"
    path.write_bytes(join_glb(document, blob))
    motion = read_gltf_motion(path)
    assert motion.fps == pytest.approx(24.0)
    middle = motion.positions[12, 0, 0]
    assert middle == pytest.approx(
        0.5 * 3.0 + 0.125 * 3.0 + 0.0, abs=1e-5
    )  # half of the way, and the tangent's part
    assert np.allclose(motion.local_rotations[23, 0], [1, 0, 0, 0])
    assert np.allclose(np.abs(motion.local_rotations[24, 0]), [0, 0, 1, 0])
    document["animations"][0]["samplers"][0]["output"] = 2  # type: ignore[index]
    path.write_bytes(join_glb(document, blob))
    with pytest.raises(FileError, match="keys"):
        read_gltf_motion(path)


def test_a_file_without_animation_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no animation"):
        read_gltf_motion(asset_path(MANNEQUIN))
    document, _ = split_glb(asset_path(MANNEQUIN).read_bytes())
    assert not document.get("animations")
