"""Character files that are damaged, foreign or unusual."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from runtime.character.character import load_character
from runtime.character.skinned_mesh import skin_vertices
from runtime.character.writer import write_character
from runtime.errors import FileError
from tests.helpers.gltf_characters import join_glb, split_glb, user_character


@pytest.fixture(scope="module")
def user_file(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict, bytes]:
    path = tmp_path_factory.mktemp("user") / "user.glb"
    write_character(path, user_character())
    return split_glb(path.read_bytes())


def expect_error(path: Path, data: bytes, *words: str) -> None:
    path.write_bytes(data)
    with pytest.raises(FileError) as caught:
        load_character(path)
    assert path.name in caught.value.problem
    assert caught.value.remedy
    for word in words:
        assert word in str(caught.value)


def test_missing_empty_foreign_and_cut_files(tmp_path: Path, user_file: tuple[dict, bytes]) -> None:
    path = tmp_path / "bad.glb"
    with pytest.raises(FileError, match=r"bad\.glb"):
        load_character(path)
    whole = join_glb(*user_file)
    expect_error(path, b"", "glTF")
    expect_error(path, b"\x89PNG\r\n", "glTF")
    expect_error(path, whole[:11], "glTF")
    expect_error(path, whole[:-500], "cut off")
    expect_error(path, whole[:4] + struct.pack("<I", 1) + whole[8:], "version")
    for cut in range(12, len(whole), 997):
        expect_error(path, whole[:cut])


def test_bind_matrices_that_lose_the_mesh_in_rounding(tmp_path: Path, user_file: tuple[dict, bytes]) -> None:
    document, blob = user_file
    accessor = document["accessors"][document["skins"][0]["inverseBindMatrices"]]
    view = document["bufferViews"][accessor["bufferView"]]
    first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    for value in (2e6, -2e6):
        damaged = blob[:first] + struct.pack("<f", value) + blob[first + 4 :]
        expect_error(tmp_path / "bad.glb", join_glb(document, damaged), "skin 0", "1,000,000")


def test_too_large_file_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.glb"
    with path.open("wb") as f:
        f.truncate(257 * 1024 * 1024)  # sparse
    with pytest.raises(FileError, match="256 MB"):
        load_character(path)


def edit(document: dict, **changes: object) -> dict:
    """A copy with values set at `a__0__b` paths; None removes."""
    copy = json.loads(json.dumps(document))
    for path, value in changes.items():
        *keys, last = (int(k) if k.isdigit() else k for k in path.split("__"))
        target = copy
        for key in keys:
            target = target[key]
        if value is None:
            del target[last]
        else:
            target[last] = value
    return copy


_CHANGES = [
    ({"skins": None}, "no skin"),
    ({"skins__0__joints__0": 999}, "skin 0"),
    ({"nodes__26__skin": None}, "skin"),
    ({"meshes__0__primitives__0__attributes__JOINTS_0": None}, "JOINTS_0"),
    ({"meshes__0__primitives__0__attributes__WEIGHTS_0": 77}, "WEIGHTS_0"),
    ({"meshes__0__primitives__0__attributes__POSITION": None}, "POSITION"),
    ({"accessors__0__count": 10**9}, "POSITION"),
    ({"accessors__0__type": "VEC7"}, "POSITION"),
    ({"accessors__0__bufferView": 400}, "POSITION"),
    ({"bufferViews__0__byteOffset": 10**8}, "POSITION"),
    ({"buffers__0__uri": "lost.bin"}, "lost.bin"),
    ({"buffers__0__uri": "../../etc/lost.bin"}, "outside"),
    ({"nodes__0__children": [0]}, "tree"),
    ({"nodes__7__children": [0]}, "node"),
    ({"extensionsRequired": "KHR_draco_mesh_compression"}, "extensionsRequired"),
    ({"nodes__3__rotation": "north"}, "damaged"),
    ({"nodes__3__scale": [1, float("inf"), 1]}, "scale of node 3"),
    ({"buffers": [None]}, "buffers"),
]


@pytest.mark.parametrize(("changes", "word"), _CHANGES, ids=[next(iter(c)) for c, _ in _CHANGES])
def test_damaged_structure_names_the_trouble(
    tmp_path: Path, user_file: tuple[dict, bytes], changes: dict[str, object], word: str
) -> None:
    document, blob = user_file
    expect_error(tmp_path / "bad.glb", join_glb(edit(document, **changes), blob), word)


def patch(user_file: tuple[dict, bytes], attribute: str, values: bytes) -> bytes:
    document, blob = user_file
    accessor = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"][attribute]]
    start = document["bufferViews"][accessor["bufferView"]]["byteOffset"]
    return join_glb(document, blob[:start] + values + blob[start + len(values) :])


def test_values_out_of_range(tmp_path: Path, user_file: tuple[dict, bytes]) -> None:
    path = tmp_path / "bad.glb"
    expect_error(path, patch(user_file, "POSITION", struct.pack("<f", float("nan"))), "POSITION", "finite")
    expect_error(path, patch(user_file, "WEIGHTS_0", struct.pack("<4f", 0, 0, 0, 0)), "without a joint")
    expect_error(path, patch(user_file, "JOINTS_0", struct.pack("<H", 500)), "joint 500")
    document, blob = user_file
    indices = document["accessors"][document["meshes"][0]["primitives"][0]["indices"]]
    start = document["bufferViews"][indices["bufferView"]]["byteOffset"]
    broken = blob[:start] + struct.pack("<H", 60000) + blob[start + 2 :]
    expect_error(path, join_glb(document, broken), "indices")


def test_base_colour_texture_and_rigid_attachment(tmp_path: Path, user_file: tuple[dict, bytes]) -> None:
    document, blob = user_file
    from PIL import Image

    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "red.png")
    vertices = document["accessors"][0]["count"]
    changed = edit(document)
    changed["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": vertices * 8})
    changed["accessors"].append({"bufferView": len(changed["bufferViews"]) - 1, "componentType": 5126,
                                 "count": vertices, "type": "VEC2"})  # fmt: skip
    primitive = changed["meshes"][0]["primitives"][0]
    del primitive["attributes"]["COLOR_0"]
    sword = json.loads(json.dumps(primitive))
    primitive["attributes"]["TEXCOORD_0"] = len(changed["accessors"]) - 1
    changed |= {"images": [{"uri": "red.png"}], "textures": [{"source": 0}]}
    changed["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    del sword["material"]
    changed["meshes"].append({"primitives": [sword]})
    hand = next(i for i, n in enumerate(changed["nodes"]) if n["name"] == "mixamorig:LeftHand")
    changed["nodes"].append({"mesh": 1, "translation": [0.0, 3.0, 0.0]})
    changed["nodes"][hand]["children"].append(len(changed["nodes"]) - 1)
    blob += bytes(vertices * 8)
    changed["buffers"][0]["byteLength"] = len(blob)
    path = tmp_path / "dressed.glb"
    path.write_bytes(join_glb(changed, blob))
    character = load_character(path)
    assert np.allclose(character.colors[:vertices], (1, 0, 0))
    assert len(character.positions) == 2 * vertices
    at = character.joint_names.index("mixamorig:LeftHand")
    assert np.all(character.joint_indices[vertices:, 0] == at)
    rest = skin_vertices(character, (character.rest_world @ character.inverse_bind))
    raised = character.positions[:vertices] + np.array([0, 3, 0])
    local = np.concatenate([raised, np.ones((vertices, 1))], axis=1)
    assert np.allclose(rest[vertices:], (local @ character.rest_world[at].T)[:, :3], atol=1e-2)
    (tmp_path / "red.png").write_bytes(b"not a picture")
    expect_error(path, join_glb(changed, blob), "image 0")
    (tmp_path / "red.png").unlink()
    expect_error(path, join_glb(changed, blob), "red.png")


def test_writing_into_an_impossible_folder_is_a_file_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="is not a folder"):
        write_character(tmp_path / "file" / "x.glb", user_character())
