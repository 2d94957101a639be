"""Contacts and phase go with a take into every format; where a file has none they are measured on the ground it names."""

import csv
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
from runtime.formats.prepare import on_its_ground
from runtime.formats.reference import open_take
from runtime.formats.sidecar import CONTACTS, sidecar_path
from runtime.formats.table import save_motion
from runtime.takes.clip import Clip
from runtime.takes.metadata import Origin, PromptEvent, gait_changes
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import load_terrain
from sport.cli import main
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.walker import walk

SLOPE_RAD = 0.15
SOFT = Clip("walk", 60.0, *walk(120))
SOFT = replace(SOFT, contacts=(SOFT.contacts * np.linspace(0.7, 1.0, 120)[:, None]).astype(np.float32))


def on_a_slope() -> tuple[Clip, Terrain]:
    """A walk turned as a whole with the level ground that it stands on."""
    turn = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), SLOPE_RAD)
    hips, local, contacts = walk(300)
    local[:, 0] = rotations.multiply(turn, local[:, 0])
    x, z = np.meshgrid(np.arange(41) - 20.0, np.arange(41) - 20.0, indexing="ij")
    terrain = Terrain("slope", (-np.tan(SLOPE_RAD) * z + 0.0 * x).astype(np.float32), 1.0, (-20.0, -20.0))
    hips = rotations.rotate(turn, hips).astype(np.float32)
    return Clip("slope", 60.0, hips, local.astype(np.float32), contacts, terrain="slope"), terrain


def feet_of(path: Path) -> np.ndarray:
    """Contacts and phase `(T, 6)` of a file, -1 for no phase, by a reader that is not ours."""
    if path.suffix == ".npz":
        with np.load(path) as npz:
            return np.nan_to_num(np.concatenate([npz["contacts"], npz["phase"]], axis=1), nan=-1.0)
    if path.suffix == ".csv":
        with path.open(newline="") as file:
            names, rows = (*CONTACTS, "phase_left", "phase_right"), list(csv.DictReader(file))
        return np.array([[float(row[name] or -1.0) for name in names] for row in rows])
    if path.suffix == ".usd":
        stage = pytest.importorskip("pxr.Usd").Stage.Open(str(path))
        sport = stage.GetDefaultPrim().GetCustomDataByKey("sport")
        told = {track: json.loads(sport[track]) for track in ("contacts", "phase")}
    elif path.suffix == ".bvh":
        told = json.loads(path.with_name(path.name + ".json").read_text())
    else:
        told = pygltflib.GLTF2().load_binary(str(path)).animations[0].extras["sport"]
    return np.array([*told["contacts"].values(), *told["phase"].values()]).T


@pytest.mark.parametrize(("ground", "fps"), [("hills", 60.0), ("stairs", 24000 / 1001)])
def test_a_take_on_its_ground_is_the_same_in_every_format(tmp_path: Path, ground: str, fps: float) -> None:
    prompts = (PromptEvent(0.0, "a proud queen"), PromptEvent(1.2, "صياد 🎣", 0.5))
    gaits = np.repeat([1, 2], 60).astype(np.int8)
    clip = replace(SOFT, terrain=ground, prompts=prompts, gaits=gaits, origin=Origin("compact", seed=7))
    take = save_bvh(clip, tmp_path / "take.bvh", fps)
    save_motion(clip, tmp_path / "direct.npz", ExportOptions(fps=fps), load_terrain(ground))
    wanted = feet_of(tmp_path / "direct.npz")
    files = [tmp_path / f"again.{ending}" for ending in ("bvh", "glb", "vrma", "npz", "csv", "usd", "html")]
    assert main(["convert", str(take), *map(str, files)]) == 0
    for path in (take, *files[:-1]):
        np.testing.assert_allclose(feet_of(path), wanted, atol=1e-4, err_msg=path.name)
    bars = re.search(r'"contacts": "(\d+)"', files[-1].read_text())
    sides = [(wanted[:, k : k + 2] > 0.5).any(axis=1) for k in (0, 2)]
    assert [int(bits) for bits in bars[1]] == (sides[0] + 2 * sides[1]).tolist()
    for_engine = [tmp_path / "engine.glb", tmp_path / "engine.fbx"]
    assert main(["convert", str(files[1]), *map(str, for_engine), "--for", "unity", "--humanoid-names"]) == 0
    for path in (take, files[0], files[1], *for_engine):
        opened, made = open_take(path), open_take(path).clip
        assert opened.reference is None
        assert (made.terrain, made.prompts, made.origin) == (ground, prompts, clip.origin)
        assert made.fps == pytest.approx(fps, abs=1e-3)
        assert [name for _, name in gait_changes(made.gaits, fps)] == ["walk", "jog"]
        np.testing.assert_allclose(made.contacts, wanted[:, :4], atol=1e-4)
        assert np.abs(made.world()[0] - clip.resampled(made.fps).world()[0]).max() < 1e-4


