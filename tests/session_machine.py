"""Anything that a user does to a session, in any order, against a simple model of it.

`python -m tests.session_machine --steps 5000 --seed 1` runs long (from the project's folder);
`tests/viewer/session/test_session_machine.py` a little of it.
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import tempfile
import threading
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from runtime.session.prompt_blend import Side
from runtime.session.session import Session
from runtime.skeleton import PART_NAMES
from runtime.takes.pins import Pinned, held_pins
from tests.helpers.app_driver import InjectedPads, run
from tests.helpers.full_session import text_of
from tests.helpers.viewer_fakes import fake_services
from viewer.app import App
from viewer.edit.resimulation import RESIMULATION
from viewer.jobs import MAX_PARALLEL_JOBS
from viewer.messages import Level
from viewer.options import ViewOptions
from viewer.session.takes import RECORDED_FRAMES

GROUNDS = ("flat", "stairs", "hills")
PROMPTS = ("a proud king", "an old king", "a zombie")


def shown(session: Session) -> dict[str, Any]:
    """What the model knows of a session, as plain values."""
    takes = [
        (
            t.number,
            t.title,
            t.frames,
            t.range,
            len(t.poses.pins),
            len(t.cameras),
            t.color,
            t.mirrored,
            len(t.poses.layer.keys),
        )
        for t in session.takes
    ]
    live = session.live
    return {
        "takes": takes,
        "prompt": live.prompt.prompt(0),
        "blended": live.prompt.prompt(1),
        "weights": live.prompt.weights,
        "locked": sorted(live.prompt.locked),
        "shape": (session.character.path, session.character.shape),
        "ground": "" if session.ground is None else session.ground.spec,
        "path": len(live.path),
        "held": sorted(str(pin.what) for pin in held_pins(live.poses.pins)),
        "reference": 0 if session.reference is None else session.reference.take,
        "variants": len(session.variants),
    }


@dataclass(eq=False)
class Running:
    """A resimulation that has begun: its step, its take, and the gate that lets its worker end."""

    step: dict[str, Any]
    number: int
    gate: threading.Event


def shortened(take: tuple[Any, ...]) -> tuple[Any, ...]:
    """What the model knows of a take after its resimulation, which makes one frame less."""
    number, title, frames, (first, last), *rest = take
    end = frames - 2 if last == frames - 1 else min(last, frames - 2)
    return number, title, frames - 1, (max(min(first, end - 1), 0), end), *rest


@dataclass
class Model:
    """One session as a list of what it was after each edit."""

    steps: list[dict[str, Any]]
    running: list[Running] = field(default_factory=list)
    at: int = 0
    opened: dict[str, Any] = field(default_factory=dict)
    # of each step, once it was seen: all of the session as text, and the name of the edit
    seen: dict[int, tuple[str, str]] = field(default_factory=dict)

    @property
    def now(self) -> dict[str, Any]:
        return self.steps[self.at]

    def edit(self, **changes: Any) -> None:
        del self.steps[self.at + 1 :]
        self.steps.append({**self.now, **changes})
        self.at += 1
        self.seen = {at: seen for at, seen in self.seen.items() if at < self.at}

    def begin(self, number: int) -> Running:
        """A step of a job."""
        self.edit()
        self.running.append(Running(self.now, number, threading.Event()))
        return self.running[-1]

    def land(self, job: Running) -> None:
        """The job's take is another one in its step and in all later ones."""
        self.running.remove(job)
        first = self.place(job)
        for step in self.steps[first:]:
            step["takes"] = [shortened(take) if take[0] == job.number else take for take in step["takes"]]
        self.seen = {at: seen for at, seen in self.seen.items() if at < first}

    def drop(self, job: Running) -> None:
        """The job's step is none."""
        self.running.remove(job)
        place = self.place(job)
        del self.steps[place]
        self.at -= self.at >= place
        self.seen = {at: seen for at, seen in self.seen.items() if at < place}

    def place(self, job: Running) -> int:
        return next(i for i, step in enumerate(self.steps) if step is job.step)

    def end_jobs(self) -> None:
        for job in list(self.running):
            self.drop(job)

    def undo(self) -> None:
        job = next((job for job in self.running if job.step is self.now), None)
        if job is not None:
            self.drop(job)
        else:
            self.at = max(self.at - 1, 0)

    def copy(self) -> Model:
        """What a file has of it: no steps that jobs still make."""
        waiting = [job.step for job in self.running]
        kept = [i for i, step in enumerate(self.steps) if all(step is not each for each in waiting)]
        places = {at: place for place, at in enumerate(kept)}
        steps = [dict(self.steps[i]) for i in kept]
        seen = {places[at]: seen for at, seen in self.seen.items() if at in places}
        return Model(steps, at=sum(i <= self.at for i in kept) - 1, opened=dict(self.opened), seen=seen)


