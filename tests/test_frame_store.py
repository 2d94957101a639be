"""Frames of takes on disk: equal arrays, no memory, and what happens when the disk is full."""

from __future__ import annotations

import gc
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from app_driver import Start, run

from runtime.errors import FileError
from runtime.takes import frame_store
from runtime.takes.clip import Clip
from runtime.takes.frame_store import FrameStore


def a_clip(frames: int, seed: int = 0) -> Clip:
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(frames, 31, 4)).astype(np.float32)
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    hips, contacts = (rng.random((frames, n)).astype(np.float32) for n in (3, 4))
    return Clip("take", 60.0, hips, turns, contacts)


def resident() -> int:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def open_files() -> int:
    return len(os.listdir("/proc/self/fd"))


def test_a_clip_in_the_file_is_the_same_clip_with_equal_frames(tmp_path: Path) -> None:
    store, clips = FrameStore(tmp_path / "frames"), [a_clip(n, n) for n in (1, 7, 300)]
    before = [(c.hips_positions.copy(), c.local_rotations.copy(), c.contacts.copy()) for c in clips]
    poses = [clip.sample(0.4).positions for clip in clips]
    assert not any(store.holds(clip) for clip in clips)
    store.move(clips)
    for clip, arrays, pose in zip(clips, before, poses, strict=True):
        assert store.holds(clip)
        assert store.holds(clip.trim(0, 0))
        for now, then in zip((clip.hips_positions, clip.local_rotations, clip.contacts), arrays, strict=True):
            assert now.dtype == then.dtype
            assert np.array_equal(now, then)
            assert not now.flags.writeable
        assert np.array_equal(clip.sample(0.4).positions, pose)
    store.let_go()
    store.close()
    assert np.array_equal(clips[2].local_rotations, before[2][1])  # it lives as long as the clip
    assert not list((tmp_path / "frames").iterdir())  # a file without a name


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_many_takes_hold_neither_memory_nor_files(tmp_path: Path) -> None:
    store, clips = FrameStore(tmp_path), []
    store.move([a_clip(10)])
    begun, files = resident(), open_files()
    for seed in range(120):
        clips.append(a_clip(3600, seed))  # a minute, 1.9 MB: 228 MB in all
        store.move(clips[-1:])
        store.let_go()
    gc.collect()
    assert resident() - begun < 40e6
    assert open_files() - files < 20
    del clips
    store.close()
    gc.collect()
    assert open_files() <= files


def test_a_full_disk_leaves_takes_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        def __init__(self, **_: object) -> None:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(frame_store.tempfile, "TemporaryFile", Full)
    clip = a_clip(5)
    frames = clip.local_rotations.copy()
    with pytest.raises(FileError, match="No space left"):
        FrameStore(tmp_path).move([clip])
    assert not FrameStore.holds(clip)
    assert np.array_equal(clip.local_rotations, frames)


def test_takes_of_the_list_are_moved_while_frames_are_shown(start: Start) -> None:
    app = start()
    for _ in range(3):
        app.takes.toggle_recording()
        run(app, 5)
        app.takes.toggle_recording()
    run(app, 3)
    items = app.editor.session.takes
    assert len(items) == 3
    assert all(FrameStore.holds(item.clip) for item in items)
    app.takes.play(0)
    run(app, 2)
