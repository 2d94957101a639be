"""Cost of saving a session with an hour of takes: `python -m benchmarks.sessions`."""

import statistics
import time
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.timing import cpu_name, times_ms
from runtime.atomic import temporary_folder
from runtime.pose import FPS
from runtime.session import edits
from runtime.session.history import History
from runtime.session.motion import Motion, MotionHeader
from runtime.session.session import Session, Take
from runtime.session.session_file import SessionFile
from runtime.skeleton import REST_HIPS_HEIGHT, J
from runtime.takes.clip import Clip

TAKES, MINUTES, EDITS = 20, 3, 50
RECORDED_S, PIECE = 60, 15  # length of a recording, and frames written together


def main() -> None:
    """Measure and print all times."""
    with temporary_folder() as folder:
        home = folder
        file, history = SessionFile.create(home / "hour.sport", home / "characters"), History()
        random = np.random.default_rng(1)
        for number in range(TAKES):
            take = Take(motion=Motion.of(_walk(f"Take {number + 1}", random)))
            _do(history, file, edits.with_new_take(history.present.session, take))
        written = times_ms(file.flush, 1)[0]
        print(f"{cpu_name()}; {TAKES} takes of {MINUTES} minutes, written in {written / 1e3:.2f} s")
        times = []
        for first in range(EDITS):
            times += times_ms(partial(_trim, history, file, first), 1)
            time.sleep(0.02)
        middle, worst = statistics.median(times), max(times)
        print(f"an edit, on the thread of the frame: {middle:.2f} ms, worst {worst:.2f} ms")
        print(f"a quarter of a second of a recording, on that thread: worst {_record(file, random):.2f} ms")
        file.close()
        size = (home / "hour.sport").stat().st_size
        begin = time.perf_counter()
        again, opened = SessionFile.open(home / "hour.sport", home / "characters")
        print(f"opened in {time.perf_counter() - begin:.2f} s, {size / 1e6:.0f} MB")
        begin = time.perf_counter()
        frames = len(opened.present.session.takes[3].clip)
        print(f"the {frames} frames of a take read in {time.perf_counter() - begin:.2f} s")
        again.close()


def _do(history: History, file: SessionFile, session: Session) -> None:
    history.push("edit", session)
    file.write(history)


def _trim(history: History, file: SessionFile, first: int) -> None:
    _do(history, file, edits.trimmed(history.present.session, 5, first, 1000))


def _walk(name: str, random: np.random.Generator) -> Clip:
    """Return frames of swinging joints, which compress like a walk."""
    count = MINUTES * 60 * FPS
    at = np.arange(count) / FPS
    half = 0.3 * np.sin(2.0 * np.pi * at[:, None] * random.uniform(0.5, 1.5, J) + random.uniform(0.0, 6.0, J))
    turns = np.zeros((count, J, 4), np.float32)
    turns[..., 0], turns[..., 1] = np.cos(half), np.sin(half)
    hips = np.column_stack([np.zeros(count), np.full(count, REST_HIPS_HEIGHT), 1.3 * at]).astype(np.float32)
    return Clip(name, FPS, hips, turns, np.ones((count, 4), np.float32), gaits=np.zeros(count, np.int8))


def _record(file: SessionFile, random: np.random.Generator) -> float:
    """Return the longest time (ms) for which a piece of a recording occupies the calling thread."""
    clip, times = _walk("recorded", random), []
    recording = file.begin_recording(replace(MotionHeader.of(clip, None), frames=0))
    turns = clip.local_rotations.reshape(len(clip), -1)
    columns = [clip.hips_positions, turns, clip.contacts, np.zeros(len(clip))]
    rows = np.column_stack(columns).astype(np.float32)
    for first in range(0, RECORDED_S * FPS, PIECE):
        times += times_ms(partial(recording.add, rows[first : first + PIECE], None), 1)
        time.sleep(0.01)
    return max(times)


if __name__ == "__main__":
    main()
