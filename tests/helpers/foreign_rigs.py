"""Skinned third-party-style characters: textured boxes on skeletons like those of Mixamo, VRM and a centimetre rig."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from runtime import rotations
from tests.helpers.gltf_characters import _CENTRE, _LEFT, _MIXAMO_PARENTS, join_glb, split_glb

BONES = [name for name in _MIXAMO_PARENTS if name not in ("Armature", "HeadTop_End")]
VRM_NAMES = {"Hips": "hips", "Spine": "spine", "Spine1": "chest", "Spine2": "upperChest", "Neck": "neck", "Head": "head",
             **{s + b: s.lower() + v for s in ("Left", "Right") for b, v in (
                 ("Shoulder", "Shoulder"), ("Arm", "UpperArm"), ("ForeArm", "LowerArm"), ("Hand", "Hand"),
                 ("HandMiddle1", "MiddleProximal"), ("UpLeg", "UpperLeg"), ("Leg", "LowerLeg"), ("Foot", "Foot"),
                 ("ToeBase", "Toes"))}}  # fmt: skip
UNREAL_NAMES = {"Hips": "pelvis", "Spine": "spine_01", "Spine1": "spine_02", "Spine2": "spine_03", "Neck": "neck_01",
                "Head": "head",
                **{s + b: f"{v}_{s[0].lower()}" for s in ("Left", "Right") for b, v in (
                    ("Shoulder", "clavicle"), ("Arm", "upperarm"), ("ForeArm", "lowerarm"), ("Hand", "hand"),
                    ("HandMiddle1", "middle_01"), ("UpLeg", "thigh"), ("Leg", "calf"), ("Foot", "foot"),
                    ("ToeBase", "ball"))}}  # fmt: skip
Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # from Y up to Z up


def rest_points() -> dict[str, np.ndarray]:
    """Return the joints of an A-pose in centimetres, Y up, facing +Z."""
    points = {name: np.array(at, float) for name, at in _CENTRE.items()}
    for bone, at in _LEFT.items():
        points["Left" + bone] = np.array(at, float)
        points["Right" + bone] = np.array(at, float) * (-1, 1, 1)
    return {name: points[name] for name in BONES}


class Document:
    """A glTF document under construction."""

    def __init__(self) -> None:
        self.blob = b""
        self.value: dict[str, Any] = {
            "asset": {"version": "2.0", "copyright": "made by a test"}, "bufferViews": [], "accessors": [], "nodes": [],
            "meshes": [], "skins": [], "materials": [], "images": [], "textures": [], "scene": 0,
        }  # fmt: skip

    def view(self, data: bytes) -> int:
        self.blob += b"\0" * (-len(self.blob) % 4)
        self.value["bufferViews"].append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)})
        self.blob += data
        return len(self.value["bufferViews"]) - 1

    def array(self, values: np.ndarray, bounds: bool = False) -> int:
        kinds = {"float32": 5126, "uint16": 5123}
        accessor: dict[str, Any] = {
            "bufferView": self.view(np.ascontiguousarray(values).tobytes()),
            "componentType": kinds[values.dtype.name], "count": len(values),
            "type": {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[values.shape[1]],
        }  # fmt: skip
        if bounds:
            accessor |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        self.value["accessors"].append(accessor)
        return len(self.value["accessors"]) - 1

    def material(self, name: str, seed: int) -> int:
        pixels = np.random.default_rng(seed).integers(60, 255, (8, 8, 3)).astype(np.uint8)
        data = io.BytesIO()
        Image.fromarray(pixels).save(data, "PNG")
        image = {"bufferView": self.view(data.getvalue()), "mimeType": "image/png", "name": name}
        self.value["images"].append(image)
        self.value["textures"].append({"source": len(self.value["images"]) - 1})
        surface = {"baseColorTexture": {"index": len(self.value["textures"]) - 1}, "metallicFactor": 0.0}
        self.value["materials"].append({"name": name, "pbrMetallicRoughness": surface, "doubleSided": True})
        return len(self.value["materials"]) - 1

    def write(self, path: Path) -> Path:
        self.blob += b"\0" * (-len(self.blob) % 4)
        self.value["buffers"] = [{"byteLength": len(self.blob)}]
        path.write_bytes(join_glb(self.value, self.blob))
        return path


def _boxes(
    points: dict[str, np.ndarray], bones: list[str], order: list[str], size: float
) -> tuple[np.ndarray, ...]:
    """Return a box around each joint: positions, texture coordinates, joints, weights, triangles."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
             (1, 5, 7), (1, 7, 3)]  # fmt: skip
    at = np.concatenate([points[b] + size * corners * (1, 1, 1) for b in bones]).astype(np.float32)
    uv = np.tile(np.array([(0.1, 0.1), (0.9, 0.1), (0.1, 0.9), (0.9, 0.9)] * 2, np.float32), (len(bones), 1))
    joints = np.zeros((len(at), 4), np.uint16)
    joints[:, 0] = np.repeat([order.index(b) for b in bones], 8)
    weights = np.tile(np.float32([1, 0, 0, 0]), (len(at), 1))
    triangles = np.array(faces).ravel() + 8 * np.arange(len(bones))[:, None]
    triangles = triangles.astype(np.uint16).reshape(-1, 1)
    return at, uv, joints, weights, triangles


