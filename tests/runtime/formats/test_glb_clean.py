"""What a GLB of a take leaves out: accessors of old animations, and offsets of accessors without bytes (sparse ones)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from runtime.character.character import load_character
from runtime.formats.glb import save_glb
from runtime.formats.prepare import ExportOptions, prepare
from runtime.takes.clip import Clip
from tests.helpers.foreign_rigs import mixamo_rig
from tests.helpers.gltf_characters import join_glb, split_glb
from tests.helpers.walker import walk


def sparse_rig(path: Path) -> Path:
    """A character with a shape key as Blender writes it (sparse, without bytes of its own) and an old animation."""
    document, blob = split_glb(mixamo_rig(path).read_bytes())
    primitive = document["meshes"][0]["primitives"][0]
    count = document["accessors"][primitive["attributes"]["POSITION"]]["count"]

    def view(data: bytes) -> int:
        nonlocal blob
        blob += b"\0" * (-len(blob) % 4)
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        blob += data
        return len(document["bufferViews"]) - 1

    indices, values = (
        view(np.uint16([0, 3]).tobytes()),
        view(np.float32([[0, 0, 0.1], [0, 0, 0.2]]).tobytes()),
    )
    document["accessors"].append(
        {"componentType": 5126, "count": count, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 0.2],
         "sparse": {"count": 2, "indices": {"bufferView": indices, "componentType": 5123},
                    "values": {"bufferView": values}}}
    )  # fmt: skip
    primitive["targets"] = [{"POSITION": len(document["accessors"]) - 1}]
    times, turns = view(np.float32([0, 1]).tobytes()), view(np.float32([[0, 0, 0, 1]] * 2).tobytes())
    document["accessors"] += [
        {"bufferView": times, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1]},
        {"bufferView": turns, "componentType": 5126, "count": 2, "type": "VEC4"},
    ]
    last = len(document["accessors"])
    document["animations"] = [
        {"samplers": [{"input": last - 2, "output": last - 1}],
         "channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}]}
    ]  # fmt: skip
    blob += b"\0" * (-len(blob) % 4)
    document["buffers"] = [{"byteLength": len(blob)}]
    path.write_bytes(join_glb(document, blob))
    return path


def test_a_take_holds_what_it_uses_and_no_offsets_without_bytes(tmp_path: Path) -> None:
    source = sparse_rig(tmp_path / "sparse.glb")
    hips, local, contacts = walk(20)
    options = ExportOptions(character=source)
    save_glb(
        prepare(Clip("walk", 60.0, hips, local, contacts), options), tmp_path / "take.glb", options, None
    )
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