def of_a_take(**drawn: Any) -> Any:
    """A rule on one of the takes, where there is one."""

    def marked(act: Any) -> Any:
        return precondition(lambda self: self.session.takes)(rule(place=st.integers(0, 9), **drawn)(act))

    return marked


class SessionMachine(RuleBasedStateMachine):
    """Drives the real application without a display."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="session-machine-"))
        self.files = 0
        self.app = self._start()
        self.model = Model([shown(self.session)])
        self.model.opened = self.model.now
        self.kept: dict[Path, Model] = {}  # named sessions that are closed

    def _start(self) -> App:
        options = ViewOptions(offscreen=True, terrain="flat", width=320, height=240)
        app = App(options, fake_services(False), InjectedPads(), self.folder / "config")
        app.window.draw_interface = lambda: None  # type: ignore[method-assign]  # nobody looks
        run(app, 3)
        return app

    @property
    def session(self) -> Session:
        return self.app.editor.session

    def teardown(self) -> None:
        self.app.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    @invariant()
    def check(self) -> None:
        """After every step: what holds, and what undo and redo would do."""
        run(self.app, 2)
        self.app.editor.finish_drag()
        assert shown(self.session) == self.model.now, (shown(self.session), self.model.now)
        assert bool(self.app.editor.undo_label) == (self.model.at > 0)
        assert bool(self.app.editor.redo_label) == (self.model.at + 1 < len(self.model.steps))
        text, label = text_of(replace(self.session, selected=0)), self.app.editor.undo_label
        assert self.model.seen.setdefault(self.model.at, (text, label)) == (text, label)
        if self.model.at + 1 in self.model.seen:
            assert self.app.editor.redo_label == self.model.seen[self.model.at + 1][1]
        playback = self.app.takes.playback
        assert playback is None or self.session.take(playback.number) == playback.take
        assert self.session.selected == 0 or self.session.current is not None
        assert not [m.text for m in self.app.messages.recent if m.level is Level.ERROR]

    def busy(self, take: Any) -> bool:
        return any(job.number == take.number for job in self.model.running)

    def pick(self, place: int) -> Any:
        takes = self.session.takes
        return takes[place % len(takes)] if takes else None

    def replaced(self, number: int, **changes: Any) -> list[Any]:
        names = ("number", "title", "frames", "range", "pins", "cameras", "color", "mirrored", "poses")
        return [
            tuple(changes.get(name, value) for name, value in zip(names, take, strict=True))
            if take[0] == number
            else take
            for take in self.model.now["takes"]
        ]

    # --- takes

    @rule(frames=st.integers(5, 20), walks=st.booleans())
    def record(self, frames: int, walks: bool) -> None:
        self.app.takes.toggle_recording()
        if walks:
            self.app.window.inject_key("w", True)
        run(self.app, frames)
        self.app.window.inject_key("w", False)
        self.app.takes.toggle_recording()
        self._new_take()

    @rule()
    def keep_last(self) -> None:
        self.app.takes.save_last()
        self._new_take()

    def _new_take(self) -> None:
        take = shown(self.session)["takes"][-1]
        known = self.model.now["takes"]
        assert len(self.session.takes) == len(known) + 1
        assert take[0] > max([each[0] for each in known], default=0)
        assert (take[3], take[6], take[7]) == ((0, take[2] - 1), 0, False)
        self.model.edit(takes=[*known, take])

    @of_a_take(first=st.integers(1, 9))
    def trim(self, place: int, first: int) -> None:
        take = self.pick(place)
        self.app.takes.play(take.number)
        self.app.takes.trim(first=first)
        end = take.range[1]
        begin = min(first, end - 1)
        if (begin, end) != take.range:
            self.model.edit(takes=self.replaced(take.number, range=(begin, end)))

    @of_a_take(name=st.sampled_from(("walk", "the king", "näher")))
    def rename(self, place: int, name: str) -> None:
        take = self.pick(place)
        self.app.takes.rename(take.number, name)
        if name != take.title:
            self.model.edit(takes=self.replaced(take.number, title=name))

    @of_a_take(color=st.integers(0, 5))
    def recolor(self, place: int, color: int) -> None:
        take = self.pick(place)
        self.app.takes.set_color(take.number, color)
        if color != take.color:
            self.model.edit(takes=self.replaced(take.number, color=color))

    @of_a_take()
    def remove(self, place: int) -> None:
        take = self.pick(place)
        self.app.takes.remove(take.number)
        kept = [each for each in self.model.now["takes"] if each[0] != take.number]
        reference = self.model.now["reference"]
        self.model.edit(takes=kept, reference=0 if reference == take.number else reference)

    @of_a_take()
    def mirror(self, place: int) -> None:
        take = self.pick(place)
        self.app.takes.mirror(take.number)
        made = shown(self.session)["takes"][-1]
        assert (made[2], made[4], made[7]) == (take.frames, 0, not take.mirrored)
        self.model.edit(takes=[*self.model.now["takes"], made])

    @of_a_take(frame=st.integers(1, 9))
    def split(self, place: int, frame: int) -> None:
        take = self.pick(place)
        self.app.takes.play(take.number)
        playback, (first, last) = self.app.takes.playback, take.range
        playback.seek(frame)
        self.app.cutting.split()
        if first < frame < last:
            takes = self.replaced(take.number, range=(first, frame))
            at = [each[0] for each in takes].index(take.number)
            made = shown(self.session)["takes"][at + 1]
            assert (made[2], made[3], made[4]) == (take.frames, (frame, last), len(take.poses.pins))
            takes.insert(at + 1, made)
            self.model.edit(takes=takes)

    @of_a_take(other=st.integers(0, 9), times=st.integers(1, 3))
    def join(self, place: int, other: int, times: int) -> None:
        """A take with another one, or several times after itself."""
        take, second = self.pick(place), self.pick(other)
        self.app.takes.play(take.number)
        if times == 1:
            self.app.cutting.join(second.number)
        else:
            self.app.cutting.repeat(times)
        run(self.app, 2)
        made = shown(self.session)["takes"][-1]
        lengths = [t.range[1] - t.range[0] for t in ((take, second) if times == 1 else (take,) * times)]
        assert made[2] == sum(lengths) + 1
        self.model.edit(takes=[*self.model.now["takes"], made])

    @precondition(lambda self: len(self.session.takes) > 1)
    @rule(place=st.integers(0, 9), by=st.sampled_from((-1, 1)))
    def move(self, place: int, by: int) -> None:
        takes = list(self.model.now["takes"])
        at = place % len(takes)
        selection = self.app.transport.selection
        selection.pick(item for item in selection.all(["takes"]) if item.lane == takes[at][0])
        selection.nudge(by)
        if 0 <= at + by < len(takes):
            takes.insert(at + by, takes.pop(at))
            self.model.edit(takes=takes)

    @of_a_take(what=st.sampled_from((Pinned.LEFT_HAND, Pinned.LOOK, Pinned.POSE)))
    def pin(self, place: int, what: Pinned) -> None:
        take = self.pick(place)
        self.app.takes.play(take.number)
        self.app.pins.add(what)
        if self.busy(take):  # it is being resimulated
            return
        self.model.edit(takes=self.replaced(take.number, pins=len(take.poses.pins) + 1))

    @of_a_take(frame=st.integers(0, 4), copied=st.booleans())
    def pose_key(self, place: int, frame: int, copied: bool) -> None:
        take, posing = self.pick(place), self.app.posing
        self.app.takes.play(take.number)
        self.app.takes.playback.seek(frame)
        posing.joint = 16
        if copied:
            posing.copy()
            posing.paste()
        else:
            posing.set_key()
        after = self.session.take(take.number)
        keys = {round(key.seconds * 60) for key in take.poses.layer.keys} | {frame}
        if self.busy(take):
            return
        assert len(after.poses.layer.keys) == len(keys)
        if after != take:
            self.model.edit(takes=self.replaced(take.number, poses=len(keys)))

    @of_a_take(frame=st.integers(0, 4))
    def camera_key(self, place: int, frame: int) -> None:
        take = self.pick(place)
        self.app.takes.play(take.number)
        playback = self.app.takes.playback
        playback.seek(frame)
        self.app.camera_keys.add()
        after = self.session.take(take.number)
        frames = {round(key.seconds * 60) for key in take.cameras} | {playback.frame}
        assert len(after.cameras) == len(frames)
        if after != take:
            self.model.edit(takes=self.replaced(take.number, cameras=len(frames)))

    @precondition(lambda self: len(self.session.takes) > 1)
    @rule(place=st.integers(0, 9))
    def compare_with(self, place: int) -> None:
        take = self.pick(place)
        self.app.references.show(take.number)
        before = self.model.now["reference"]
        self.model.edit(reference=0 if before == take.number else take.number)

    # --- the live character

    @rule(text=st.sampled_from(PROMPTS))
    def prompt(self, text: str) -> None:
        self.app.takes.close_playback()
        self.app.prompting.submit_prompt(text)
        run(self.app, 2)
        if self.model.now["prompt"] != text:
            self.model.edit(prompt=text)
        elif self.app.editor.history.at != self.model.at:
            self.model.edit()  # the same words, answered anew

    @rule(what=st.sampled_from((Pinned.LEFT_HAND, Pinned.RIGHT_HAND, Pinned.LOOK)))
    def hold(self, what: Pinned) -> None:
        self.app.takes.close_playback()
        self.app.pins.toggle_live(what)
        held = set(self.model.now["held"]) ^ {str(what)}
        self.model.edit(held=sorted(held))

    @rule(x=st.integers(-5, 5), z=st.integers(-5, 5))
    def path_point(self, x: int, z: int) -> None:
        self.app.takes.close_playback()
        run(self.app, 1)
        self.app.path.add(float(x), float(z))
        self.model.edit(path=self.model.now["path"] + 1)

    @rule(name=st.sampled_from(GROUNDS))
    def ground(self, name: str) -> None:
        self.app.scene.load_terrain(name)
        if name != self.model.now["ground"]:
            self.model.edit(ground=name)

    @rule(text=st.sampled_from(PROMPTS))
    def prompt_b(self, text: str) -> None:
        self.app.takes.close_playback()
        self.app.prompting.submit_prompt(text, Side.B)
        run(self.app, 2)
        if self.model.now["blended"] != text:
            self.model.edit(blended=text, weights=shown(self.session)["weights"])
        elif self.app.editor.history.at != self.model.at:
            self.model.edit()

    @precondition(lambda self: self.model.now["blended"])
    @rule(part=st.sampled_from(PART_NAMES), weight=st.sampled_from((0.0, 0.25, 1.0)))
    def weight(self, part: str, weight: float) -> None:
        """A slider is dragged in two steps, which are one edit."""
        for held in (0.5, weight):
            self.app.prompting.set_weight(part, held)
        self.app.editor.finish_drag()
        at = PART_NAMES.index(part)
        now = self.model.now["weights"]
        if part not in self.model.now["locked"] and now[at] != weight:
            self.model.edit(weights=(*now[:at], weight, *now[at + 1 :]))

    @rule(part=st.sampled_from(PART_NAMES[:2]))
    def lock(self, part: str) -> None:
        self.app.prompting.toggle_lock(part)
        self.model.edit(locked=sorted(set(self.model.now["locked"]) ^ {part}))

    @rule(part=st.sampled_from(PART_NAMES[:2]), words=st.sampled_from(("raised high", "hanging")))
    def part(self, part: str, words: str) -> None:
        """Other words for a part lock it."""
        self.app.takes.close_playback()
        before = self.app.prompting.applied(part)
        self.app.prompting.parts[part] = words
        self.app.prompting.submit_part(part)
        run(self.app, 2)
        if words != before:
            self.model.edit(locked=sorted({*self.model.now["locked"], part}))

    @rule(height=st.sampled_from((0.8, 1.0, 1.2)))
    def shape(self, height: float) -> None:
        shape = replace(self.model.now["shape"][1], height=height)
        self.app.scene.set_shape(shape)  # that of the mannequin, which takes the place of another character
        if ("", shape) != self.model.now["shape"]:
            self.model.edit(shape=("", shape))

    # --- what is no edit

    @of_a_take()
    def select(self, place: int) -> None:
        self.app.takes.select(self.pick(place).number)

    @of_a_take()
    def play(self, place: int) -> None:
        self.app.takes.play(self.pick(place).number)

    @rule()
    def go_live(self) -> None:
        self.app.takes.close_playback()

    @rule()
    def walk(self) -> None:
        self.app.window.inject_key("w", True)
        run(self.app, 5)
        self.app.window.inject_key("w", False)

    # --- jobs that run

    @of_a_take()
    def begin_job(self, place: int) -> None:
        """Resimulate a take, which takes until the gate is opened."""
        take, app = self.pick(place), self.app
        app.takes.play(take.number)
        if len(self.model.running) == MAX_PARALLEL_JOBS or app.editing.fixed or take.frames < 8:
            return
        job = self.model.begin(take.number)

        def work(clip: Any, inputs: Any, model: Any, progress: Any) -> Any:
            while not job.gate.wait(0.002):
                progress(0.5)
            return clip.trim(0, len(clip) - 2), replace(inputs, frames=inputs.frames[:-1])

        app.jobs.blocking = False
        app.editing.run("job", work)
        app.jobs.blocking = True

    @precondition(lambda self: self.model.running)
    @rule(place=st.integers(0, 9))
    def finish_job(self, place: int) -> None:
        job = self.model.running[place % len(self.model.running)]
        job.gate.set()
        slot, end = dataclasses.replace(RESIMULATION, of=job.number), time.monotonic() + 10.0
        while self.app.jobs.busy(slot):
            assert time.monotonic() < end, "the job never ended"
            run(self.app)
            time.sleep(0.002)
        self.model.land(job)

    @precondition(lambda self: self.model.running)
    @rule()
    def cancel_job(self) -> None:
        """By the button of the status line, which is that of the job that began first."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("viewer.jobs.PATIENCE_S", -1.0)
            text, cancel = self.app.jobs.shown()
        assert text.startswith("Resimulating")
        assert cancel is not None
        cancel()
        self.model.drop(self.model.running[0])

    # --- history and files

    @rule(count=st.integers(1, 4))
    def undo(self, count: int) -> None:
        for _ in range(count):
            self.app.editor.undo()
            self.model.undo()

    @rule(count=st.integers(1, 4))
    def redo(self, count: int) -> None:
        for _ in range(count):
            self.app.editor.redo()
            self.model.at = min(self.model.at + 1, len(self.model.steps) - 1)

    @rule()
    def revert(self) -> None:
        self.app.sessions.revert()
        self.model.end_jobs()
        if self.app.editor.history.at != self.model.at:
            self.model.edit(**self.model.opened)

    def _name(self) -> Path:
        self.files += 1
        return self.folder / f"session {self.files}.sport"

    @rule()
    def save_as(self) -> None:
        path, before = self._name(), self.app.sessions.path
        model = self.model.copy()
        self.app.sessions.save_as(path)
        assert self.app.sessions.path == path
        if before is not None:
            self.kept[before] = model  # stays as it was

    @rule()
    def save_copy(self) -> None:
        path = self._name()
        self.app.sessions.save_copy(path)
        self.kept[path] = self.model.copy()

    @rule()
    def new(self) -> None:
        if self.app.sessions.path is not None:
            self.kept[self.app.sessions.path] = self.model.copy()
        kept = ("ground", "prompt", "blended", "weights", "locked", "shape")
        self.app.sessions.new()
        self.model.end_jobs()
        self.model = Model([{**shown(Session()), **{name: self.model.now[name] for name in kept}}])
        self.model.opened = self.model.now

    @precondition(lambda self: self.kept)
    @rule(place=st.integers(0, 9))
    def open(self, place: int) -> None:
        path = sorted(self.kept)[place % len(self.kept)]
        if self.app.sessions.path is not None:
            self.kept[self.app.sessions.path] = self.model.copy()
        self.app.sessions.open(path)
        run(self.app, 3)
        self.model = self.kept.pop(path)
        self.model.opened = self.model.now

    @rule()
    def close(self) -> None:
        """The program ends as planned, and the session is opened again: by its name, or among the earlier ones."""
        path = self.app.sessions.path
        self.model.end_jobs()
        empty = path is None and len(self.model.steps) == 1
        self.app.interrupt()
        assert self.app.end() == 0
        self.app.close()
        self.app = self._start()
        self.app.sessions.look()
        if path is None and not empty and self.model.now["takes"]:
            path = self.app.sessions.earlier[0].path
            assert len(self.model.now["takes"]) == self.app.sessions.earlier[0].takes
        if path is None:
            self.model = Model([shown(self.session)])
        else:
            self.app.sessions.open(path)
            run(self.app, 3)
        self.model.opened = self.model.now

    @rule(recording=st.booleans())
    def kill(self, recording: bool) -> None:
        """The process is gone once the last edit is on disk; what its file was then is opened again."""
        self.app.editor.finish_drag()
        if recording:
            self.app.takes.toggle_recording()
            run(self.app, 20)
        assert self.app.editor.file.flush(60.0)
        file, copy = self.app.editor.file.path, self._name()
        for ending in ("", "-wal", "-shm"):
            beside = file.with_name(file.name + ending)
            if beside.exists():
                shutil.copy(beside, copy.with_name(copy.name + ending))
        if self.app.sessions.path is not None and not recording:
            self.kept[self.app.sessions.path] = self.model.copy()
        self.app.close()
        self.app = self._start()
        self.model.end_jobs()
        empty = len(self.model.steps) == 1 and self.model.now == self.model.opened and not recording
        if empty:  # nothing was written yet
            self.model = Model([shown(self.session)])
        else:
            self.app.sessions.open(copy)
            run(self.app, 3)
        self.model = self.model.copy()
        if recording:
            made = shown(self.session)["takes"][-1]
            assert 20 - made[2] <= RECORDED_FRAMES
            self.model.edit(takes=[*self.model.now["takes"], made])
        self.model.opened = self.model.now


def run_machine(steps: int, number: int, examples: int) -> None:
    """Run so many steps in each of some sequences; AssertionError for a difference."""
    machine = seed(number)(type("Seeded", (SessionMachine,), {}))
    run_state_machine_as_test(
        machine,
        settings=settings(
            max_examples=examples, stateful_step_count=steps, deadline=None, database=None, derandomize=False,
            phases=[Phase.generate], suppress_health_check=list(HealthCheck), print_blob=False,
        ),
    )  # fmt: skip


def main() -> None:
    """The long run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    run_machine(100, options.seed, max(options.steps // 100, 1))
    print(f"{options.steps} steps, seed {options.seed}: no difference")


if __name__ == "__main__":
    main()