def _skin_mesh(doc: Document, name: str, points: dict[str, np.ndarray], bones: list[str], order: list[str],
               nodes: list[int], worlds: np.ndarray, mesh_to_world: np.ndarray, size: float, seed: int) -> int:  # fmt: skip
    """Add a mesh with its own skin over all joints; returns its node."""
    at, uv, joints, weights, triangles = _boxes(points, bones, order, size)
    primitive = {
        "attributes": {"POSITION": doc.array(at, True), "TEXCOORD_0": doc.array(uv), "JOINTS_0": doc.array(joints),
                       "WEIGHTS_0": doc.array(weights)},
        "indices": doc.array(triangles), "material": doc.material(f"{name} cloth", seed),
    }  # fmt: skip
    inverse = (np.linalg.inv(worlds) @ mesh_to_world).transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
    inverse[:, [3, 7, 11]], inverse[:, 15] = 0.0, 1.0
    doc.value["skins"].append({"joints": nodes, "inverseBindMatrices": doc.array(inverse)})
    doc.value["meshes"].append({"name": name, "primitives": [primitive]})
    mesh, skin = (len(doc.value[kind]) - 1 for kind in ("meshes", "skins"))
    doc.value["nodes"].append({"name": name, "mesh": mesh, "skin": skin})
    return len(doc.value["nodes"]) - 1


def _joints(
    doc: Document, names: dict[str, str], worlds: dict[str, np.ndarray], above: np.ndarray
) -> list[int]:
    """Add nodes of the bones below a space `above`; returns them in the order of `BONES`."""
    first = len(doc.value["nodes"])
    for name in BONES:
        local = np.linalg.inv(worlds.get(_MIXAMO_PARENTS[name], above)) @ worlds[name]
        turn = rotations.from_matrix(local[:3, :3] / np.linalg.norm(local[:3, :3], axis=0))
        children = [first + BONES.index(c) for c in BONES if _MIXAMO_PARENTS[c] == name]
        node: dict[str, Any] = {"name": names[name], "translation": local[:3, 3].tolist(),
                                "rotation": turn[[1, 2, 3, 0]].tolist()}  # fmt: skip
        doc.value["nodes"].append(node | ({"children": children} if children else {}))
    return list(range(first, first + len(BONES)))


def _worlds(points: dict[str, np.ndarray], to_world: np.ndarray, seed: int) -> dict[str, np.ndarray]:
    """Return world matrices of bones with arbitrary axes, in a space `to_world` (which may scale)."""
    rng = np.random.default_rng(seed)
    result = {}
    for name, point in points.items():
        local = np.eye(4)
        local[:3, :3] = rotations.to_matrix(rotations.normalize(rng.normal(size=4)))
        local[:3, 3] = point
        result[name] = to_world @ local
    return result


