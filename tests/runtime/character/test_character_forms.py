"""Characters in other forms: FBX, and glTF with Draco, meshopt, WebP or KTX2. The files are of other programs.

`box_man.glb` is `foreign_rigs.mixamo_rig`; Blender wrote its FBX, glTF Transform its compressed forms, Basis Universal
the image of its KTX2.
"""

import contextlib
import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from runtime.character import native
from runtime.character.character import load_character
from runtime.character.mesh import read_meshes
from runtime.character.read import open_gltf
from runtime.errors import FileError
from runtime.formats.prepare import ExportOptions
from runtime.formats.table import save_motion
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from tests.helpers.walker import walk

FOLDER = Path(__file__).parent / "characters"
PLAIN = FOLDER / "box_man.glb"
MODULES = {"box_man.fbx": "ufbx", "box_man_draco.glb": "DracoPy", "box_man_meshopt.glb": "meshoptimizer",
           "box_man_ktx2.glb": "opengl_basisu", "box_man_webp.glb": "PIL"}  # fmt: skip
PACKAGES = {
    "ufbx": "ufbx",
    "DracoPy": "DracoPy",
    "meshoptimizer": "meshoptimizer",
    "opengl_basisu": "opengl-basisu",
}


def needs(name: str) -> None:
    pytest.importorskip(MODULES[name], reason="needs the extra [characters]")


@pytest.mark.parametrize("name", MODULES)
def test_the_character_is_the_same(name: str) -> None:
    needs(name)
    plain, other = load_character(PLAIN), load_character(FOLDER / name)
    joints = set(zip(plain.joint_names, plain.sport_joints, strict=True))
    assert set(zip(other.joint_names, other.sport_joints, strict=True)) == joints
    assert other.size == pytest.approx(plain.size, abs=1e-4)
    at = [read_meshes(open_gltf(path)).rest_positions() for path in (PLAIN, FOLDER / name)]
    assert cKDTree(at[0]).query(at[1])[0].max() < 1e-4, "metres"
    assert cKDTree(at[1]).query(at[0])[0].max() < 1e-4


@pytest.mark.parametrize("name", MODULES)
def test_a_take_of_it_is_plain_gltf(name: str, tmp_path: Path) -> None:
    needs(name)
    clip, path = Clip("walk", 60.0, *walk(3)), tmp_path / "take.glb"
    save_motion(clip, path, ExportOptions(character=FOLDER / name), Terrain.flat())
    data = path.read_bytes()
    document = json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])
    assert set(document.get("extensionsUsed", [])) <= {"KHR_mesh_quantization"}
    assert all(image["mimeType"] in ("image/png", "image/jpeg") for image in document["images"])
    assert all(isinstance(texture["source"], int) for texture in document["textures"])
    assert len(load_character(path).positions) == len(load_character(FOLDER / name).positions)


def test_colours_of_an_image_in_basis_universal_are_its_own() -> None:
    needs("box_man_ktx2.glb")
    colors = read_meshes(open_gltf(FOLDER / "box_man_ktx2.glb")).colors
    srgb = np.array([[200, 40, 30], [30, 60, 210]]) / 255.0
    linear = ((srgb + 0.055) / 1.055) ** 2.4
    assert cKDTree(linear).query(colors)[0].max() < 0.03


@pytest.mark.parametrize("name", [name for name in MODULES if MODULES[name] in PACKAGES])
def test_without_its_library_the_sentence_names_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = MODULES[name]
    monkeypatch.setattr(native.importlib.util, "find_spec", lambda module: None)
    with pytest.raises(FileError, match=rf"pip install {PACKAGES[missing]}"):
        load_character(FOLDER / name)


@pytest.mark.parametrize(
    "name", ["box_man.fbx", "box_man_draco.glb", "box_man_meshopt.glb", "box_man_ktx2.glb"]
)
def test_damage_is_a_sentence(name: str, tmp_path: Path) -> None:
    needs(name)
    whole, rng = (FOLDER / name).read_bytes(), np.random.default_rng(0)
    for _ in range(1 if name.endswith("fbx") else 8):
        data = bytearray(whole)
        first = 40 if name.endswith("fbx") else 20 + struct.unpack("<I", whole[12:16])[0]
        for at in rng.integers(first, len(data), len(data) // 10):
            data[at] = rng.integers(256)
        path = tmp_path / name
        path.write_bytes(data)
        with contextlib.suppress(FileError):  # anything else is a defect
            load_character(path)


def test_a_texture_beside_an_fbx_is_found(tmp_path: Path) -> None:
    needs("box_man.fbx")
    shutil.copy(FOLDER / "box_man.fbx", tmp_path / "Häuptling 1.fbx")
    character = load_character(tmp_path / "Häuptling 1.fbx")
    assert character.colors.std(axis=0).max() > 0.05, "its embedded texture colours the vertices"
