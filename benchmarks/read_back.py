"""Exported files of every kind read by third-party libraries: joints must be within a millimetre in each frame.

    python -m benchmarks.read_back [--markdown docs/results/read_back.md]

The reference is the displayed pose. USD needs usd-core.
"""

import itertools
import multiprocessing
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from runtime.arrays import AnyArray
from runtime.assets import asset_path
from runtime.atomic import temporary_folder
from runtime.character.character import load_character
from runtime.character.fbx_to_glb import Kept
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.formats.glb import MANNEQUIN
from runtime.formats.options import ExportOptions
from runtime.formats.prepare import prepare
from runtime.formats.table import save_motion
from runtime.generate import generate_clip
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from training.evaluation import log
from training.evaluation.experiment import Experiment, Setting, run_alone
from training.markdown import table

RATES = (30.0, 30000 / 1001, 60.0)
OWN = Path("tests/runtime/character/characters/box_man.glb")
FLAT = Terrain.flat()
# by take: rate, and joint positions (T, 3) by name
Read = dict[str, tuple[float, dict[str, AnyArray]]]


def read_bvh(path: Path, unit: str) -> Read:
    """Read a BVH from its text: product of the matrices of its channels."""
    head, _, motion = path.read_text(encoding="utf-8").partition("MOTION")
    joints = _bvh_joints(head)
    lines = motion.strip().splitlines()
    values, columns = np.array([line.split() for line in lines[2:]], float).T, itertools.count()
    for joint in joints:
        local = _bvh_local(joint, values, columns)
        joint["world"] = local if joint["parent"] is None else joint["parent"]["world"] @ local
    metres = 0.01 if unit == "cm" else 1.0
    places = {joint["name"]: joint["world"][:, :3, 3] * metres for joint in joints}
    return {"": (1.0 / float(lines[1].split()[-1]), places)}


def _bvh_joints(head: str) -> list[dict[str, Any]]:
    joints, stack = list[dict[str, Any]](), list[Any]()
    for words in filter(None, map(str.split, head.splitlines())):
        if words[0] in ("ROOT", "JOINT", "End"):
            joints.append({"name": words[-1], "parent": stack[-1] if stack else None, "channels": []})
        elif words[0] == "OFFSET":
            joints[-1]["offset"] = np.array(words[1:], float)
        elif words[0] == "CHANNELS":
            joints[-1]["channels"] = words[2:]
        elif words[0] in "{}":
            stack.append(joints[-1]) if words[0] == "{" else stack.pop()
    return joints


def _bvh_local(joint: dict[str, Any], values: AnyArray, columns: Iterator[int]) -> AnyArray:
    local = np.tile(np.eye(4), (values.shape[1], 1, 1))
    local[:, :3, 3] = joint["offset"]
    kinds = [channel[0] for channel in joint["channels"]]  # positions come first in our files
    read = np.array([values[next(columns)] for _ in kinds]).T
    if len(kinds) == 6:
        local[:, ["XYZ".index(axis) for axis in kinds[:3]], 3] = read[:, :3]
    if kinds:
        turn = Rotation.from_euler("".join(kinds[-3:]), read[:, -3:], degrees=True)
        local[:, :3, :3] = turn.as_matrix()
    return local


def read_glb(path: Path) -> Read:
    """Read a GLB by pygltflib: keys of each node, composed down the tree."""
    from pygltflib import GLTF2

    gltf = GLTF2.load(str(path))
    found: Read = {}
    for animation in gltf.animations:
        keys = {
            (channel.target.node, channel.target.path): _glb_values(
                gltf, animation.samplers[channel.sampler].output
            )
            for channel in animation.channels
        }
        times = _glb_values(gltf, animation.samplers[0].input)[:, 0]
        world: dict[int, AnyArray] = {}
        todo: list[tuple[int, AnyArray]] = [(node, np.eye(4)) for node in gltf.scenes[0].nodes]
        for node, above in todo:
            world[node] = above @ _glb_local(gltf.nodes[node], node, keys, len(times))
            todo.extend((child, world[node]) for child in gltf.nodes[node].children or [])
        places = {gltf.nodes[node].name: matrix[:, :3, 3] for node, matrix in world.items()}
        found[animation.name] = (len(times) - 1) / float(times[-1]), places
    return found