def mixamo_rig(path: Path) -> Path:
    """Write centimetre bones below a node that scales to metres and rotates from Z up, as FBX converters do."""
    doc = Document()
    above = np.eye(4)
    above[:3, :3] = 0.01 * Z_UP.T
    worlds = _worlds({name: Z_UP @ point for name, point in rest_points().items()}, above, 1)
    nodes = _joints(doc, {b: "mixamorig:" + b for b in BONES}, worlds, above)
    mesh_space = np.diag([0.01, 0.01, 0.01, 1.0])
    mesh = _skin_mesh(doc, "Body", rest_points(), BONES, BONES, nodes, np.stack(list(worlds.values())), mesh_space, 3.0, 1)  # fmt: skip
    turn = rotations.from_matrix(Z_UP.T)[[1, 2, 3, 0]].tolist()
    top = {"name": "Armature", "rotation": turn, "scale": [0.01] * 3, "children": [nodes[0], mesh]}
    doc.value["nodes"].append(top)
    doc.value["scenes"] = [{"nodes": [len(doc.value["nodes"]) - 1]}]
    return doc.write(path)


def vrm_rig(path: Path) -> Path:
    """Write a rig in metres, facing -Z, with joints named only by the VRM 0 humanoid, and two skinned meshes."""
    doc = Document()
    back = np.diag([-0.012, 0.012, -0.012])  # a tall character
    points = {name: back @ point for name, point in rest_points().items()}
    worlds = _worlds(points, np.eye(4), 2)
    nodes = _joints(doc, {b: f"J{i:03d}" for i, b in enumerate(BONES)}, worlds, np.eye(4))
    stacked = np.stack(list(worlds.values()))
    arms = [b for b in BONES if "Arm" in b or "Hand" in b]
    rest = [b for b in BONES if b not in arms]
    meshes = [_skin_mesh(doc, name, points, bones, BONES, nodes, stacked, np.eye(4), 0.035, seed)
              for name, bones, seed in (("Body", rest, 2), ("Sleeves", arms, 3))]  # fmt: skip
    bones = [{"bone": VRM_NAMES[b], "node": n} for b, n in zip(BONES, nodes, strict=True)]
    doc.value |= {"extensionsUsed": ["VRM"], "extensions": {"VRM": {"humanoid": {"humanBones": bones}}},
                  "scenes": [{"nodes": [nodes[0], *meshes]}]}  # fmt: skip
    return doc.write(path)


def centimetre_rig(path: Path) -> Path:
    """Write a rig with Unreal names, centimetres, Z up, and a rotated root joint above the pelvis."""
    doc = Document()
    points = {name: Z_UP @ point for name, point in rest_points().items()}
    worlds = _worlds(points, np.eye(4), 4)
    root = np.eye(4)
    root[:3, :3] = rotations.to_matrix(rotations.from_axis_angle(np.array([0.0, 0, 1]), np.array(0.7)))
    nodes = _joints(doc, UNREAL_NAMES, worlds, root)
    turn = rotations.from_matrix(root[:3, :3])[[1, 2, 3, 0]].tolist()
    doc.value["nodes"].append({"name": "root", "rotation": turn, "children": [nodes[0]]})
    joints = [len(doc.value["nodes"]) - 1, *nodes]
    mesh = _skin_mesh(doc, "Body", points, BONES, ["root", *BONES], joints,
                      np.stack([root, *worlds.values()]), np.eye(4), 3.0, 5)  # fmt: skip
    doc.value["scenes"] = [{"nodes": [joints[0], mesh]}]
    return doc.write(path)


def sparse_rig(path: Path) -> Path:
    """Write a character with a sparse shape key, as by Blender, without own bytes, and an old animation."""
    document, blob = split_glb(mixamo_rig(path).read_bytes())
    primitive = document["meshes"][0]["primitives"][0]
    count = document["accessors"][primitive["attributes"]["POSITION"]]["count"]

    def view(data: bytes) -> int:
        nonlocal blob
        blob += b"\0" * (-len(blob) % 4)
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        blob += data
        return len(document["bufferViews"]) - 1

    indices = view(np.uint16([0, 3]).tobytes())
    values = view(np.float32([[0, 0, 0.1], [0, 0, 0.2]]).tobytes())
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


RIGS = {"mixamo": mixamo_rig, "vrm": vrm_rig, "centimetres": centimetre_rig}
