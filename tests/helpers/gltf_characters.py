"""Poses and a user's character for tests of glTF, and splitting of GLB files."""

import json
import struct
import tempfile
from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.character.character import Character
from runtime.character.joints import align, match_names
from runtime.character.writer import write_character
from runtime.pose import Pose
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON


def make_pose(seed: int | None, angle: float = 0.8) -> Pose:
    """Return a random pose, or the rest pose without a seed."""
    local = rotations.identity((31,)).astype(np.float64)
    hips = np.array([0.0, REST_HIPS_HEIGHT, 0.0])
    if seed is not None:
        rng = np.random.default_rng(seed)
        axes = rotations.normalize(rng.normal(size=(31, 3)))
        local = rotations.from_axis_angle(axes, rng.uniform(-angle, angle, 31))
        hips = hips + rng.normal(size=3)
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    return Pose(hips, local, positions, world, np.zeros(4), hips * (1, 0, 1), 0.0)


# --- A user's character: Mixamo names, centimetres, A-pose, arbitrary bone axes, one extra joint above and one below.
_MIXAMO_PARENTS = {
    "Armature": "", "Hips": "Armature", "Spine": "Hips", "Spine1": "Spine", "Spine2": "Spine1", "Neck": "Spine2",
    "Head": "Neck", "HeadTop_End": "Head",
    **{side + bone: (side if own else "") + parent for side in ("Left", "Right") for bone, parent, own in (
        ("Shoulder", "Spine2", False), ("Arm", "Shoulder", True), ("ForeArm", "Arm", True), ("Hand", "ForeArm", True),
        ("HandMiddle1", "Hand", True), ("UpLeg", "Hips", False), ("Leg", "UpLeg", True), ("Foot", "Leg", True),
        ("ToeBase", "Foot", True))},
}  # fmt: skip
_CENTRE = {"Armature": (0, 0, 0), "Hips": (0, 105, 0), "Spine": (0, 117, -1), "Spine1": (0, 130, -2),
           "Spine2": (0, 145, -3), "Neck": (0, 160, -3), "Head": (0, 170, 0), "HeadTop_End": (0, 190, 2)}  # fmt: skip
_LEFT = {"Shoulder": (6, 153, -3), "Arm": (18, 152, -4), "ForeArm": (38, 132, -4), "Hand": (56, 114, -4),
         "HandMiddle1": (63, 107, -4), "UpLeg": (9, 98, 1), "Leg": (10, 54, 2), "Foot": (11, 10, -1),
         "ToeBase": (13, 2, 13)}  # fmt: skip


def user_character(names: tuple[str, ...] | None = None) -> Character:
    """Return a stick-figure mesh: a small triangle at each joint of a Mixamo-like skeleton."""
    where = {k: np.array(v, float) for k, v in _CENTRE.items()}
    for bone, point in _LEFT.items():
        where["Left" + bone] = np.array(point, float)
        where["Right" + bone] = np.array(point, float) * (-1, 1, 1)
    order = list(_MIXAMO_PARENTS)
    parents = tuple(order.index(p) if (p := _MIXAMO_PARENTS[n]) else -1 for n in order)
    rng = np.random.default_rng(5)
    world = np.tile(np.eye(4), (len(order), 1, 1))
    world[:, :3, :3] = rotations.to_matrix(rotations.normalize(rng.normal(size=(len(order), 4))))
    world[:, :3, 3] = np.array([where[n] for n in order])
    base = np.repeat(world[:, :3, 3], 3, axis=0)
    sole = np.tile([(0, 0, 0), (1, 0, 0), (0, 0, 1)], (len(order), 1)).astype(float)
    base[-3:] = (11.0, 0.0, 0.0)  # the lowest points of the mesh: the sole
    count = len(base)
    return Character(
        positions=(base + sole).astype(np.float32),
        normals=np.tile(np.float32([0, 1, 0]), (count, 1)),
        colors=np.full((count, 3), 0.5, np.float32),
        joint_indices=np.stack([np.repeat(np.arange(len(order)), 3)] + [np.zeros(count, int)] * 3, 1).astype(
            np.uint16
        ),
        joint_weights=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        triangles=np.arange(count, dtype=np.uint32).reshape(-1, 3),
        joint_names=names or tuple("mixamorig:" + n for n in order),
        joint_parents=parents,
        inverse_bind=np.linalg.inv(world).astype(np.float32),
        rest_world=world.astype(np.float32),
        sport_joints=np.full(len(order), -1),
        alignment=align(match_names(order)[0], parents, world, base),
    )


def split_glb(data: bytes) -> tuple[dict, bytes]:
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def join_glb(document: dict, blob: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(blob)) + b"BIN\0" + blob
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def character_glb() -> bytes:
    """Return the user's character as a GLB."""
    with tempfile.TemporaryDirectory() as folder:
        write_character(Path(folder) / "plain.glb", user_character())
        return (Path(folder) / "plain.glb").read_bytes()


def textured(image: dict, extra: bytes = b"") -> bytes:
    """Return a GLB of a character textured by one image: `image` of its document, or `extra` in the file itself."""
    document, blob = split_glb(character_glb())
    count = document["accessors"][0]["count"]
    document["bufferViews"] += [
        {"buffer": 0, "byteOffset": len(blob), "byteLength": count * 8},
        {"buffer": 0, "byteOffset": len(blob) + count * 8, "byteLength": len(extra)},
    ]
    view = len(document["bufferViews"]) - 1
    coordinates = {"bufferView": view - 1, "componentType": 5126, "count": count, "type": "VEC2"}
    document["accessors"].append(coordinates)
    primitive = document["meshes"][0]["primitives"][0]
    primitive["attributes"]["TEXCOORD_0"] = len(document["accessors"]) - 1
    del primitive["attributes"]["COLOR_0"]
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    blob += bytes(count * 8) + extra
    document["buffers"][0]["byteLength"] = len(blob)
    image = {"bufferView": view} if extra else image
    return join_glb(document | {"textures": [{"source": 0}], "images": [image]}, blob)
