"""Motion that comes in as GLB: every rig's animation is the one that was written, on our skeleton or as a reference."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import rotations
from runtime.assets import asset_path
from runtime.errors import FileError
from runtime.formats import gltf_keys, gltf_motion
from runtime.formats.glb import MANNEQUIN, save_glb
from runtime.formats.gltf_motion import contents, read_gltf_motion
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.reference import open_take
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from tests.fuzz.files import keys_glb
from tests.helpers.foreign_rigs import BONES as BONES_OF_FILE
from tests.helpers.foreign_rigs import RIGS, Z_UP, Document, mixamo_rig, rest_points
from tests.helpers.glb_playback import play
from tests.helpers.gltf_characters import _MIXAMO_PARENTS, join_glb, split_glb
from tests.helpers.walker import walk

BONES = [("LeftUpLeg", "LeftLeg"), ("RightLeg", "RightFoot"), ("LeftArm", "LeftForeArm"), ("Hips", "Head")]


@pytest.fixture(scope="module")
def clip() -> Clip:
    hips, local, contacts = walk(60)
    waves = np.sin(np.arange(60)[:, None, None] / 9 + np.arange(93).reshape(31, 3))
    turn = rotations.from_rotation_vector(0.2 * waves)
    return Clip("walk", 30.0, hips, rotations.multiply(local, turn).astype(np.float32), contacts)


def written(clip: Clip, path: Path, character: Path, **options: object) -> Path:
    chosen = ExportOptions(character=character, fps=30.0, **options)  # type: ignore[arg-type]
    save_glb(prepare(clip, chosen, None), path, chosen, None)
    return path


def directions(clip: Clip) -> np.ndarray:
    positions = clip.world()[0]
    ends = [[SPORT_SKELETON.index(name) for name in bone] for bone in BONES]
    return np.stack([rotations.normalize(positions[:, b] - positions[:, a]) for a, b in ends], 1)


def test_the_mannequin_is_our_skeleton(clip: Clip, tmp_path: Path) -> None:
    opened = open_take(written(clip, tmp_path / "a.glb", asset_path(MANNEQUIN)))
    assert opened.reference is None
    assert (len(opened.clip), opened.clip.fps) == (60, 30.0)
    assert np.abs(opened.clip.world()[0] - clip.world()[0]).max() < 1e-3


@pytest.mark.parametrize("rig", sorted(RIGS))
def test_other_rigs_are_references(clip: Clip, rig: str, tmp_path: Path) -> None:
    path = written(clip, tmp_path / "b.glb", RIGS[rig](tmp_path / "rig.glb"))
    assert contents(path) == (False, True)  # one of our own takes, whatever it moves
    assert contents(tmp_path / "rig.glb") == (True, False)
    opened = open_take(path)
    assert opened.reference is not None
    assert (len(opened.clip), round(opened.clip.fps, 3)) == (60, 30.0)
    apart = np.degrees(np.arccos(np.clip((directions(opened.clip) * directions(clip)).sum(-1), -1.0, 1.0)))
    assert np.median(apart) < 3.0
    assert apart.max() < 15.0


def test_cubic_and_stepped_keys_are_read_as_specified(tmp_path: Path) -> None:
    path = tmp_path / "keys.glb"
    path.write_bytes(keys_glb())
    motion = read_gltf_motion(path)
    assert motion.fps == pytest.approx(30.0)
    middle = motion.positions[15, 0, 0]
    # half of the way, and the tangent's part
    assert middle == pytest.approx(0.5 * 3.0 + 0.125 * 3.0 + 0.0, abs=1e-5)
    assert np.allclose(motion.local_rotations[29, 0], [1, 0, 0, 0])
    assert np.allclose(np.abs(motion.local_rotations[30, 0]), [0, 0, 1, 0])


def _change(document: dict, what: str, value: object) -> None:
    *way, last = what.split(".")
    for step in way:
        document = document[int(step) if step.isdigit() else step]
    document[int(last) if last.isdigit() else last] = value


@pytest.mark.parametrize(
    ("what", "value", "message"),
    [
        ("animations.0.samplers.0.output", 2, "damaged"),
        ("animations.0.samplers.0.interpolation", "LINEAR", "keys of an animation that do not fit"),
        ("animations.0.samplers", [], "damaged"),
        ("animations.0.channels", [{"sampler": 0, "target": {"node": 7, "path": "scale"}}], "moves no node"),
        ("animations", {"0": 1}, "its list of animations is damaged"),
        ("accessors.0.count", 10**9, "more keys than"),
        ("nodes", [{"children": [1]}, {"children": [0]}], "cycle"),
        ("animations", [{"name": f"take {k}"} for k in range(3000)], "moves no node"),
        ("times", [1.0, 0.0], "keys of an animation that do not fit"),
        ("times", [0.0, np.nan], "not finite"),
        ("times", [0.0, 9e8], "an animation of"),
        ("nodes", [{}, {"scale": [9e8, 9e8, 9e8], "children": [0]}], "moves joints further than"),
        ("skins", [{"joints": [0] * 60_000, "inverseBindMatrices": 0}], "bind matrices"),
    ],
)
def test_damage_is_one_sentence(what: str, value: object, message: str, tmp_path: Path) -> None:
    document, blob = split_glb(keys_glb())
    if what == "times":
        blob = np.array(value, "<f4").tobytes() + blob[8:]
    else:
        _change(document, what, value)
    path = tmp_path / "keys.glb"
    path.write_bytes(join_glb(document, blob))
    with pytest.raises(FileError, match=message):
        read_gltf_motion(path)


Keys = tuple[int, str, list, list, str]  # node, property, times, values, interpolation


def animated(path: Path, nodes: list[dict], *animations: tuple[str, list[Keys]], **more: object) -> Path:
    """A GLB of nodes with animations, each a name and its keys."""
    doc = Document()
    children = {child for node in nodes for child in node.get("children", [])}
    scene = {"nodes": [k for k in range(len(nodes)) if k not in children]}
    doc.value |= {"nodes": nodes, "scenes": [scene], "animations": [], **more}
    for name, keys in animations:
        samplers = [
            {"input": doc.array(np.float32(times)[:, None]), "output": doc.array(np.float32(values)), "interpolation": kind}
            for _, _, times, values, kind in keys
        ]  # fmt: skip
        channels = [{"sampler": k, "target": {"node": key[0], "path": key[1]}} for k, key in enumerate(keys)]
        doc.value["animations"].append({"name": name, "samplers": samplers, "channels": channels})
    return doc.write(path)


HIPS = [{"name": "Hips"}]


@pytest.mark.parametrize(
    ("rate", "every", "first", "wanted"),
    [
        (24.0, 1, 0, 24.0), (25.0, 1, 100, 25.0), (30.0, 1, 1, 30.0), (120.0, 1, 0, 120.0), (30.0, 10, 0, 30.0),
        (30 / 1.001, 1, 1, 30 / 1.001), (24 / 1.001, 1, 0, 24 / 1.001), (60 / 1.001, 1, 0, 60 / 1.001),
        (30 * 1.001, 1, 0, 30 / 1.001), (24 * 1.001, 1, 0, 24 / 1.001), (47.3, 1, 0, 47.3), (2.0, 1, 0, 30.0),
    ],
)  # fmt: skip
def test_the_rate_is_the_one_that_has_the_keys_on_its_frames(
    rate: float, every: int, first: int, wanted: float, tmp_path: Path
) -> None:
    times = (first + np.arange(0, 241, every)) / rate
    keys = [(0, "translation", times, np.arange(0, 241, every)[:, None] * [1.0, 0, 0], "LINEAR")]
    motion = read_gltf_motion(animated(tmp_path / "a.glb", HIPS, ("a", keys)))
    assert motion.fps == pytest.approx(wanted, abs=2e-4)
    assert len(motion.positions) == round(240 / rate * (rate if rate > 20 else wanted)) + 1
    assert motion.positions[-1, 0, 0] == pytest.approx(240.0, abs=1e-2)


@pytest.mark.parametrize("kind", ["LINEAR", "CUBICSPLINE"])
def test_the_sign_of_a_quaternion_turns_nothing(kind: str, tmp_path: Path) -> None:
    angles = np.linspace(0.0, 2.0, 5)
    turns = np.stack([np.sin(angles / 2), 0 * angles, 0 * angles, np.cos(angles / 2)], -1)
    found = []
    for name, signs in (("a", [1, 1, 1, 1, 1]), ("b", [1, -1, -1, 1, -1])):
        values = turns * np.array(signs)[:, None]
        if kind == "CUBICSPLINE":
            values = np.stack([0 * values, values, 0 * values], 1).reshape(-1, 4)
        keys = [(0, "rotation", np.arange(5) / 2, values, kind)]
        found.append(read_gltf_motion(animated(tmp_path / f"{name}.glb", HIPS, (name, keys))).local_rotations)
    assert rotations.angle_between(*found).max() < 1e-3


def body(frames: int = 31, fps: float = 30.0, moving: str = "Hips") -> tuple[list[dict], list[Keys]]:
    """Centimetre bones of a body without a mesh, under a node that scales and turns it, walking."""
    points, rng = rest_points(), np.random.default_rng(2)
    turn = rotations.from_axis_angle(np.array([1.0, 0, 0]), np.array(-np.pi / 2))
    top = {"name": "Armature", "scale": [0.01] * 3, "children": [1]}
    nodes: list[dict] = [top | {"rotation": turn[[1, 2, 3, 0]].tolist()}]
    keys: list[Keys] = []
    for name in BONES_OF_FILE:
        local = Z_UP @ (points[name] - points.get(_MIXAMO_PARENTS[name], 0.0))
        children = [1 + BONES_OF_FILE.index(c) for c in BONES_OF_FILE if _MIXAMO_PARENTS[c] == name]
        nodes.append({"name": f"mixamorig:{name}", "translation": local.tolist(), "children": children})
        seconds = np.arange(frames) / fps
        vectors = 0.3 * np.sin(4.0 * seconds[:, None] + rng.uniform(0, 6, 3))
        if name not in ("Hips", "Head", "LeftHand"):
            values = rotations.from_rotation_vector(vectors)[:, [1, 2, 3, 0]]
            keys.append((len(nodes) - 1, "rotation", seconds, values, "LINEAR"))
        if name == moving:
            way = local + 130.0 * seconds[:, None] * [0.0, 1, 0]
            keys.append((len(nodes) - 1, "translation", seconds, way, "LINEAR"))
    if moving == "Armature":
        keys.append((0, "translation", seconds, 1.3 * seconds[:, None] * [0.0, 0, 1], "LINEAR"))
    return nodes, keys


def camera(nodes: list[dict], times: list[float]) -> Keys:
    nodes.append({"name": "Camera", "camera": 0})
    values = np.array(times)[:, None] * [9.0, 0, 0]
    return len(nodes) - 1, "translation", times, values.tolist(), "LINEAR"


@pytest.mark.parametrize("moving", ["Hips", "Armature", "nothing"])
def test_a_body_without_a_mesh_is_where_another_reader_has_it(moving: str, tmp_path: Path) -> None:
    nodes, keys = body(moving=moving)
    path = animated(tmp_path / "a.glb", nodes, ("walk", keys))
    played, motion = play(path), read_gltf_motion(path)
    at = motion.world()[0]
    for name in ("Hips", "Head", "LeftHand", "RightToeBase"):
        wanted = played.worlds[:, played.node(f"mixamorig:{name}"), :3, 3]
        assert np.abs(at[:, motion.skeleton.index(f"mixamorig:{name}")] - wanted).max() < 1e-5
    assert open_take(path).reference.joints >= 22
    shot = camera(nodes, [0.0, 40.0])
    lens = [{"type": "perspective"}]
    beside = read_gltf_motion(animated(tmp_path / "b.glb", nodes, ("walk", [shot, *keys]), cameras=lens))
    assert np.array_equal(beside.positions, motion.positions), "a camera that moves longer is not of the body"
    assert "Camera" not in beside.skeleton.names


def test_the_first_animation_of_a_body_is_read_or_the_one_that_is_named(tmp_path: Path) -> None:
    nodes, keys = body()
    shot = camera(nodes, [0.0, 1.0])
    rest = [(node, path, [0.0], values[:1], kind) for node, path, _, values, kind in keys]
    found = [("Take 001", []), ("shot", [shot]), ("T-pose", rest), ("walk", keys), ("again", [*keys[:-1]])]
    path = animated(tmp_path / "a.glb", nodes, *found, cameras=[{"type": "perspective"}])
    motion = read_gltf_motion(path)
    assert len(motion.positions) == 31
    assert "walk is read" in motion.note
    assert len(read_gltf_motion(path, "T-pose").positions) == 1
    assert open_take(path, "walk").note == ""
    with pytest.raises(FileError, match=r"no animation 'run'.*walk") as raised:
        open_take(path, "run")
    assert "again" in raised.value.remedy


@pytest.mark.parametrize("moves", [True, False])
def test_of_many_animations_few_are_read(
    moves: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes, keys = body()
    if not moves:
        keys = [(node, path, at, [values[0]] * len(at), kind) for node, path, at, values, kind in keys]
    path = animated(tmp_path / "a.glb", nodes, *[(f"take {k}", keys) for k in range(61)])
    read, keys_of = Counter[str](), gltf_keys._keys
    monkeypatch.setattr(gltf_motion, "MAX_LOOKED_AT", 800)

    def counted(*call: Any) -> Any:
        read["channels"] += 1
        return keys_of(*call)

    monkeypatch.setattr(gltf_keys, "_keys", counted)
    motion = read_gltf_motion(path)
    assert motion.note.startswith("61 animations; take 0 is read, not take 1, take 2,")
    assert len(motion.animations) == 61
    assert read["channels"] <= (len(keys) if moves else 800 // gltf_motion.CHANNEL_COST)


def test_joints_that_no_skin_names_are_joints(clip: Clip, tmp_path: Path) -> None:
    path = written(clip, tmp_path / "a.glb", mixamo_rig(tmp_path / "rig.glb"))
    whole = read_gltf_motion(path)
    document, blob = split_glb(path.read_bytes())
    skin = document["skins"][0]
    inverse = document["accessors"][skin.pop("inverseBindMatrices")]
    names = [document["nodes"][node]["name"] for node in skin["joints"]]
    left = [k for k, name in enumerate(names) if not name.endswith(("Hips", "LeftHand"))]
    at = document["bufferViews"][inverse["bufferView"]]["byteOffset"]
    matrices = np.frombuffer(blob, "<f4", 16 * len(skin["joints"]), at).reshape(-1, 16)[left]
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": matrices.nbytes})
    document["accessors"].append({"bufferView": len(document["bufferViews"]) - 1, "componentType": 5126, "type": "MAT4",
                                  "count": len(left)})  # fmt: skip
    skin["joints"] = [skin["joints"][k] for k in left]
    skin["inverseBindMatrices"] = len(document["accessors"]) - 1
    blob += matrices.tobytes()
    document["buffers"][0]["byteLength"] = len(blob)
    path.write_bytes(join_glb(document, blob))
    motion = read_gltf_motion(path)
    assert set(motion.skeleton.names) == set(whole.skeleton.names)
    order = [motion.skeleton.index(name) for name in whole.skeleton.names]
    assert np.abs(motion.world()[0][:, order] - whole.world()[0]).max() < 1e-5
    assert np.abs(motion.skeleton.offsets[order] - whole.skeleton.offsets).max() < 1e-5


def test_what_moves_no_body_is_no_take(tmp_path: Path) -> None:
    weights = [(0, "weights", [0.0, 1.0], [[0.0], [1.0]], "LINEAR")]
    one = [(0, "translation", [0.0], [[0.0, 1.0, 0.0]], "LINEAR")]
    shapes = animated(tmp_path / "a.glb", HIPS, ("smile", weights))
    pose = animated(tmp_path / "b.glb", HIPS, ("pose", one))
    assert contents(shapes) == contents(pose) == (False, False)
    with pytest.raises(FileError, match="moves no node"):
        read_gltf_motion(shapes)
    assert len(read_gltf_motion(pose).positions) == 1


FBX = Path(__file__).with_name("euler_curves.fbx").read_text()


def test_an_fbx_of_euler_curves_turns_as_they_say(tmp_path: Path) -> None:
    """A second of a whole turn about X, behind a take that is empty, that says no end; a bone of 20 cm that stands up at rest."""
    pytest.importorskip("ufbx", reason="needs the extra [characters]")
    path = tmp_path / "a.fbx"
    path.write_text(FBX)
    motion = read_gltf_motion(path)
    assert (len(motion.positions), motion.fps) == (31, pytest.approx(30.0))
    angle = 2 * np.pi * np.arange(31) / 30
    spine = motion.world()[0][:, motion.skeleton.index("Spine")]
    wanted = np.stack([0 * angle, 1.0 + 0.2 * np.cos(angle), 0.2 * np.sin(angle)], -1)
    assert np.abs(spine - wanted).max() < 1e-5
    assert "mixamo.com is read" in motion.note


def test_an_fbx_joint_whose_rotation_is_not_active_has_no_turn_before_it(tmp_path: Path) -> None:
    pytest.importorskip("ufbx", reason="needs the extra [characters]")
    path, turned = tmp_path / "a.fbx", 'P: "PreRotation", "Vector3D", "Vector", "",-90,0,0'
    path.write_text(FBX.replace('"RotationActive", "bool", "", "",1', '"RotationActive", "bool", "", "",0'))
    inactive = read_gltf_motion(path)
    path.write_text(FBX.replace(turned, 'P: "PreRotation", "Vector3D", "Vector", "",0,0,0'))
    assert np.abs(inactive.world()[0] - read_gltf_motion(path).world()[0]).max() < 1e-5


def test_a_file_without_animation_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no animation"):
        read_gltf_motion(asset_path(MANNEQUIN))
    document, _ = split_glb(asset_path(MANNEQUIN).read_bytes())
    assert not document.get("animations")
