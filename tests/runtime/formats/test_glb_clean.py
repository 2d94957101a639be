"""What a GLB of a take leaves out: accessors of old animations, and offsets of accessors without bytes (sparse ones)."""

import json
from pathlib import Path

from runtime.character.character import load_character
from runtime.formats.glb import save_glb
from runtime.formats.prepare import ExportOptions, prepare
from runtime.takes.clip import Clip
from tests.helpers.foreign_rigs import sparse_rig
from tests.helpers.gltf_characters import split_glb
from tests.helpers.walker import walk


def test_a_take_holds_what_it_uses_and_no_offsets_without_bytes(tmp_path: Path) -> None:
    source = sparse_rig(tmp_path / "sparse.glb")
    hips, local, contacts = walk(20)
    options = ExportOptions(character=source)
    take = prepare(Clip("walk", 60.0, hips, local, contacts), options)
    save_glb(take, tmp_path / "take.glb", options, None)
    document, _ = split_glb((tmp_path / "take.glb").read_bytes())
    sparse = [accessor for accessor in document["accessors"] if "sparse" in accessor]
    assert len(sparse) == 1
    assert "bufferView" not in sparse[0]
    assert "byteOffset" not in sparse[0]
    text = json.dumps([document["meshes"], document["skins"], document["animations"]])
    used = {index for mesh in document["meshes"] for p in mesh["primitives"]
            for index in (p["indices"], *p["attributes"].values(), *(t["POSITION"] for t in p.get("targets", [])))}  # fmt: skip
    used |= {skin["inverseBindMatrices"] for skin in document["skins"]}
    used |= {s[end] for a in document["animations"] for s in a["samplers"] for end in ("input", "output")}
    assert used == set(range(len(document["accessors"]))), text[:200]
    load_character(tmp_path / "take.glb")
