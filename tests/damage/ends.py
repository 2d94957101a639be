"""Ways in which a session ends, and whether the next start offers it: `python -m tests.damage.ends` prints each."""

import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from runtime.motion.control_scripts import Waypoint
from runtime.session import edits, library
from runtime.session.history import History
from runtime.session.motion import Motion, MotionHeader
from runtime.session.recording import FRAME_NUMBERS
from runtime.session.session import Session, Take, Variant
from runtime.session.session_file import SessionFile
from runtime.session.sqlite_file import side_files
from runtime.takes.camera_keys import CameraKey
from runtime.takes.pins import Pin, Pinned
from runtime.takes.pose_edits import PoseEdits
from tests.helpers.full_session import still


@dataclass
class Run:
    """A run of the program with an untitled session."""

    file: SessionFile
    history: History

    def do(self, label: str, session: Session) -> None:
        self.history.push(label, session)
        self.file.write(self.history)

    def go(self, by: int) -> None:
        self.history.go(by)
        self.file.write(self.history)

    @property
    def session(self) -> Session:
        return self.history.present.session

    def take(self, frames: int = 30) -> None:
        self.do("take", edits.with_new_take(self.session, Take(motion=Motion.of(still(frames, "take")))))

    def live(self, **values: object) -> None:
        self.do("live", self.session.with_take(0, **values))


def _record(run: Run, frames: int = 270) -> None:
    recording = run.file.begin_recording(MotionHeader("Take 1", 60.0, 0, has_gaits=True))
    clip = still(frames, "x")
    table = np.zeros((frames, FRAME_NUMBERS), np.float32)
    table[:, :3], table[:, -5:-1] = clip.hips_positions, clip.contacts
    table[:, 3:-5] = clip.local_rotations.reshape(frames, -1)
    for at in range(0, frames, 10):
        recording.add(table[at : at + 10], None)


def _undone(run: Run) -> None:
    run.take()
    run.take()
    run.go(-1)
    run.go(-1)


def _removed(run: Run) -> None:
    run.take()
    run.do("removal", edits.without_take(run.session, 1))


def _reverted(run: Run) -> None:
    run.take()
    run.do("revert", Session())


def _long_ago(run: Run) -> None:
    """The take leaves the history."""
    _removed(run)
    for number in range(210):
        run.do("edit", replace(run.session, counter=number + 5))


def _mixed(run: Run) -> None:
    _undone(run)
    _record(run)


# what was done in the run; whether it holds work
DONE: dict[str, tuple[Callable[[Run], None], bool]] = {
    "nothing": (lambda run: run.file.write(run.history), False),
    "a prompt only": (lambda run: run.do("seed", replace(run.session, counter=0, selected=0, model=replace(run.session.model, seed=3))), False),
    "a take": (Run.take, True),
    "a take that was undone": (_undone, True),
    "a take that was removed": (_removed, True),
    "a take that was reverted": (_reverted, True),
    "a take that left the history": (_long_ago, True),
    "a first recording": (_record, True),
    "a recording after undone takes": (_mixed, True),
    "a path": (lambda run: run.live(path=(Waypoint(0.0, 0.0), Waypoint(1.0, 2.0))), True),
    "camera keys": (lambda run: run.live(cameras=(CameraKey(0.0, 0.5, 0.25, 4.0),)), True),
    "pins": (lambda run: run.live(poses=PoseEdits((Pin(Pinned.LEFT_HAND, (0.2, 1.0, 0.5), 0.5, 1.0),))), True),
    "variants": (lambda run: run.do("variant", replace(run.session, variants=(Variant(1, run.session.live.prompt),))), True),
}  # fmt: skip


def closed(file: SessionFile) -> None:
    """As planned."""
    file.write_view({"name": "Untitled"}, ended=True)
    assert file.close()


def killed(file: SessionFile) -> None:
    """With what was on disk, log included, and the lock that no process holds."""
    assert file.flush(20.0)
    path = file.path
    files = [each for each in (path, side_files(path)[0]) if each.exists()]
    kept = [(each, each.with_name(f"{each.name}.kept")) for each in files]
    for each, copy in kept:
        shutil.copyfile(each, copy)
    file.close()
    for each, copy in kept:
        os.replace(copy, each)


def cut(file: SessionFile) -> None:
    """Killed, and the machine lost power: the last page of the file is gone."""
    file.close()
    with file.path.open("r+b") as opened:
        opened.truncate(file.path.stat().st_size - 100)


ENDS: dict[str, Callable[[SessionFile], None]] = {"closed": closed, "killed": killed, "cut short": cut}
KINDS = [*((done, end) for done in DONE for end in ("closed", "killed"))]
KINDS += [("a take", "cut short"), ("a first recording", "cut short")]


def offered(done: str, end: str, folder: Path, empty_runs: int = 11) -> bool:
    """Whether a start offers a session after many later runs that hold little, and after the next start."""
    run = Run(SessionFile.create(library.new_path(folder), folder), History())
    run.file.write(run.history)
    DONE[done][0](run)
    path = run.file.path
    ENDS[end](run.file)
    first = path in [summary.path for summary in library.keep_newest(folder, 10)]
    for _ in range(empty_runs):
        later = Run(SessionFile.create(library.new_path(folder), folder), History())
        DONE["a path"][0](later)
        closed(later.file)
    library.keep_newest(folder, 10)
    left = {summary.path for summary in library.keep_newest(folder, 10)}
    has_motions = done.startswith(("a take", "a first recording", "a recording"))
    return first and (path in left or not has_motions)


def main() -> int:
    """Try each end and print whether what holds work is offered."""
    wrong = 0
    for done, end in KINDS:
        with tempfile.TemporaryDirectory() as folder:
            found = offered(done, end, Path(folder))
        right = found is DONE[done][1]
        wrong += not right
        said = f"{'offered' if found else 'not offered'}{'' if right else ', wrong'}"
        print(f"{done}, {end}: {said}", flush=True)
    print(f"{len(KINDS)} kinds of ends, {wrong} wrong")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
