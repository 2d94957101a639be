"""Targets that are files: motion, characters and grounds."""

import base64
import contextlib
import io
import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from runtime.assets import PROJECT_ROOT
from runtime.character.character import load_character
from runtime.character.joint_map import read_joint_map
from runtime.errors import SportError
from runtime.formats.bvh import MAX_VALUE, format_bvh, read_bvh
from runtime.formats.bvh_clip import OtherSkeleton, load_clip_bvh, save_bvh
from runtime.formats.glb import save_glb
from runtime.formats.gltf_motion import contents, read_gltf_motion
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.reference import open_take
from runtime.formats.sidecar import format_metadata
from runtime.formats.usd import save_usd
from runtime.pose import Pose
from runtime.prompts.blend import read_words
from runtime.session.motion import Motion
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON
from runtime.takes.clip import MAX_DISTANCE_M, Clip
from runtime.takes.metadata import Origin, PromptEvent, title
from runtime.terrain.files import MAX_HEIGHT_M, read_terrain
from tests.helpers.gltf_characters import character_glb, join_glb, make_pose, split_glb, textured
from tests.helpers.height_maps import write_height_png

from .mutate import damaged_bytes, damaged_glb, damaged_json, damaged_png, damaged_text
from .target import Target, put


def clip(frames: int = 4) -> Clip:
    """A few frames of a turning character."""
    local = np.random.default_rng(1).normal(size=(frames, 31, 4))
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    hips = np.tile(np.array([0, REST_HIPS_HEIGHT, 0]), (frames, 1))
    contacts, gaits = np.zeros((frames, 4), np.float32), (("walk", 2.0), ("stand", 1.0))
    prompts = (PromptEvent(0.0, "a proud walk"), PromptEvent(0.05, "drunk", 1.0))
    origin = Origin("tiny", "ab" * 32, "fp32", 3, 0.7, 1.0, 0)
    hips, local = hips.astype(np.float32), local.astype(np.float32)
    return Clip("take", 60.0, hips, local, contacts, prompts, "hills", origin, gaits)


# --- motion
def _bvh_seeds(folder: Path) -> list[bytes]:
    ours = save_bvh(clip(), folder / "seed.bvh").read_bytes()
    take = clip(2)
    other = format_bvh(SPORT_SKELETON, {0: take.hips_positions}, take.local_rotations, 30.0, order="XYZ")
    small = (
        "HIERARCHY\nROOT Hips\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation"
        " Xrotation\n JOINT Spine\n {\n  OFFSET 0 10 0\n  CHANNELS 3 Zrotation Yrotation Xrotation\n  End Site\n"
        "  {\n   OFFSET 0 5 0\n  }\n }\n}\nMOTION\nFrames: 3\nFrame Time: 0.0166\n"
        + "1 2 3 4 5 6 7 8 9\n"
        * 3
    )
    return [ours, other.encode(), small.encode(), small.encode()]


def _read_bvh(folder: Path, data: bytes) -> None:
    path = put(folder, "input.bvh", data)
    motion = read_bvh(path)
    for values in (motion.positions, motion.local_rotations):
        assert np.abs(values).max(initial=0.0) <= MAX_VALUE
    assert np.isfinite(motion.fps)
    with np.errstate(over="ignore", invalid="ignore"):
        motion.world()
    try:
        take = load_clip_bvh(path)
    except OtherSkeleton:
        take = open_take(path).reference.clip
    assert np.abs(take.hips_positions).max() <= MAX_DISTANCE_M
    assert np.isfinite(take.pose(0).positions).all()
    if take.seconds < 100.0:
        take.resampled(30.0)


def _metadata_seeds(folder: Path) -> list[bytes]:
    save_bvh(clip(), folder / "input.bvh")
    return [(folder / "input.bvh.json").read_bytes()]


def _read_metadata(folder: Path, data: bytes) -> None:
    put(folder, "input.bvh.json", data)
    take = load_clip_bvh(folder / "input.bvh")
    Motion.of(take).header.describe().encode()
    format_metadata(take, "").encode()
    for event in take.prompts:
        assert np.isfinite([event.seconds, event.transition_seconds]).all()
        title(event).encode()
        for words in (event.prompt, event.words):
            try:
                read_words(words)
            except SportError:  # of this one prompt; the others are still there
                continue


def keys_glb() -> bytes:
    """A node of cubic places and stepped turns: the least that is an animation."""
    cubic = np.array([[0, 0, 0], [0, 0, 0], [3, 0, 0], [0, 0, 0], [3, 0, 0], [0, 0, 0]], "<f4")
    step = np.array([[0, 0, 0, 1], [0, 1, 0, 0]], "<f4")
    blob = np.array([0.0, 1.0], "<f4").tobytes() + cubic.tobytes() + step.tobytes()
    kinds = enumerate(((2, "SCALAR"), (6, "VEC3"), (2, "VEC4")))
    accessors = [{"bufferView": k, "componentType": 5126, "count": n, "type": kind} for k, (n, kind) in kinds]
    kinds, paths = ("CUBICSPLINE", "STEP"), ("translation", "rotation")
    document = {
        "asset": {"version": "2.0"}, "nodes": [{"name": "Hips"}], "scenes": [{"nodes": [0]}],
        "buffers": [{"byteLength": len(blob)}], "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in ((0, 8), (8, 72), (80, 32))
        ],
        "animations": [{
            "samplers": [{"input": 0, "output": 1 + k, "interpolation": kind} for k, kind in enumerate(kinds)],
            "channels": [{"sampler": k, "target": {"node": 0, "path": path}} for k, path in enumerate(paths)],
        }],
    }  # fmt: skip
    return join_glb(document, blob)


