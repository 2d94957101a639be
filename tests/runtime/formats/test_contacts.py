"""Contacts and phase go with a take into every format; where a file has none they are measured on the ground it names."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pygltflib
import pytest

from runtime import rotations
from runtime.formats.bvh_clip import save_bvh
from runtime.formats.options import ExportOptions
from runtime.formats.reference import open_take
from runtime.formats.sidecar import CONTACTS, sidecar_path
from runtime.formats.table import save_motion
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from sport.cli import main
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.walker import walk

SLOPE_RAD = 0.15
SOFT = Clip("walk", 60.0, *walk(180))
SOFT = replace(SOFT, contacts=(SOFT.contacts * np.linspace(0.7, 1.0, 180)[:, None]).astype(np.float32))


def on_a_slope() -> tuple[Clip, Terrain]:
    """A walk turned as a whole with the level ground that it stands on."""
    turn = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), SLOPE_RAD)
    hips, local, contacts = walk(300)
    local[:, 0] = rotations.multiply(turn, local[:, 0])
    x, z = np.meshgrid(np.arange(41) - 20.0, np.arange(41) - 20.0, indexing="ij")
    terrain = Terrain("slope", (-np.tan(SLOPE_RAD) * z + 0.0 * x).astype(np.float32), 1.0, (-20.0, -20.0))
    hips = rotations.rotate(turn, hips).astype(np.float32)
    return Clip("slope", 60.0, hips, local.astype(np.float32), contacts, terrain="slope"), terrain


def tracks_of(path: Path, track: str) -> np.ndarray:
    """Columns of a track of a GLB or of the JSON next to a BVH, by pygltflib or json alone."""
    if path.suffix == ".glb":
        found = pygltflib.GLTF2().load(str(path)).animations[0].extras["sport"][track]
    else:
        found = json.loads(path.with_name(path.name + ".json").read_text())[track]
    return np.array(list(found.values())).T


def test_contacts_and_phase_are_equal_in_every_format(tmp_path: Path) -> None:
    take = save_bvh(SOFT, tmp_path / "take.bvh")
    save_motion(SOFT, tmp_path / "direct.npz", ExportOptions(), Terrain.flat())
    with np.load(tmp_path / "direct.npz") as npz:
        contacts, phase = npz["contacts"], np.nan_to_num(npz["phase"], nan=-1.0)
    files = [tmp_path / name for name in ("again.bvh", "again.glb", "again.npz", "again.html")]
    assert main(["convert", str(take), *map(str, files)]) == 0
    for path in (take, files[0], files[1]):
        np.testing.assert_allclose(tracks_of(path, "contacts"), contacts, atol=1e-4)
        np.testing.assert_allclose(tracks_of(path, "phase"), phase, atol=1e-4)
    with np.load(files[2]) as npz:
        np.testing.assert_allclose(npz["contacts"], contacts, atol=1e-4)
        np.testing.assert_array_equal(np.nan_to_num(npz["phase"], nan=-1.0), phase)
    bars = re.search(r'"contacts": "(\d+)"', files[3].read_text())
    assert bars is not None
    left = (contacts[:, :2] > 0.5).any(axis=1)
    assert [int(bits) & 1 for bits in bars[1]] == left.tolist()


def test_a_converted_take_is_the_generated_file(tmp_path: Path) -> None:
    options = ExportOptions(character=RIGS["vrm"](tmp_path / "rig.glb"))
    save_motion(SOFT, tmp_path / "made.glb", options, Terrain.flat())
    clip = open_take(save_bvh(SOFT, tmp_path / "take.bvh")).clip
    save_motion(clip, tmp_path / "converted.glb", options, Terrain.flat())
    numbers = []
    for name in ("made.glb", "converted.glb"):
        gltf = pygltflib.GLTF2().load(str(tmp_path / name))
        track = next(s for s in gltf.animations[0].samplers)
        count = gltf.accessors[track.output].count
        view = gltf.bufferViews[gltf.accessors[track.output].bufferView]
        numbers.append(
            (count, np.frombuffer(gltf.binary_blob(), np.float32, view.byteLength // 4, view.byteOffset))
        )
    assert numbers[0][0] == numbers[1][0]
    assert np.abs(numbers[0][1] - numbers[1][1]).max() < 1e-4


@pytest.mark.parametrize("level_m", [0.0, 3.0])
def test_lost_contacts_are_measured_on_the_ground(tmp_path: Path, level_m: float) -> None:
    """On a slope, whose height over the take's lowest point tells nothing; a level that is not known does not matter."""
    clip, terrain = on_a_slope()
    raised = replace(clip, hips_positions=clip.hips_positions + np.float32([0.0, level_m, 0.0]))
    path = save_bvh(raised, tmp_path / "slope.bvh")
    sidecar_path(path).unlink()
    lost = open_take(path).clip
    assert not lost.contacts.any()
    save_motion(lost, tmp_path / "slope.npz", ExportOptions(), terrain)
    with np.load(tmp_path / "slope.npz") as found:
        assert found["contact_names"].tolist() == list(CONTACTS)
        assert ((found["contacts"] > 0.5) == (clip.contacts > 0.5)).mean() > 0.88
        assert np.isnan(found["phase"]).mean() < 0.5


@pytest.mark.parametrize("contacts", [None, [], {"left_heel": [1]}, dict.fromkeys(CONTACTS, [2.0] * 180),
                                      dict.fromkeys(CONTACTS, [1.0] * 7), dict.fromkeys(CONTACTS, [[1.0]] * 180),
                                      dict.fromkeys(CONTACTS, ["x"] * 180)])  # fmt: skip
def test_contacts_that_are_none_are_left_out(tmp_path: Path, contacts: object) -> None:
    path = save_bvh(SOFT, tmp_path / "take.bvh")
    value = json.loads(sidecar_path(path).read_text()) | {"contacts": contacts}
    sidecar_path(path).write_text(json.dumps(value))
    assert not open_take(path).clip.contacts.any()
