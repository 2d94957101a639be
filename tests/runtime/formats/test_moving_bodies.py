"""Motion of files with several skins, several characters, spaces that scale or mirror, tangents of both signs, and any rate."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import rotations
from runtime.character.bodies import find_bodies, open_character
from runtime.character.character import load_character
from runtime.character.nodes import Nodes
from runtime.character.read import open_gltf
from runtime.errors import FileError
from runtime.formats.gltf_motion import read_gltf_motion
from runtime.formats.reference import open_take
from runtime.pose import video_rate
from runtime.skeleton import SPORT_SKELETON
from tests.helpers.foreign_rigs import BONES, Document, mixamo_rig, rest_points
from tests.helpers.gltf_characters import _MIXAMO_PARENTS, join_glb, split_glb
from tests.runtime.formats.test_gltf_motion import animated

FPS, FRAMES = 30.0, 31
BENDS = ("LeftUpLeg LeftLeg", "RightLeg RightFoot", "LeftArm LeftForeArm", "RightForeArm RightHand")
HALVES = ([b for b in BONES if "Leg" in b or "Foot" in b or "Toe" in b or b == "Hips"], None)
Parts = list[list[str]]
ONE: Parts = [list(BONES)]
TWO: Parts = [HALVES[0], [b for b in BONES if b not in HALVES[0]]]
SEVEN: Parts = [["Hips"], ["Spine", "Spine1", "Spine2"], ["Neck", "Head"], *(
    [b for b in BONES if b.startswith(side) and any(part in b for part in limb)]
    for side in ("Left", "Right") for limb in (("Arm", "Shoulder", "Hand"), ("Leg", "Foot", "Toe"))
)]  # fmt: skip


class Scene:
    """A file under construction: bodies of Mixamo bones, each with skins, under an armature."""

    def __init__(self) -> None:
        self.doc = Document()
        self.nodes: list[dict] = self.doc.value["nodes"]
        self.animations: list[dict] = []

    def body(
        self, parts: Parts, space: np.ndarray, prefix: str = "mixamorig:", more: int = 0
    ) -> dict[str, int]:
        """Nodes of the bones by name, under a node with the matrix `space`; `more` joints hang on the head."""
        points, top = rest_points(), len(self.nodes)
        number = {name: top + 1 + k for k, name in enumerate(BONES)}
        hair = [top + 1 + len(BONES) + k for k in range(more)]
        matrix = space.T.ravel().tolist()
        self.nodes.append({"name": f"{prefix}Armature", "matrix": matrix, "children": [number["Hips"]]})
        for name in BONES:
            local = 0.01 * (points[name] - points.get(_MIXAMO_PARENTS[name], 0.0))
            children = [number[c] for c in BONES if _MIXAMO_PARENTS[c] == name]
            children += hair if name == "Head" else []
            self.nodes.append({"name": prefix + name, "translation": local.tolist(), "children": children})
        self.nodes += [{"name": f"{prefix}hair {k}", "translation": [0, 0.1, 0]} for k in range(more)]
        for part in [*parts, *([None] if more else [])]:
            joints = hair if part is None else [number[name] for name in part]
            at = [points["Head"] + [0, 10, 0]] * more if part is None else [points[name] for name in part]
            binds = np.tile(np.eye(4), (len(joints), 1, 1))
            binds[:, :3, 3] = 0.01 * np.array(at)
            inverse = np.linalg.inv(space @ binds).transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
            inverse[:, [3, 7, 11]], inverse[:, 15] = 0.0, 1.0
            self.doc.value["skins"].append({"joints": joints, "inverseBindMatrices": self.doc.array(inverse)})
        return number

    def prop(self, name: str) -> dict[str, int]:
        """A node of its own, as cameras and swords on the ground are."""
        self.nodes.append({"name": name, "translation": [4.0, 0.0, 0.0]})
        return {"Hips": len(self.nodes) - 1}

    def walk(self, name: str, *bodies: dict[str, int], fps: float = FPS, frames: int = FRAMES) -> None:
        seconds = np.arange(frames) / fps
        times, samplers, channels = self.doc.array(np.float32(seconds)[:, None]), list[dict](), list[dict]()

        def track(node: int, path: str, values: np.ndarray) -> None:
            samplers.append({"input": times, "output": self.doc.array(np.float32(values))})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})

        for number in bodies:
            rng = np.random.default_rng(4)
            for bone in number:
                turn = 0.3 * np.sin(4.0 * seconds[:, None] + rng.uniform(0, 6, 3))
                turn = turn * (bone not in ("Hips", "Spine", "Head"))
                track(number[bone], "rotation", rotations.from_rotation_vector(turn)[:, [1, 2, 3, 0]])
            way = np.array([0.0, 1.05, 0.0]) + seconds[:, None] * [0.0, 0.0, 1.2]
            track(number["Hips"], "translation", way)
        self.animations.append({"name": name, "samplers": samplers, "channels": channels})

    def write(self, path: Path) -> Path:
        held = {child for node in self.nodes for child in node.get("children", [])}
        self.doc.value["scenes"] = [{"nodes": [k for k in range(len(self.nodes)) if k not in held]}]
        self.doc.value["animations"] = self.animations
        return self.doc.write(path)


def space(scale: tuple[float, ...] = (1, 1, 1), turn: tuple[float, ...] = (0, 0, 0)) -> np.ndarray:
    matrix, turned = np.eye(4), rotations.from_rotation_vector(np.array(turn, float))
    matrix[:3, :3] = rotations.to_matrix(turned) @ np.diag(scale)
    return matrix


SPACES = {
    "plain": space(), "turned": space(turn=(0, 0.7, 0)), "scaled": space((1.3, 1.3, 1.3)),
    "small": space((0.01, 0.01, 0.01)), "mirrored": space((-1, 1, 1)),
}  # fmt: skip


def limbs(path: Path, animation: str = "", exchanged: bool = False, scale: float = 1.0) -> Any:
    """What was read: limbs within a degree of those of the file, and the way within a hundredth of its, times `scale`."""
    opened, motion = open_take(path, animation), read_gltf_motion(path, animation)
    ours, at, worst = opened.clip.world()[0].astype(float), motion.world()[0].astype(float), 0.0

    def their(name: str) -> np.ndarray:
        if exchanged:
            name = name.replace("Left", "#").replace("Right", "Left").replace("#", "Right")
        return at[:, [n.endswith(f":{name}") for n in motion.skeleton.names].index(True)]

    for above, below in map(str.split, BENDS):
        u = rotations.normalize(ours[:, SPORT_SKELETON.index(below)] - ours[:, SPORT_SKELETON.index(above)])
        v = rotations.normalize(their(below) - their(above))
        worst = max(worst, float(np.degrees(np.arccos(np.clip((u * v).sum(-1), -1, 1))).max()))
    way = 1.2 * (len(ours) - 1) / opened.clip.fps * opened.reference.scale  # type: ignore[union-attr]
    assert worst < 1.0
    assert np.linalg.norm(ours[-1, 0] - ours[0, 0]) / way / scale == pytest.approx(1.0, abs=0.01)
    return opened


@pytest.mark.parametrize("parts", [ONE, TWO, SEVEN], ids=["one skin", "two", "seven"])
@pytest.mark.parametrize("kind", SPACES)
def test_a_walk_is_read_whatever_skins_and_spaces_there_are(parts: Parts, kind: str, tmp_path: Path) -> None:
    scene = Scene()
    scene.walk("walk", scene.body(parts, SPACES[kind]))
    scale = np.cbrt(abs(np.linalg.det(SPACES[kind][:3, :3])))
    opened = limbs(scene.write(tmp_path / "a.glb"), exchanged=kind == "mirrored", scale=scale)
    assert "Mixamo" in opened.reference.origin
    assert (len(opened.clip), opened.clip.fps) == (FRAMES, FPS)


def test_a_skin_of_more_joints_on_the_head_is_no_body(tmp_path: Path) -> None:
    scene = Scene()
    scene.walk("walk", scene.body(ONE, space(), more=48))
    assert limbs(scene.write(tmp_path / "a.glb")).note == ""


def two_bodies(path: Path, *walks: tuple[str, tuple[int, ...]], more: int = 10) -> Path:
    """Two characters, the second one of more joints, with animations of some of both."""
    scene, there = Scene(), space()
    there[:3, 3] = 3.0, 0.0, 0.0
    bodies = scene.body(ONE, space()), scene.body(ONE, there, "npc_", more=more)
    for name, moved in walks:
        scene.walk(name, *(bodies[k] for k in moved))
    return scene.write(path)


@pytest.mark.parametrize("more", [10, 80])
@pytest.mark.parametrize(
    ("walks", "wanted", "names", "read"),
    [
        ([("walk", (0,))], "", ("walk",), "mixamorig:Armature"),
        ([("walk", (0,)), ("idle", (1,))], "", ("walk", "idle"), "mixamorig:Armature"),
        ([("walk", (0,)), ("idle", (1,))], "walk", ("walk", "idle"), "mixamorig:Armature"),
        ([("walk", (0,)), ("idle", (1,))], "idle", ("walk", "idle"), "npc_Armature"),
        ([("both", (0, 1))], "", ("both", "both / npc_Armature"), "mixamorig:Armature"),
        ([("both", (0, 1))], "both / npc_Armature", ("both", "both / npc_Armature"), "npc_Armature"),
    ],
)
def test_an_animation_belongs_to_the_body_that_it_moves(
    walks: list, wanted: str, names: tuple[str, ...], read: str, more: int, tmp_path: Path
) -> None:
    motion = read_gltf_motion(two_bodies(tmp_path / "a.glb", *walks, more=more), wanted)
    assert motion.animations == names
    other = {"npc_Armature", "mixamorig:Armature"} - {read}
    assert f"2 bodies; {read} is read, not {other.pop()}." in motion.note
    assert motion.skeleton.names[0].startswith(read.split("Arm")[0])
    assert open_take(tmp_path / "a.glb", wanted).reference is not None


@pytest.mark.parametrize("top", ["", "root"], ids=["loose", "below one node, as an FBX has"])
def test_props_that_move_are_no_body(top: str, tmp_path: Path) -> None:
    scene = Scene()
    props = [scene.prop(f"prop {k}") for k in range(3)]
    scene.walk("fall", *props)
    scene.walk("walk", scene.body(ONE, space()), *props)
    if top:
        held = {child for node in scene.nodes for child in node.get("children", [])}
        scene.nodes.append({"name": top, "children": [k for k in range(len(scene.nodes)) if k not in held]})
    opened = limbs(scene.write(tmp_path / "a.glb"))
    assert opened.note == "2 animations; walk is read, not fall."
    assert opened.animations == ("fall", "walk")


def test_of_two_persons_in_a_character_file_one_is_taken(tmp_path: Path) -> None:
    path, plain = tmp_path / "two.glb", mixamo_rig(tmp_path / "one.glb")
    document, blob = split_glb(plain.read_bytes())
    count, skins = len(document["nodes"]), len(document["skins"])
    for node in list(document["nodes"]):
        twin = node | {"children": [child + count for child in node.get("children", [])]}
        if "skin" in node:
            twin["skin"] = node["skin"] + skins
        document["nodes"].append({key: value for key, value in twin.items() if value != []})
    document["skins"] += [s | {"joints": [j + count for j in s["joints"]]} for s in document["skins"]]
    for scene in document["scenes"]:
        scene["nodes"] = [*scene["nodes"], *(node + count for node in scene["nodes"])]
    path.write_bytes(join_glb(document, blob))
    both, one = load_character(path), load_character(plain)
    assert "2 bodies; " in both.note
    assert len(both.positions) == len(one.positions)
    assert np.array_equal(both.joint_names, one.joint_names)
    file, _ = open_character(path)
    assert len(find_bodies(Nodes(file))) == 2, "its nodes stay"
    assert len(file.gltf.skins) == skins
    assert open_character(plain)[1] == ""


def test_a_skin_whose_bones_are_not_those_of_the_nodes_is_refused_with_both(tmp_path: Path) -> None:
    scene = Scene()
    number = scene.body(ONE, space())
    scene.walk("walk", number)
    for node in number.values():  # moves all, each by another length
        scene.nodes[node]["translation"] = [4.0 * v for v in scene.nodes[node]["translation"]]
        scene.nodes[node]["rotation"] = [0.0, 0.6, 0.0, 0.8]
    with pytest.raises(FileError, match=r"its skin binds .* from .*, but the node is .* away"):
        read_gltf_motion(scene.write(tmp_path / "a.glb"))


@pytest.mark.parametrize("rate", [5, 8, 12, 15, 16, 20, 24, 30, 40, 60, 80, 144])
def test_the_rate_of_a_file_with_a_key_in_every_frame_is_kept(rate: int, tmp_path: Path) -> None:
    scene = Scene()
    scene.walk("walk", scene.body(ONE, space()), fps=rate, frames=2 * rate + 1)
    clip = open_take(scene.write(tmp_path / "a.glb")).clip
    assert (len(clip), clip.fps) == (2 * rate + 1, rate)


@pytest.mark.parametrize(
    ("fps", "wanted"),
    [(144.001, 144.0), (29.97, 30000 / 1001), (12.5, 12.5), (47.3, 47.3), (1 / 0.0083333, 120.0)],
)
def test_a_rounded_rate_is_the_whole_one(fps: float, wanted: float) -> None:
    assert video_rate(fps) == pytest.approx(wanted, abs=1e-9)


def test_tangents_through_the_sphere_are_those_of_the_other_sign(tmp_path: Path) -> None:
    """Keys a fifth of a second apart turn evenly about X through half a turn; one was written with the other sign of its handle."""
    angles, speed = np.pi + 0.4 * np.arange(-2, 3), 2.0

    def quaternion(angle: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(angle / 2), 0 * angle, 0 * angle, np.cos(angle / 2)], -1)

    values = quaternion(angles)
    tangents = speed / 2 * np.stack([np.cos(angles / 2), 0 * angles, 0 * angles, -np.sin(angles / 2)], -1)
    signs = np.array([1, 1, 1, -1, -1])[:, None]
    values, tangents = values * signs, tangents * signs
    frame = quaternion(angles[2] - np.array(speed / 30))
    tangents[2] = 30.0 * (values[2] + frame)  # to a handle a frame earlier, of the other sign
    keys = np.stack([tangents, values, tangents], 1).reshape(-1, 4)
    track = (0, "rotation", np.arange(5) / 5, keys, "CUBICSPLINE")
    path = animated(tmp_path / "a.glb", [{"name": "Hips"}], ("a", [track]))
    motion = read_gltf_motion(path)
    wanted = quaternion(angles[0] + speed * np.arange(len(motion.positions)) / motion.fps)[:, [3, 0, 1, 2]]
    assert rotations.angle_between(motion.local_rotations[:, 0].astype(float), wanted).max() < 0.02
    assert open_gltf(path).gltf.animations