def _motion_seeds(folder: Path) -> list[bytes]:
    put(folder, "seed.glb", character_glb())
    options = ExportOptions(character=folder / "seed.glb", fps=30.0)
    save_glb(prepare(clip(), options, None), folder / "moving.glb", options, None)
    return [keys_glb(), (folder / "moving.glb").read_bytes()]


def _read_motion(folder: Path, data: bytes) -> None:
    path = put(folder, "input.glb", data)
    contents(path)
    motion = read_gltf_motion(path)
    assert max(np.abs(motion.positions).max(), np.abs(motion.skeleton.offsets).max()) <= MAX_VALUE
    assert np.isfinite(motion.local_rotations).all()
    for name in motion.skeleton.names:
        name.encode()
    take = open_take(path).clip
    assert np.abs(take.hips_positions).max() <= MAX_DISTANCE_M
    assert np.isfinite(take.pose(0).positions).all()


# --- characters
def _glb_seeds(_folder: Path) -> list[bytes]:
    image = base64.b64encode(_image("PNG")).decode()
    return [character_glb(), textured({"uri": f"data:image/png;base64,{image}"})]


def _gltf_seeds(_folder: Path) -> list[bytes]:
    document, blob = split_glb(character_glb())
    document["buffers"][0]["uri"] = "data:;base64," + base64.b64encode(blob).decode()
    return [json.dumps(document).encode()]


def _form(*names: str) -> Callable[[Path], list[bytes]]:
    """Characters in forms that native libraries decode."""
    folder = PROJECT_ROOT / "tests/runtime/character/characters"
    return lambda _: [(folder / f"box_man{name}").read_bytes() for name in names]


def _read_fbx(folder: Path, data: bytes) -> None:
    path = put(folder, "input.fbx", data)
    _load(path)
    with contextlib.suppress(SportError):  # a character without motion
        assert np.isfinite(open_take(path).clip.pose(0).positions).all()


def _load(path: Path) -> None:
    character = load_character(path)
    pose: Pose = make_pose(1)
    with np.errstate(over="ignore", invalid="ignore"):
        character.skin_matrices(pose)
    for name in character.joint_names:
        name.encode()


def _to_usd(folder: Path, data: bytes) -> None:
    options = ExportOptions(character=put(folder, "input.glb", data), fps=30.0)
    save_usd(prepare(clip(), options, None), folder / "take.usd", options, None)


def _image(kind: str) -> bytes:
    out = io.BytesIO()
    pixels = np.random.default_rng(2).integers(0, 255, (16, 16, 3), np.uint8)
    Image.fromarray(pixels).save(out, kind)
    return out.getvalue()


def _texture_seeds(folder: Path) -> list[bytes]:
    put(folder, "input.glb", textured({"uri": "image.png"}))
    return [_image("PNG"), _image("JPEG"), _image("JPEG"), b"%!PS\n/x 1 def showpage\n", _image("GIF")]


def _read_texture(folder: Path, data: bytes) -> None:
    put(folder, "image.png", data)
    _load(folder / "input.glb")


def _map_seeds(_folder: Path) -> list[bytes]:
    return [json.dumps({name: f"bone {name}" for name in SPORT_SKELETON.names}).encode()]


# --- grounds
def _ground(suffix: str, data: bytes, folder: Path) -> None:
    terrain = read_terrain(put(folder, f"input{suffix}", data))
    assert np.abs(terrain.heights).max() <= MAX_HEIGHT_M
    assert np.isfinite(terrain.height(0.3, 0.3))
    assert np.isfinite(terrain.normal(0.3, 0.3)).all()


def _png_seeds(folder: Path) -> list[bytes]:
    heights = np.random.default_rng(3).random((12, 9))
    write_height_png(folder / "seed.png", heights)
    eight = io.BytesIO()
    Image.fromarray((heights * 255).astype(np.uint8)).save(eight, "PNG")
    return [(folder / "seed.png").read_bytes(), eight.getvalue()]


def _npy_seeds(_folder: Path) -> list[bytes]:
    seeds = []
    for kind in ("<f4", ">f8", "u1", "<u2", "<i4"):
        out = io.BytesIO()
        np.save(out, np.arange(20).reshape(4, 5).astype(kind))
        seeds.append(out.getvalue())
    return seeds


