"""Targets beside the program's own files: batch lists, answers of a study, and takes as the Blender add-on reads them."""

import json
import math
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np

from benchmarks.study.make import KEY
from runtime.errors import FileError
from runtime.formats.bvh_clip import save_bvh
from sport.batch.rows import read_rows
from tests.benchmarks.test_study import study, synthetic
from tests.helpers.blender_addon import load_addon

from .files import clip
from .mutate import damaged_glb, damaged_json, damaged_text
from .target import Target, put

ROWS = 'prompt,seconds,out,seed\n"a proud, old king",4,king.bvh,1\nlimping,2.5,limp.glb,2\n'


def _json_lines() -> bytes:
    rows = ({"prompt": "a proud king", "seconds": 4, "out": "a.bvh"}, {"prompt": "limping", "seed": 3})
    return "\n".join(json.dumps(row) for row in rows).encode()


def _read_list(suffix: str):
    def read(folder: Path, data: bytes) -> None:
        for row in read_rows(put(folder, f"input{suffix}", data)):
            assert row.number >= 1
            assert len(row.error) < 3000

    return read


@cache
def _addon() -> ModuleType:
    return load_addon()


def _read_in_blender(folder: Path, name: str) -> None:
    try:
        facts = _addon().read_take(folder / name)
    except ValueError as error:
        raise FileError(str(error)) from error
    assert math.isfinite(facts.fps)
    assert facts.frames >= 1
    assert all(isinstance(name, str) and 0 <= frame < 2**20 for name, frame in facts.markers)
    _addon().find_ground(folder / name, facts.terrain)


def _bvh_seeds(folder: Path) -> list[bytes]:
    return [save_bvh(clip(), folder / "seed.bvh").read_bytes()]


def _read_bvh(folder: Path, data: bytes) -> None:
    put(folder, "take.bvh", data)
    _read_in_blender(folder, "take.bvh")


def _sidecar_seeds(folder: Path) -> list[bytes]:
    save_bvh(clip(), folder / "beside.bvh")
    return [(folder / "beside.bvh.json").read_bytes()]


def _read_sidecar(folder: Path, data: bytes) -> None:
    put(folder, "beside.bvh.json", data)
    _read_in_blender(folder, "beside.bvh")


def _glb_seeds(_folder: Path) -> list[bytes]:
    markers = [{"name": "a proud walk", "frame": 0}]
    take = {"fps": 60.0, "frames": 4, "markers": markers, "ground": "hills.obj"}
    text = json.dumps({"asset": {"version": "2.0"}, "animations": [{"extras": {"sport": take}}]}).encode()
    text += b" " * (-len(text) % 4)
    sizes = [0x46546C67, 2, 20 + len(text), len(text), 0x4E4F534A]
    return [b"".join(size.to_bytes(4, "little") for size in sizes) + text]


def _read_glb(folder: Path, data: bytes) -> None:
    put(folder, "take.glb", data)
    _read_in_blender(folder, "take.glb")


# --- answers of a study
@cache
def _study(folder: Path) -> tuple[Path, list[Path]]:
    """Its key, and the answers of three participants."""
    key = study(folder / "study")
    ratings = np.random.default_rng(1).integers(1, 6, (3, 3))
    return folder / "study" / KEY, synthetic(folder / "study", key, ratings)


def _report(folder: Path, data: bytes) -> None:
    """A damaged file in place of the first participant's."""
    from benchmarks.study import report

    key, (_, *others) = _study(folder)
    report.markdown(report.read_answers([put(folder, "answers.json", data), *others], key, synthetic=True))


TARGETS = (
    Target("batch list .csv", lambda _: [ROWS.encode()], damaged_text, _read_list(".csv")),
    Target("batch list .jsonl", lambda _: [_json_lines()], damaged_text, _read_list(".jsonl")),
    Target("answers of a study", lambda f: [_study(f)[1][0].read_bytes()], damaged_json, _report, 0.5),
    Target("BVH in Blender", _bvh_seeds, damaged_text, _read_bvh),
    Target("take metadata in Blender", _sidecar_seeds, damaged_json, _read_sidecar),
    Target("GLB in Blender", _glb_seeds, damaged_glb, _read_glb),
)