@pytest.mark.parametrize("ending", ["bvh", "glb", "vrma"])
def test_a_loop_comes_back(tmp_path: Path, ending: str) -> None:
    long = replace(Clip("walk", 60.0, *walk(300)), terrain="flat", prompts=(PromptEvent(0.0, "calm"),))
    (text,) = save_motion(long, path := tmp_path / f"loop.{ending}", ExportOptions(loop=True), Terrain.flat())
    clip = open_take(path).clip
    assert clip.loop.describe() in text
    assert clip.loop.last - clip.loop.first == len(clip) - 1
    assert clip.trim(0, 20).loop is None
    again = save_motion(clip, tmp_path / "again.glb", ExportOptions(), Terrain.flat())
    assert clip.loop.describe() in again[0]


def test_a_take_of_another_character_comes_back_on_its_ground(tmp_path: Path) -> None:
    clip = replace(SOFT, terrain="hills", hips_positions=SOFT.hips_positions + np.float32([2.0, 0.4, 1.0]))
    options = ExportOptions(character=RIGS["vrm"](tmp_path / "rig.glb"), at_origin=True)
    save_motion(clip, tmp_path / "other.glb", options, load_terrain("hills"))
    opened = open_take(tmp_path / "other.glb")
    assert opened.reference is not None
    there = on_its_ground(opened.clip)
    assert there.terrain == "hills"
    np.testing.assert_allclose(there.contacts, SOFT.contacts, atol=1e-4)
    assert np.abs(there.hips_positions - clip.hips_positions).max() < 0.06


@pytest.mark.parametrize("extras", ["text", [1], {"sport": 7}, {"sport": "{"}, {"sport": {"format": "sport-take", "fps": "x",
                                    "contacts": 3, "prompts": {}, "placed": [1], "size": None, "gaits": 1}}])  # fmt: skip
def test_extras_that_tell_nothing_are_left_out(tmp_path: Path, extras: object) -> None:
    save_motion(SOFT, tmp_path / "take.glb", ExportOptions(), Terrain.flat())
    gltf = pygltflib.GLTF2().load(str(tmp_path / "take.glb"))
    gltf.animations[0].extras, gltf.scenes[0].extras = extras, {}
    gltf.save(str(tmp_path / "take.glb"))
    clip = open_take(tmp_path / "take.glb").clip
    assert (len(clip), clip.fps, clip.prompts, clip.size) == (120, 60.0, (), 1.0)
    assert not clip.contacts.any()


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
        values = np.frombuffer(gltf.binary_blob(), np.float32, view.byteLength // 4, view.byteOffset)
        numbers.append((count, values))
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


@pytest.mark.parametrize("contacts", [None, [], {"left_heel": [1]}, dict.fromkeys(CONTACTS, [2.0] * 120),
                                      dict.fromkeys(CONTACTS, [1.0] * 7), dict.fromkeys(CONTACTS, [[1.0]] * 120),
                                      dict.fromkeys(CONTACTS, ["x"] * 120)])  # fmt: skip
def test_contacts_that_are_none_are_left_out(tmp_path: Path, contacts: object) -> None:
    path = save_bvh(SOFT, tmp_path / "take.bvh")
    value = json.loads(sidecar_path(path).read_text()) | {"contacts": contacts}
    sidecar_path(path).write_text(json.dumps(value))
    assert not open_take(path).clip.contacts.any()