def _damaged_header(rng, data: bytes) -> bytes:
    """Damage to the header of an NPY file, which is most of what can be wrong with it."""
    if rng.random() < 0.3:
        return damaged_bytes(rng, data)
    head = damaged_text(rng, data[10:128])
    return data[:8] + struct.pack("<H", min(len(head), 65535)) + head + data[128:]


def _mesh_seeds(kind: str):
    def seeds(_folder: Path) -> list[bytes]:
        import trimesh

        corners = [[0, 0, 0], [3, 0.1, 0], [3, 0.2, 3], [0, 0, 3]]
        mesh = trimesh.Trimesh(corners, [[0, 2, 1], [0, 3, 2]], process=False)
        if kind == "obj":
            text = (
                b"v 0 0 0\nv 3 0 0\nv 3 0.5 3\nv 0 0 3\nvt 0 0\nmtllib a.mtl\nf 1/1 2/1 3/1 4/1\nf -1 -2 -3\n"
            )
            return [text]
        if kind == "ply":
            return [mesh.export(file_type="ply", encoding=e) for e in ("ascii", "binary")]
        if kind == "stl":
            return [mesh.export(file_type="stl"), mesh.export(file_type="stl_ascii").encode()]
        exported = mesh.export(file_type=kind)
        return [exported if isinstance(exported, bytes) else exported.encode()]

    return seeds


def _either(rng, data: bytes) -> bytes:
    return (damaged_text if rng.random() < 0.7 else damaged_bytes)(rng, data)


def _mesh(kind: str, damage) -> Target:
    return Target(
        f"ground .{kind}", _mesh_seeds(kind), damage, lambda folder, data: _ground(f".{kind}", data, folder)
    )


def _sidecar_of(rng, data: bytes) -> bytes:
    """Damage that leaves the hash alone as a rule, without which nothing else is read."""
    out = damaged_json(rng, data)
    try:
        value = json.loads(out)
        if isinstance(value, dict) and rng.random() < 0.9:
            value |= {"format": "sport-take", "bvh_sha256": json.loads(data)["bvh_sha256"]}
        return json.dumps(value).encode()
    except (ValueError, RecursionError):
        return out


KINDS = {
    "mode": ("ATTRIBUTES", "TRIANGLES", "INDICES", "OTHER", None),
    "filter": ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "OTHER"),
}
NUMBERS = (0, 1, 2, 3, 4, 6, 8, 12, 16, 252, 256, 260, -4, 2**31, 2**63, 4.0, "4", None)


def _meshopt_json(rng, data: bytes) -> bytes:
    """Other modes, filters, strides, counts and lengths of what is packed, some of them as they go together."""
    document, blob = split_glb(data)
    views = [view for view in document["bufferViews"] if "extensions" in view]
    for view in rng.sample(views, rng.choice((1, 1, 2, len(views)))):
        (packed,) = view["extensions"].values()
        fields = ("mode", "filter", "byteStride", "count", "byteLength", "byteOffset")
        for field in rng.sample(fields, rng.choice((1, 1, 2, 3))):
            near = packed.get(field, 0) + rng.choice((-4, -1, 1, 4)) if field not in KINDS else None
            packed[field] = rng.choice(KINDS.get(field, (*NUMBERS, near)))
        if rng.random() < 0.7 and all(type(packed[name]) is int for name in ("count", "byteStride")):
            view["byteLength"] = packed["count"] * packed["byteStride"]
    return join_glb(document, blob)


TARGETS = (
    Target("BVH", _bvh_seeds, damaged_text, _read_bvh, 2.0),
    Target("take metadata", _metadata_seeds, _sidecar_of, _read_metadata),
    Target("motion .glb", _motion_seeds, damaged_glb, _read_motion),
    Target("character .glb", _glb_seeds, damaged_glb, lambda f, d: _load(put(f, "input.glb", d)), 2.0),
    Target("packed character", _form("_meshopt.glb", "_draco.glb", "_ktx2.glb", "_webp.glb"), damaged_glb,
           lambda f, d: _load(put(f, "input.glb", d)), 0.1),
    Target("meshopt JSON", _form("_meshopt.glb"), _meshopt_json, lambda f, d: _load(put(f, "input.glb", d)), 0.3),
    Target("FBX", _form(".fbx"), damaged_bytes, _read_fbx, 0.1),
    Target("character .gltf", _gltf_seeds, damaged_json, lambda f, d: _load(put(f, "input.gltf", d))),
    Target("character to USD", _glb_seeds, damaged_glb, _to_usd, 0.3),
    Target("texture", _texture_seeds, damaged_png, _read_texture),
    Target("joint map", _map_seeds, damaged_json, lambda f, d: read_joint_map(put(f, "input.json", d))),
    Target("ground .png", _png_seeds, damaged_png, lambda f, d: _ground(".png", d, f)),
    Target("ground .npy", _npy_seeds, _damaged_header, lambda f, d: _ground(".npy", d, f)),
    _mesh("obj", damaged_text),
    _mesh("ply", _either),
    _mesh("stl", _either),
    _mesh("off", damaged_text),
    _mesh("glb", damaged_glb),
)  # fmt: skip
