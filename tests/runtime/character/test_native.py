"""Files that native libraries decode: what would let them write beyond a buffer, or fill the memory, is a sentence."""

import sys
from pathlib import Path
from typing import Any

import pytest

from runtime.character import native
from runtime.character.character import load_character
from runtime.errors import FileError
from tests.helpers.gltf_characters import join_glb, split_glb
from tests.runtime.character.test_character_forms import FOLDER, MODULES

MESHOPT = "EXT_meshopt_compression"


@pytest.mark.parametrize(
    ("mode", "changes"),
    [
        ("ATTRIBUTES", {"filter": "QUATERNION", "byteStride": 4}),
        ("ATTRIBUTES", {"filter": "QUATERNION", "byteStride": 12}),
        ("ATTRIBUTES", {"filter": "OCTAHEDRAL", "byteStride": 12}),
        ("ATTRIBUTES", {"filter": "EXPONENTIAL", "byteStride": 6}),
        ("ATTRIBUTES", {"filter": "NONE", "byteStride": 512}),
        ("ATTRIBUTES", {"filter": "OTHER"}),
        ("ATTRIBUTES", {"count": 1 << 40}),
        ("ATTRIBUTES", {"count": -1}),
        ("ATTRIBUTES", {"count": 1.5}),
        ("ATTRIBUTES", {"byteLength": 1 << 40}),
        ("ATTRIBUTES", {"byteOffset": -4}),
        ("ATTRIBUTES", {"buffer": 7}),
        ("ATTRIBUTES", {"mode": "INDICES"}),
        ("TRIANGLES", {"byteStride": 3}),
        ("TRIANGLES", {"count": 4}),
        ("TRIANGLES", {"filter": "QUATERNION"}),
        ("TRIANGLES", {"mode": "OTHER"}),
    ],
)
def test_meshopt_is_not_called_with_what_its_extension_forbids(
    mode: str, changes: dict[str, Any], tmp_path: Path
) -> None:
    pytest.importorskip("meshoptimizer", reason="needs the extra [characters]")
    document, blob = split_glb((FOLDER / "box_man_meshopt.glb").read_bytes())
    views = [view["extensions"][MESHOPT] for view in document["bufferViews"] if "extensions" in view]
    next(view for view in views if view["mode"] == mode).update(changes)
    path = tmp_path / "packed.glb"
    path.write_bytes(join_glb(document, blob))
    with pytest.raises(FileError, match="damaged"):
        load_character(path)


def test_an_fbx_of_very_many_nodes_is_refused_before_they_are_read(tmp_path: Path) -> None:
    pytest.importorskip("ufbx", reason="needs the extra [characters]")
    nodes = "".join(f'Model: {k + 9},"Model::","Null" {{}}\n' for k in range(27_000))
    path = tmp_path / "bomb.fbx"
    head = "; FBX 7.4.0 project file\nFBXHeaderExtension: {\n FBXVersion: 7400\n}\nObjects: {\n"
    path.write_text(f"{head}{nodes}}}\n")
    with pytest.raises(FileError, match=r"damaged \(an FBX: ValueError: 27001 nodes"):
        load_character(path)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere memory is not bounded")
@pytest.mark.parametrize("name", ["box_man.fbx", "box_man_draco.glb"])
def test_a_reader_that_takes_more_memory_than_it_may_is_a_sentence(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip(MODULES[name], reason="needs the extra [characters]")
    monkeypatch.setattr(native, "WORKING_BYTES", 1 << 16)
    monkeypatch.setattr(native, "BYTES_FOR_ONE", 0)
    native._decoded.cache_clear()
    with pytest.raises(FileError, match="damaged"):
        load_character(FOLDER / name)


def test_a_reader_that_takes_too_long_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ufbx", reason="needs the extra [characters]")
    monkeypatch.setattr(native, "TIMEOUT_S", 0.01)
    native._decoded.cache_clear()
    with pytest.raises(FileError, match="not read in"):
        load_character(FOLDER / "box_man.fbx")


@pytest.mark.parametrize("kind", ["ktx2", "draco"])
def test_a_reader_that_dies_or_stumbles_is_a_sentence(kind: str, tmp_path: Path) -> None:
    pytest.importorskip(native.PACKAGES[kind][0], reason="needs the extra [characters]")
    facts = {"parts": [{"length": 100, "attributes": [0]}]}
    with pytest.raises(FileError, match=r"me\.glb: damaged"):
        native.decode(kind, tmp_path / "me.glb", facts, bytes(100), "Export it again.")