def _glb_values(gltf: Any, index: int) -> AnyArray:
    accessor = gltf.accessors[index]
    start = gltf.bufferViews[accessor.bufferView].byteOffset + (accessor.byteOffset or 0)
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
    return np.frombuffer(gltf.binary_blob(), "<f4", accessor.count * width, start).reshape(-1, width)


def _glb_local(node: Any, number: int, keys: dict[tuple[int, str], AnyArray], frames: int) -> AnyArray:
    """Return matrices `(frames, 4, 4)` of a node from its keys, or its rest transform."""
    turn = keys.get((number, "rotation"), node.rotation or [0, 0, 0, 1])
    place = keys.get((number, "translation"), node.translation or [0, 0, 0])
    return _matrix(turn, place, node.scale or [1.0, 1.0, 1.0], frames)


def _matrix(rotation: Any, translation: Any, scale: Any, frames: int) -> AnyArray:
    local = np.tile(np.eye(4), (frames, 1, 1))
    local[:, :3, :3] = Rotation.from_quat(np.atleast_2d(rotation)).as_matrix() * np.array(scale)
    local[:, :3, 3] = translation
    return local


def read_fbx(path: Path) -> Read:
    """Read an FBX by ufbx, in a separate process, because ufbx crashes when it frees a scene."""
    target = path.with_suffix(".npz")
    process = multiprocessing.get_context("spawn").Process(target=_ufbx, args=(path, target))
    process.start()
    process.join()
    with np.load(target, allow_pickle=False) as found:
        names, fps = found["names"].tolist(), float(found["fps"])
        takes = [name for name in found.files if name.startswith("take ")]
        return {take[5:]: (fps, dict(zip(names, found[take].swapaxes(0, 1), strict=True))) for take in takes}


def _ufbx(path: Path, target: Path) -> None:
    import ufbx

    scene = Kept(ufbx.load_file(str(path), target_axes=ufbx.axes_right_handed_y_up, target_unit_meters=1.0))
    fps, found = scene.settings.frames_per_second, dict[str, AnyArray]()
    for stack in scene.anim_stacks:
        frames = []
        for frame in range(round((stack.time_end - stack.time_begin) * fps) + 1):
            seconds, world = stack.time_begin + frame / fps, dict[int, AnyArray]()
            for node in scene.nodes:  # parents first
                moved = ufbx.evaluate_transform(stack.anim.value, node.value, seconds)
                t, q, s = moved.translation, moved.rotation, moved.scale
                local = _matrix([q.x, q.y, q.z, q.w], [t.x, t.y, t.z], [s.x, s.y, s.z], 1)[0]
                world[node.typed_id] = local if node.parent is None else world[node.parent.typed_id] @ local
            frames.append([world[node.typed_id][:3, 3] for node in scene.nodes])
        found[f"take {stack.name}"] = np.array(frames)
    np.savez(target, names=np.array([node.name for node in scene.nodes]), fps=fps, **found)  # type: ignore[arg-type]
    os._exit(0)


def read_usd(path: Path) -> Read:
    """Read a USD by OpenUSD's skinning, for each of its variants."""
    from pxr import Usd

    stage, found = Usd.Stage.Open(str(path)), Read()
    variants = stage.GetDefaultPrim().GetVariantSets().GetVariantSet("take")
    for name in variants.GetVariantNames() or [""]:
        if name:
            variants.SetVariantSelection(name)
        found[name] = stage.GetTimeCodesPerSecond(), _usd(stage)
    return found


def _usd(stage: Any) -> dict[str, AnyArray]:
    from pxr import Usd, UsdGeom, UsdSkel

    cache, root = UsdSkel.Cache(), UsdSkel.Root(stage.GetDefaultPrim())
    cache.Populate(root, Usd.PrimDefaultPredicate)
    (binding, *_) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(binding.GetSkeleton())
    names = [str(joint).rpartition("/")[2] for joint in query.GetJointOrder()]
    caches = map(UsdGeom.XformCache, query.GetAnimQuery().GetJointTransformTimeSamples())
    frames = [[m.ExtractTranslation() for m in query.ComputeJointWorldTransforms(cache)] for cache in caches]
    places = np.array(frames) * UsdGeom.GetStageMetersPerUnit(stage)
    return dict(zip(names, places.swapaxes(0, 1), strict=True))


READERS: dict[str, Callable[[Path], Read]] = {
    "bvh cm": lambda path: read_bvh(path, "cm"), "bvh m": lambda path: read_bvh(path, "m"), "glb": read_glb,
    "fbx m": read_fbx, "fbx cm": read_fbx, "usd": read_usd, "usdz": read_usd,
}  # fmt: skip


