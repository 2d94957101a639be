"""Own exports of characters of all builds, opened again in every format that is read: what comes back is what went out."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.assets import asset_path
from runtime.character.character import Character, load_character
from runtime.character.mesh import vrm_bones
from runtime.character.read import open_gltf
from runtime.character.shape import BodyShape, shaped_file
from runtime.formats.glb import body_size
from runtime.formats.gltf_motion import read_gltf_motion
from runtime.formats.options import ExportOptions
from runtime.formats.prepare import PreparedTake, prepare
from runtime.formats.reference import open_take
from runtime.formats.table import save_motion
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.gltf_characters import join_glb, split_glb
from tests.helpers.walker import walk

CHARACTERS = Path(__file__).parents[1] / "character" / "characters"
FPS, FRAMES, MILLIMETRE_M = 30.0, 24, 1e-3
PROMPTS = (PromptEvent(0.0, "proud"), PromptEvent(0.3, "drunk", 0.1))
GAITS = np.repeat([1, 2], FRAMES // 2).astype(np.int8)
CLIP = Clip("a walk", FPS, *walk(FRAMES), prompts=PROMPTS, gaits=GAITS)
SHAPES = {
    "tall": BodyShape(height=1.4),
    "small": BodyShape(height=0.6, legs=0.9),
    "broad": BodyShape(shoulders=1.3, arms=1.1),
    "long legs": BodyShape(legs=1.25, head=1.2),
}


def two_skins(path: Path) -> Path:
    """A character whose mesh is there twice, each with a skin of its own."""
    document, blob = split_glb(RIGS["mixamo"](path).read_bytes())
    document["skins"].append(dict(document["skins"][0]))
    mesh = next(node for node in document["nodes"] if "skin" in node)
    document["nodes"].append(mesh | {"name": "trousers", "skin": len(document["skins"]) - 1})
    document["scenes"][0]["nodes"].append(len(document["nodes"]) - 1)
    path.write_bytes(join_glb(document, blob))
    return path


BUILDS: dict[str, Callable[[Path], Path | None]] = {
    "mannequin": lambda folder: None,
    **{name: (lambda folder, shape=shape: shaped_file(shape, folder)) for name, shape in SHAPES.items()},
    **{name: (lambda folder, rig=rig: rig(folder / "rig.glb")) for name, rig in RIGS.items()},
    "box man": lambda folder: CHARACTERS / "box_man.glb",
    "box man of FBX": lambda folder: CHARACTERS / "box_man.fbx",
    "box man of meshopt": lambda folder: CHARACTERS / "box_man_meshopt.glb",
    "two skins": lambda folder: two_skins(folder / "rig.glb"),
}


def exported(
    build: str, suffix: str, folder: Path, **options: object
) -> tuple[Path, PreparedTake, Character]:
    """A file of the clip with a character, the take as it was written, and the character."""
    source, path = BUILDS[build](folder), folder / f"take{suffix}"
    chosen = replace(ExportOptions(fps=FPS, character=source), **options)
    skinned = suffix in (".glb", ".fbx")
    save_motion(CLIP, path, chosen if skinned else replace(chosen, character=None))
    return path, prepare(CLIP, chosen), load_character(source or asset_path("character/mannequin.glb"))


@pytest.mark.parametrize("suffix", [".glb", ".fbx"])
@pytest.mark.parametrize("build", BUILDS)
def test_the_joints_of_a_character_come_back(build: str, suffix: str, tmp_path: Path) -> None:
    path, take, character = exported(build, suffix, tmp_path)
    motion, size = read_gltf_motion(path), body_size(take.clip, ExportOptions(character=path), character)
    pose = character.adapted(*(a.astype(float) for a in take.clip.world()), take.clip.contacts.astype(float))
    wanted, _ = character.joint_transforms(*pose)
    file = open_gltf(path)  # a VRM's joints are read by the names of its bones
    bones = {file.gltf.nodes[n].name: bone[0].upper() + bone[1:] for n, bone in vrm_bones(file).items()}
    driven = np.flatnonzero(character.sport_joints >= 0)
    names = [character.joint_names[k] for k in driven]
    read = [motion.skeleton.names.index(bones.get(name, name)) for name in names]
    assert np.abs(motion.world()[0][:, read] - size * wanted[:, driven]).max() < 0.1 * MILLIMETRE_M


@pytest.mark.parametrize("root", [False, True], ids=["", "root on the ground"])
@pytest.mark.parametrize("suffix", [".bvh", ".glb", ".fbx", ".vrma"])
@pytest.mark.parametrize("build", ["mannequin", "tall", "vrm"])
def test_what_a_take_tells_comes_back(build: str, suffix: str, root: bool, tmp_path: Path) -> None:
    path, take, _ = exported(build, suffix, tmp_path, ground_root=root and suffix != ".vrma")
    back = open_take(path).clip
    assert (len(back), back.fps) == (FRAMES, FPS)
    found, wanted = (
        [(p.seconds, p.prompt, p.transition_seconds) for p in all] for all in (back.prompts, PROMPTS)
    )
    assert found == wanted
    assert np.array_equal(back.gaits, take.clip.gaits)
    np.testing.assert_allclose(back.contacts, take.clip.contacts, atol=1e-3)
    again = prepare(back, ExportOptions(fps=FPS))
    if suffix == ".bvh":
        np.testing.assert_allclose(back.world()[0], take.clip.world()[0], atol=0.1 * MILLIMETRE_M)
        np.testing.assert_allclose(again.root.positions, take.root.positions, atol=0.1 * MILLIMETRE_M)


def test_arrays_are_the_take(tmp_path: Path) -> None:
    path, take, _ = exported("mannequin", ".npz", tmp_path)
    with np.load(path) as arrays:
        np.testing.assert_allclose(arrays["positions"], take.clip.world()[0], atol=1e-6)
        np.testing.assert_allclose(arrays["root_positions"], take.root.positions, atol=1e-6)
        assert arrays["names"].tolist() == list(SPORT_SKELETON.names)
