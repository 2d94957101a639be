"""Small files that would cost much, run something or never end: refused, or read at their own size."""

import contextlib
import os
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from runtime.character.character import load_character
from runtime.character.joint_map import read_joint_map
from runtime.errors import FileError, SportError
from runtime.formats.bvh import MAX_JOINT_FRAMES, parse_bvh, read_bvh
from runtime.formats.bvh_clip import save_bvh
from runtime.generate import load_parts, parse_prompts
from runtime.motion.model_files import read_metadata
from runtime.prompts.text_encoder import TextEncoder
from runtime.skeleton import REST_HIPS_HEIGHT
from runtime.takes.clip import Clip
from runtime.terrain.files import read_terrain
from tests.helpers.counting import allocated, bounded
from tests.helpers.gltf_characters import character_glb, join_glb, split_glb, textured
from training.baselines.matching import Database
from viewer.edit.video import read_video

MOTION = "MOTION\nFrames: {}\nFrame Time: 0.01\n"


def chain(joints: int, channels: str = "") -> str:
    """A HIERARCHY of joints one below the other, of which the root alone has channels."""
    lines = ["HIERARCHY", "ROOT j0", "{", "OFFSET 0 0 0", f"CHANNELS {len(channels.split())} {channels}"]
    for j in range(1, joints):
        lines += [f"JOINT j{j}", "{", "OFFSET 0 1 0", "CHANNELS 0"]
    return "\n".join(lines + ["}"] * joints) + "\n"