Row = tuple[str, int, bool, Path | None]  # kind, number of takes, root on the ground or not, character


def rows_of(kind: str) -> list[Row]:
    takes = (1,) if kind[:3] == "bvh" else (1, 3)
    characters = (None,) if kind[:3] == "bvh" else (None, OWN)
    return list(itertools.product([kind], takes, (False, True), characters))


def cell(row: Row, rate: float, takes: list[Path]) -> tuple[float, str]:
    """Return the largest distance in millimetres, and other errors."""
    kind, count, root, own = row
    suffix, _, unit = kind.partition(" ")
    given: dict[str, Any] = {"unit": unit} if suffix == "bvh" else {"engine": "maya"} if unit == "cm" else {}
    given |= {"fps": rate, "ground_root": root, "with_takes": tuple(takes[1:count])}
    options = ExportOptions(character=own, fit_to_motion=own is not None, **given)
    save_motion(load_clip_bvh(takes[0]), path := takes[0].with_name(f"out.{suffix}"), options, FLAT)
    found = READERS[kind](path)
    worst, wrong = 0.0, [] if len(found) == count else [f"{len(found)} takes"]
    for take in takes[:count]:
        fps, places = found.get(take.stem) or found[""]
        wanted = _truth(take, options, suffix)
        frames = {len(place) for place in places.values()}
        if frames != {len(next(iter(wanted.values())))} or abs(fps - rate) > 1e-3:
            wrong.append(f"{frames} frames at {fps:.3f}")
        else:
            worst = max(worst, _farthest_mm(places, wanted))
    return worst, ", ".join(wrong)


def _farthest_mm(places: dict[str, AnyArray], wanted: dict[str, AnyArray]) -> float:
    """Return the largest joint distance, infinite if a joint is missing. USD names have only letters, digits and _."""
    found = {name: places.get(name, places.get(name.replace(":", "_"))) for name in wanted}
    return max(
        np.inf if there is None else 1e3 * float(np.abs(there - wanted[name]).max())
        for name, there in found.items()
    )


def _truth(take: Path, options: ExportOptions, suffix: str) -> dict[str, AnyArray]:
    """Return the joint positions of the displayed pose."""
    clip = prepare(load_clip_bvh(take), replace(options, with_takes=()), FLAT).clip
    if suffix == "bvh":
        return dict(zip(SPORT_SKELETON.names, clip.world()[0].swapaxes(0, 1), strict=True))
    character = load_character(options.character or asset_path(MANNEQUIN))
    matrices = character.joint_matrices(*character.adapted(*clip.world(), clip.contacts))
    return dict(zip(character.joint_names, matrices[..., :3, 3].swapaxes(0, 1), strict=True))


def measure(setting: Setting) -> list[list[Any]]:
    """Measure every row; returns kind, takes, root, character, and results by rate."""
    kinds, rows = [kind for kind in READERS if kind[:3] != "usd" or find_spec("pxr") is not None], []
    with temporary_folder() as folder:
        clip = generate_clip("a proud walk", seconds=2.0)
        parts = {"walk": clip, "on": clip.trim(20, 90), "back": replace(clip.trim(5, 60), fps=50.0)}
        takes = [save_bvh(part, folder / f"{name}.bvh", part.fps) for name, part in parts.items()]
        for row in (row for kind in kinds for row in rows_of(kind)):
            rows.append([*_texts(row), *(cell(row, rate, takes) for rate in RATES)])
            log.info(" | ".join(map(str, rows[-1])))
    return rows


def _texts(row: Row) -> list[str]:
    return [row[0], str(row[1]), "yes" if row[2] else "no", "own" if row[3] else "mannequin"]


def read_back_table(rows: list[list[Any]]) -> str:
    """Return a table with a line per row; errors replace distances."""
    head = ["file", "takes", "root", "character", *(f"{rate:.5g} fps" for rate in RATES)]
    lines = [[*row[:4], *(wrong or f"{worst:.4f} mm" for worst, wrong in row[4:])] for row in rows]
    return "\n".join(table(head, lines))


READ_BACK = Experiment(
    __doc__,
    measure,
    read_back_table,
    "read back",
    failed=lambda rows: any(wrong or worst > 1.0 for row in rows for worst, wrong in row[4:]),
)

if __name__ == "__main__":
    raise SystemExit(run_alone(READ_BACK, "read_back"))
