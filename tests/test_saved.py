"""What counts as saved: in whatever order takes are edited, trimmed, exported and removed, none is lost by closing."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from runtime.controls import Controls, Gait
from runtime.errors import FileError
from runtime.formats import table
from runtime.formats.bvh_clip import load_clip_bvh
from runtime.takes.clip import Clip
from runtime.takes.drive import DriveRecorder
from runtime.takes.recorder import ClipRecorder
from runtime.terrain.height_map import Terrain
from viewer.exports.exporting import Exporting
from viewer.exports.state import ExportState
from viewer.jobs import Jobs
from viewer.messages import Messages
from viewer.scene.simulation import Simulation, rest_pose
from viewer.session.takes import Takes
from viewer.settings import Settings
from viewer.stage.state import StageState
from viewer.takes.state import ClipItem, TakesState

ITEMS = st.integers(0, 3)
TRIMS = st.sampled_from([0, 0, 0, 1, 2])  # the first frame that is exported
NAMES = st.sampled_from(["", "one.bvh", "two.bvh"])  # "" for what is proposed


class LaterJobs(Jobs):
    """Nothing is done until `work` is called."""

    def __init__(self, messages: Messages) -> None:
        super().__init__(messages)
        self.waiting: list[tuple[Any, ...]] = []

    def submit(self, slot: str, work: Any, done: Any, failed: Any = None, **_: Any) -> None:
        self.waiting.append((slot, work, done, failed))

    def busy(self, slot: str) -> bool:
        return any(slot == other for other, *_ in self.waiting)

    def work(self) -> None:
        _, work, done, _ = self.waiting.pop(0)
        try:
            done(work())
        except FileError as error:
            self.messages.error(error)


class Desk(RuleBasedStateMachine):
    """Recording, editing and exporting without a window."""

    def __init__(self) -> None:
        super().__init__()
        self.home = tempfile.TemporaryDirectory()
        self.folder = Path(self.home.name)
        ground = Terrain.flat()
        stage = StageState(ground, Simulation.standing(ground))
        self.jobs, options = LaterJobs(Messages()), Settings(export_folder=str(self.folder / "clips"))
        self.takes = Takes(
            TakesState(), options, Messages(), stage, self.jobs, ClipRecorder(), DriveRecorder(), self.folder,
            load_ground=lambda _: Terrain.flat(), load_character=lambda _: None, is_safe=lambda _: False, is_offered=lambda _: False,
        )  # fmt: skip
        scene: Any = SimpleNamespace(character_path=None, state=stage, settings=options, services=None)
        nobody: Any = None
        self.exporting = Exporting(ExportState(), self.takes, scene, Messages(), self.jobs, nobody)
        self.count = 0
        self.record()

    def item(self, index: int) -> ClipItem | None:
        items = self.takes.state.items
        return items[index % len(items)] if items else None

    @rule()
    def record(self) -> None:
        self.takes.toggle_recording()
        self.count += 1
        ground = Terrain.flat()
        poses = [rest_pose(ground, float(self.count), float(k)) for k in range(4)]
        self.takes.add_poses(poses, Controls((0.0, 1.0), None, Gait.WALK))
        self.takes.toggle_recording()

    @rule(index=ITEMS)
    def edit(self, index: int) -> None:
        item = self.item(index)
        if item is not None:
            self.count += 1
            moved = np.array(item.clip.hips_positions)
            moved[:, 0] = self.count
            item.edit(replace(item.clip, hips_positions=moved), None, "edit")  # type: ignore[arg-type]

    @rule(index=ITEMS, forward=st.booleans())
    def step_through_versions(self, index: int, forward: bool) -> None:
        item = self.item(index)
        if item is not None:
            (item.redo if forward else item.undo)()

    def choose(self, index: int, first: int) -> bool:
        """Select a take and play it from a frame on; whether there is one."""
        if not self.takes.state.items:
            return False
        self.takes.play(index % len(self.takes.state.items))
        assert self.takes.state.playback is not None
        self.takes.state.playback.trim_in(first)
        return True

    @rule(index=ITEMS, first=TRIMS, name=NAMES, fps=st.sampled_from([30, 60, 60, 60]))
    def export(self, index: int, first: int, name: str, fps: int) -> None:
        if self.choose(index, first):
            self.takes.settings.export_fps = fps
            if name:
                self.takes.state.export_path = str(self.folder / "clips" / name)
            self.takes.export()

    @rule()
    def export_all(self) -> None:
        self.takes.export_all()

    @rule(
        index=ITEMS,
        first=TRIMS,
        name=NAMES,
        suffix=st.sampled_from([".bvh", ".bvh", ".glb"]),
        place=st.booleans(),
    )
    def export_from_the_window(self, index: int, first: int, name: str, suffix: str, place: bool) -> None:
        if self.choose(index, first):
            self.exporting.choose_format(suffix)
            self.exporting.state.choose(in_place=place)
            self.exporting.propose()
            if name:
                self.exporting.state.path = str(self.folder / "clips" / name)
            self.exporting.export()

    @rule(suffix=st.sampled_from([".bvh", ".glb", ".mp4"]))
    def choose_format(self, suffix: str) -> None:
        self.exporting.choose_format(suffix)

    @rule(index=ITEMS)
    def remove(self, index: int) -> None:
        if self.takes.state.items:
            self.takes.remove(index % len(self.takes.state.items))

    @rule()
    def bring_back(self) -> None:
        self.takes.restore()

    @rule(name=NAMES)
    def delete_a_file(self, name: str) -> None:
        if name:
            (self.folder / "clips" / name).unlink(missing_ok=True)

    @precondition(lambda self: self.jobs.waiting)
    @rule()
    def work(self) -> None:
        self.jobs.work()

    def held(self, clip: Clip) -> bool:
        """Whether a file in the folder of exports holds every frame."""
        for path in (self.folder / "clips").glob("*.bvh"):
            found = load_clip_bvh(path)
            as_long = len(found) >= len(clip) and found.fps >= clip.fps
            if as_long and np.abs(found.hips_positions[: len(clip)] - clip.hips_positions).max() < 1e-3:
                return True
        return False

    @invariant()
    def what_was_recorded_survives_being_killed(self) -> None:
        for item in self.takes.state.items:
            edited = bool(item.older or item.newer)  # the autosave holds edits, seconds later
            assert item.journal is not None or edited or not item.safe or self.held(item.clip), item.name
            assert item.journal is not None or edited or item.saved is not None, item.name

    def teardown(self) -> None:
        while self.jobs.waiting:
            self.jobs.work()
        self.takes.rescue()
        assert not self.takes.incomplete
        for item in self.takes.state.items:
            assert self.held(item.clip), f"{item.name} is lost"
        self.takes.journals.close(discard=True)
        self.home.cleanup()


def fake_save(real: Callable[..., Any]) -> Callable[..., Any]:
    def save(clip: Clip, path: Path, *rest: Any) -> Any:
        if path.suffix == ".bvh":
            return real(clip, path, *rest)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
        return [SimpleNamespace(text=str(path))]

    return save


def test_no_order_of_edits_and_exports_loses_a_take(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "save_motion", fake_save(table.save_motion))
    Desk.TestCase.settings = settings(
        max_examples=12,
        stateful_step_count=25,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    Desk.TestCase("runTest").runTest()


def test_items_of_equal_takes_are_told_apart() -> None:
    """A file may come to hold another take of the same frames: which item that was is asked of the list."""
    hips, local, contacts = np.zeros((3, 3)), np.zeros((3, 31, 4)), np.zeros((3, 4))
    first, second = (ClipItem(Clip("Take", 60.0, hips, local, contacts.copy())) for _ in range(2))
    assert second not in [first]
    assert second in [first, second]
