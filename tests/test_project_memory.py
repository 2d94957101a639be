"""Saving a long list of takes holds little memory: what is packed is on disk, and the file is read back take by take."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.projects import archive as archives
from runtime.projects import spool
from runtime.projects.archive import Budget, Packed
from runtime.projects.project import Project, StoredTake, StoredVersion, load_project, save_project
from runtime.takes.clip import Clip
from runtime.takes.frame_store import FrameStore

FRAMES = 600


def a_take(seed: int) -> StoredTake:
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(FRAMES, 31, 4)).astype(np.float32)
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    hips, contacts = (rng.random((FRAMES, n)).astype(np.float32) for n in (3, 4))
    return StoredTake(StoredVersion(Clip(f"take {seed}", 60.0, hips, turns, contacts)))


def test_a_save_and_what_is_kept_for_the_next_one_hold_a_fraction_of_the_takes(tmp_path: Path) -> None:
    takes, packed = tuple(a_take(seed) for seed in range(24)), Packed(tmp_path / "spool")
    size = sum(take.shown.clip.local_rotations.nbytes for take in takes)
    tracemalloc.start()
    try:
        save_project(Project(takes), tmp_path / "a.sport", packed=packed)
        kept, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 0.05 * size
    assert (
        most < (tmp_path / "a.sport").stat().st_size + 0.35 * size
    )  # it is read back as a whole file, and take by take
    save_project(Project(takes), tmp_path / "b.sport", packed=packed)
    assert (tmp_path / "b.sport").read_bytes() == (tmp_path / "a.sport").read_bytes()
    assert len(load_project(tmp_path / "b.sport").takes) == 24


def test_opening_a_long_list_holds_a_fraction_of_it(tmp_path: Path) -> None:
    path = tmp_path / "a.sport"
    takes = tuple(a_take(seed) for seed in range(24))
    save_project(Project(takes), path)
    size = sum(take.shown.clip.local_rotations.nbytes for take in takes)
    store = FrameStore(tmp_path / "frames")
    tracemalloc.start()
    try:
        project = load_project(path, keep=store.move)
        kept, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 0.05 * size
    assert most < path.stat().st_size + 0.35 * size
    for take, plain in zip(project.takes, load_project(path).takes, strict=True):
        for name in ("hips_positions", "local_rotations", "contacts"):
            assert np.array_equal(getattr(take.shown.clip, name), getattr(plain.shown.clip, name))


def test_what_takes_share_is_counted_once_when_it_is_read_take_by_take(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    budgets: list[Budget] = []
    begin = Budget.for_file

    def noted(size: int) -> Budget:
        budgets.append(begin(size))
        return budgets[-1]

    monkeypatch.setattr(Budget, "for_file", noted)
    shared = a_take(1)
    takes = (shared, replace(shared, name="again"), replace(shared, older=(shared.shown,)), a_take(2))
    save_project(Project(takes), tmp_path / "a.sport")
    load_project(tmp_path / "a.sport")
    at_save, at_load = budgets
    assert at_save.left == at_load.left < at_load.of


def test_a_spool_is_made_anew_when_most_of_it_is_not_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archives, "SPARE_BYTES", 0)
    packed = Packed(tmp_path)
    save_project(Project(tuple(a_take(seed) for seed in range(6))), tmp_path / "a.sport", packed=packed)
    save_project(Project((a_take(7),)), tmp_path / "b.sport", packed=packed)
    again = tmp_path / "c.sport"
    save_project(Project((a_take(7),)), again, packed=packed)
    assert again.read_bytes() == (tmp_path / "b.sport").read_bytes()
    assert packed.bytes_on_disk < 2.5 * again.stat().st_size


def test_a_full_disk_keeps_what_is_packed_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(spool.tempfile, "TemporaryFile", full)
    save_project(Project((a_take(1),)), tmp_path / "a.sport")
    assert len(load_project(tmp_path / "a.sport").takes) == 1