def png(width: int, height: int, colour: int = 0, bits: int = 16) -> bytes:
    """A PNG of zeros, far smaller than what it unfolds to."""
    packer = zlib.compressobj(1)
    line = b"\0" * (1 + width * (3 if colour == 2 else 1) * bits // 8)
    data = b"".join(packer.compress(line) for _ in range(height)) + packer.flush()
    head = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", data), (b"IEND", b""))
    body = b"".join(
        struct.pack(">I", len(b)) + k + b + struct.pack(">I", zlib.crc32(k + b)) for k, b in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + body


# --- nothing in a file is run
@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """What Pillow is asked to open."""
    asked: list[object] = []
    monkeypatch.setattr(Image, "open", lambda *a, **k: asked.append(a))
    return asked


@pytest.mark.parametrize("embedded", [True, False])
def test_a_texture_of_postscript_never_reaches_pillows_guess(
    embedded: bool, tmp_path: Path, opened: list[object]
) -> None:
    script = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n(x) run\n"
    (tmp_path / "image.png").write_bytes(script)
    (tmp_path / "bad.glb").write_bytes(textured({"uri": "image.png"}, script if embedded else b""))
    with pytest.raises(FileError, match="image 0 is neither PNG, JPEG, WebP nor KTX2"):
        load_character(tmp_path / "bad.glb")
    assert opened == []


def test_grounds_never_look_at_textures(tmp_path: Path, opened: list[object]) -> None:
    (tmp_path / "image.png").write_bytes(b"%!PS\n")
    (tmp_path / "ground.mtl").write_text("newmtl m\nmap_Kd image.png\n", encoding="utf-8")
    corners = "v 0 0 0\nv 3 0 0\nv 3 0 3\nvt 0 0\n"
    (tmp_path / "ground.obj").write_text(f"mtllib ground.mtl\n{corners}usemtl m\nf 1/1 3/1 2/1\n")
    (tmp_path / "ground.glb").write_bytes(textured({"uri": "image.png"}))
    head = "ply\nformat ascii 1.0\ncomment TextureFile image.png\nelement vertex 3\nproperty float x\n"
    head += "property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "ground.ply").write_text(head + "0 0 0\n3 0 0\n3 0 3\n3 0 2 1\n")
    for suffix in ("obj", "ply"):
        assert read_terrain(tmp_path / f"ground.{suffix}").heights.shape == (31, 31)
    read_terrain(tmp_path / "ground.glb", cell_m=1.0)
    assert opened == []


def test_png_and_jpeg_still_colour(tmp_path: Path) -> None:
    for kind in ("PNG", "JPEG"):
        Image.new("RGB", (900, 1100), (255, 0, 0)).save(tmp_path / "image", kind)
        (tmp_path / "red.glb").write_bytes(textured({"uri": "image"}))
        assert np.allclose(load_character(tmp_path / "red.glb").colors, (1, 0, 0), atol=0.02)


# --- nothing is waited for
READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "bvh": ("a.bvh", read_bvh),
    "character": ("a.glb", load_character),
    "joint map": ("a.json", read_joint_map),
    "parts": ("a.json", load_parts),
    **{s: (f"a.{s}", read_terrain) for s in ("png", "npy", "obj", "ply", "stl", "off", "glb")},
    "model": ("metadata.json", lambda path: read_metadata(path.parent)),
    "text encoder": ("text_encoder.json", lambda path: TextEncoder(path.parent).name),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
@pytest.mark.parametrize("case", READERS)
def test_a_pipe_or_a_device_is_refused_at_once(case: str, tmp_path: Path) -> None:
    name, read = READERS[case]
    os.mkfifo(tmp_path / name)
    with pytest.raises(SportError, match="not a regular file"):
        read(tmp_path / name)
    (tmp_path / name).unlink()
    (tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(SportError, match="not a regular file"):
        read(tmp_path / name)


# --- bombs
def bomb_bvh_of_1024_joints(path: Path, frames: int = 1_000_000) -> Callable[[], object]:
    path.write_text(chain(1024, "Xposition") + MOTION.format(frames) + "0\n" * frames, encoding="utf-8")
    return lambda: read_bvh(path)


bomb_bvh_at_the_limit = partial(bomb_bvh_of_1024_joints, frames=MAX_JOINT_FRAMES // 1024)


def bomb_glb_of_300_primitives(path: Path) -> Callable[[], object]:
    document, blob = split_glb(character_glb())
    count = 39_999
    kinds = {"POSITION": (5126, "VEC3", 12), "JOINTS_0": (5123, "VEC4", 8), "WEIGHTS_0": (5126, "VEC4", 16)}
    values = {"POSITION": 0.0, "JOINTS_0": 0, "WEIGHTS_0": 0.25}
    attributes = {}
    for name, (component, kind, size) in kinds.items():
        number, each = (np.uint16, 2) if component == 5123 else (np.float32, 4)
        data = np.full(count * size // each, values[name]).astype(number)
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": data.nbytes})
        document["accessors"].append(
            {"bufferView": len(document["bufferViews"]) - 1, "componentType": component, "count": count,
             "type": kind}
        )  # fmt: skip
        attributes[name] = len(document["accessors"]) - 1
        blob += data.tobytes()
    document["meshes"][0]["primitives"] = [{"attributes": attributes}] * 300
    document["buffers"][0]["byteLength"] = len(blob)
    path.write_bytes(join_glb(document, blob))
    return lambda: load_character(path)


def bomb_glb_chain(path: Path) -> Callable[[], object]:
    document, blob = split_glb(character_glb())
    first, count = len(document["nodes"]), 19_000
    document["nodes"] += [{"children": [first + i + 1]} for i in range(count)] + [{"mesh": 0}]
    path.write_bytes(join_glb(document, blob))
    return lambda: load_character(path)


def bomb_glb_of_30000_nodes(path: Path) -> Callable[[], object]:
    nodes = [{"children": [i + 1]} for i in range(30_000)] + [{}]
    path.write_bytes(join_glb({"nodes": nodes, "skins": [{"joints": list(range(30_000))}]}, b""))
    return lambda: load_character(path)


def bomb_texture(path: Path) -> Callable[[], object]:
    path.write_bytes(textured({}, png(8192, 8192, 2, 8)))
    return lambda: load_character(path)


def bomb_texture_of_gigapixels(path: Path) -> Callable[[], object]:
    data = bytearray(png(16, 16, 2, 8))
    data[16:24] = struct.pack(">II", 60_000, 60_000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    path.write_bytes(textured({}, bytes(data)))
    return lambda: load_character(path)


def bomb_triangles(path: Path) -> Callable[[], object]:
    path = path.with_suffix(".obj")
    path.write_text("v 0 0 0\nv 400 0 0\nv 0 0 400\n" + "f 1 2 3\n" * 200_000, encoding="utf-8")
    return lambda: read_terrain(path)


def bomb_ground_png(path: Path) -> Callable[[], object]:
    path = path.with_suffix(".png")
    path.write_bytes(png(4096, 4096))
    return lambda: read_terrain(path)


def bomb_npy_header(path: Path) -> Callable[[], object]:
    path = path.with_suffix(".npy")
    path.write_bytes(b"\x93NUMPY\x02\0" + struct.pack("<I", 4_000_000_000) + b"(" * 1_000_000)
    return lambda: read_terrain(path)


def bomb_npz_of_a_motion_database(path: Path) -> Callable[[], object]:
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("world.npy", "w") as member,
    ):
        header = {"descr": "<f4", "fortran_order": False, "shape": (160, 1024, 1024)}
        np.lib.format.write_array_header_1_0(member, header)
        for _ in range(160):
            member.write(bytes(4 << 20))
    return lambda: Database.load(path)


def bomb_npz_header(path: Path) -> Callable[[], object]:
    with zipfile.ZipFile(path, "w") as archive, archive.open("world.npy", "w") as member:
        header = {"descr": "<f4", "fortran_order": False, "shape": (1 << 40, 1 << 20)}
        np.lib.format.write_array_header_1_0(member, header)
    return lambda: Database.load(path)


def bomb_gif_of_40_large_pictures(path: Path) -> Callable[[], object]:
    path = path.with_suffix(".gif")
    Image.new("P", (8000, 8000)).save(path, save_all=True, append_images=[])
    data = path.read_bytes()
    path.write_bytes(data[:-1] + data[data.index(b"\x2c") : -1] * 39 + b";")
    return lambda: read_video(path)


def bomb_prompts(_path: Path) -> Callable[[], object]:
    return lambda: parse_prompts("0:a" + " " * 90_000 + "\x01;" + " " * 90_000)


def bomb_parts(path: Path) -> Callable[[], object]:
    path.write_bytes(b"[" * 50_000)
    return lambda: load_parts(path)


def bomb_fps(path: Path) -> Callable[[], object]:
    hips = np.tile(np.array([0, REST_HIPS_HEIGHT, 0], np.float32), (60_000, 1))
    turns = np.tile(np.array([1, 0, 0, 0], np.float32), (60_000, 31, 1))
    clip = Clip("long", 60.0, hips, turns, np.zeros((60_000, 4), np.float32))
    return lambda: save_bvh(clip, path, fps=1000.0)


BOMBS = {
    name.removeprefix("bomb_").replace("_", " "): make
    for name, make in sorted(globals().items()) if name.startswith("bomb_")
}  # fmt: skip
READ = ("bvh at the limit", "glb chain", "ground png", "texture")


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_or_read_and_costs_little(name: str, tmp_path: Path) -> None:
    work = BOMBS[name](tmp_path / "0.bin")
    refused = contextlib.nullcontext() if name in READ else pytest.raises(SportError)
    with bounded(), refused:
        work()


def test_a_valid_bvh_costs_little_more_than_its_motion() -> None:
    frames, width = 20_000, 6
    head = chain(1, "Xposition Yposition Zposition Zrotation Yrotation Xrotation")
    data = (head + MOTION.format(frames) + "1.23456 " * (frames * width)).encode()
    with allocated() as peak:
        motion = parse_bvh(data)
    assert motion.positions[-1, 0, 2] == pytest.approx(1.23456)
    assert peak[0] < motion.positions.nbytes + motion.local_rotations.nbytes + 40e6
