"""Targets that are projects: the archive with its text and arrays, and the states of controllers in it."""

from __future__ import annotations

import io
import zipfile
import zlib
from functools import cache
from pathlib import Path

import numpy as np
from walker import WalkerModel

from runtime.controls import Controls, Gait
from runtime.motion.controller import Controller
from runtime.motion.snapshot import Snapshot, take_snapshot
from runtime.projects.archive import DOCUMENT
from runtime.projects.project import Project, StoredTake, StoredVersion, load_project, save_project
from runtime.takes.clip import Clip
from runtime.takes.drive import (
    Drive,
    GroundChange,
    Keyframe,
    Restart,
    StyleChange,
    played_again,
)
from runtime.takes.driven_frames import DrivenFrame, DrivenFrames
from runtime.takes.metadata import PromptEvent
from runtime.terrain.height_map import Terrain

from .files import clip
from .mutate import damaged_bytes, damaged_json
from .target import Target, put


@cache
def snapshot() -> Snapshot:
    """The state of a character that has walked a little."""
    controller = Controller(WalkerModel(), Terrain.flat(), seed=7)
    for _ in range(5):
        controller.step(Controls((0.0, 1.0)))
    return take_snapshot(controller)


def project() -> Project:
    """A project of one take with two versions, everything that drives a take, and a character of two files."""
    ground = Terrain("dunes", np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4), 0.5, (-1.0, -1.0))
    style = StyleChange(
        0, np.ones((6, 64), np.float32), 0.4, PromptEvent(0.0, "a proud walk", 0.4, '{"a": 1}')
    )
    frames = DrivenFrames.of(DrivenFrame(Controls((0.1, 1.0), None, Gait.WALK), 0.7, 1.0) for _ in range(4))
    changes = (GroundChange(0, "dunes.png", ground), style, Restart(2, 0.0, 1.0, 0.5))
    drive = Drive(frames, changes, (Keyframe(0, snapshot()),))
    shown = StoredVersion(clip(), drive, "", "words")
    take = StoredTake(shown, (StoredVersion(clip()),), name="my take")
    files = {"me.gltf": b"{}", "textures/skin.png": b"PNG"}
    return Project((take,), 1, 0, "dunes.png", ground, files, view={"camera": "orbit", "yaw": 0.5})


def _project_seeds(folder: Path) -> list[bytes]:
    save_project(project(), folder / "seed.sport")
    return [(folder / "seed.sport").read_bytes()]


def _state_seeds(_folder: Path) -> list[bytes]:
    return [snapshot().to_bytes()]


def _inside(*texts: str):
    """Damage to members of a ZIP, whose checksums then fit; sometimes to all bytes. `texts` are JSON."""

    def damage(rng, data: bytes) -> bytes:
        if rng.random() < 0.2:
            return damaged_bytes(rng, data)
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            members = {m.filename: file.read(m) for m in file.infolist()}
        name = rng.choice([*texts, *texts, rng.choice(list(members))])
        members[name] = (damaged_json if name in texts else damaged_bytes)(rng, members[name])
        if rng.random() < 0.05:
            del members[rng.choice(list(members))]
        out = io.BytesIO()
        kind = zipfile.ZIP_DEFLATED if rng.random() < 0.02 else zipfile.ZIP_STORED
        with zipfile.ZipFile(out, "w", kind) as file:
            for name, content in members.items():
                file.writestr(name, content)
        return out.getvalue()

    return damage


def _read_project(folder: Path, data: bytes) -> None:
    found = load_project(put(folder, "input.sport", data))
    for take in found.takes:
        for version in (take.shown, *take.older, *take.newer):
            assert np.isfinite(version.clip.pose(0).positions).all()
            version.clip.describe().encode()
            assert version.drive is None or len(version.drive.prompts()) >= 0
    assert all(".." not in name and not name.startswith("/") for name in found.character)
    save_project(found, folder / "again.sport")  # what was read can be written


def _values(rng, data: bytes) -> bytes:
    """Damage to what arrays hold, unfolded and packed again: states, sticks, styles, frames; sometimes to the text."""
    if rng.random() < 0.3:
        return _inside(DOCUMENT)(rng, data)
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        members = {m.filename: file.read(m) for m in file.infolist()}
    for _ in range(rng.choice((1, 1, 3))):
        name = rng.choice([name for name in members if name != DOCUMENT])
        plain = zlib.decompress(members[name])
        members[name] = zlib.compress(_state(rng, plain) if plain[:2] == b"PK" else _flipped(rng, plain), 1)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as file:
        for name, content in members.items():
            file.writestr(name, content)
    return out.getvalue()


def _state(rng, data: bytes) -> bytes:
    """A controller's state with other values in one of its arrays, or in its text."""
    with np.load(io.BytesIO(data)) as file:
        arrays = {name: file[name] for name in file.files}
    name = rng.choice(["head", *arrays])
    if name == "head":
        arrays[name] = np.frombuffer(damaged_json(rng, arrays[name].tobytes()), np.uint8)
    else:
        old = arrays[name]
        arrays[name] = np.frombuffer(_flipped(rng, old.tobytes()), old.dtype).reshape(old.shape)
    out = io.BytesIO()
    np.savez(out, **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def _flipped(rng, data: bytes) -> bytes:
    """As many bytes, some of them others."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 4, 16)) if data else 0):
        changed[rng.randrange(len(changed))] = rng.choice((0, 1, 63, 127, 128, 191, 255))
    return bytes(changed)


def _drive_again(folder: Path, data: bytes) -> None:
    """Takes of a damaged project are driven again: twice the same bytes, and once more after they were saved."""
    for take in load_project(put(folder, "input.sport", data)).takes:
        for version in (take.shown, *take.older, *take.newer):
            if version.drive is None:
                continue
            first, second = (_driven(version.clip, version.drive) for _ in range(2))
            assert first.clip.local_rotations.tobytes() == second.clip.local_rotations.tobytes()
            assert np.isfinite(first.clip.pose(len(first.clip) - 1).positions).all()
            save_project(Project((StoredTake(first),)), folder / "again.sport")
            kept = load_project(folder / "again.sport").takes[0].shown
            assert kept.drive is not None
            third = _driven(kept.clip, kept.drive)
            assert third.clip.local_rotations.tobytes() == first.clip.local_rotations.tobytes()
            assert third.clip.hips_positions.tobytes() == first.clip.hips_positions.tobytes()


def _driven(clip: Clip, drive: Drive) -> StoredVersion:
    controller = Controller(WalkerModel(), Terrain.flat(), seed=7)
    return StoredVersion(*played_again(clip, drive, controller, 0))


TARGETS = (
    Target("project", _project_seeds, _inside(DOCUMENT), _read_project, 2.0),
    Target("project driven again", _project_seeds, _values, _drive_again),
    Target("controller state", _state_seeds, damaged_bytes, lambda _, data: Snapshot.from_bytes(data)),
)
