"""Sessions of many frames, pieces, steps and rows: `python -m tests.damage.sizes` prints what opening and playing each costs."""

import argparse
import json
import sqlite3
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from runtime.session import edits
from runtime.session.frames import PACKED_FRAME_BYTES
from runtime.session.motion import Motion
from runtime.session.session import Session, Take
from runtime.session.sqlite_file import unwritten_files
from runtime.session.tables import sealed
from runtime.skeleton import REST_HIPS_HEIGHT, J
from runtime.takes.clip import Clip
from runtime.takes.pins import Pin, Pinned
from runtime.takes.pose_edits import PoseEdits
from runtime.takes.pose_layer import JointValue, PoseKey, PoseLayer
from tests.helpers.full_session import history_of, reseal, still, written

HOUR = 216_000  # frames
LAYER = PoseLayer(
    (PoseKey(0.25, (JointValue(16, 0.0, 0.5, 0.0), JointValue(0, 0.0, 0.2, 0.0)), (JointValue(0, 0.0, -0.25, 0.0),)),),
    keeps=True,
)  # fmt: skip


def walk(frames: int, seed: int = 0) -> Clip:
    """Frames that compress as those of a walk: joints swing, with the noise of a recording."""
    rng = np.random.default_rng(seed)
    at = np.arange(frames) / 60.0
    half = 0.3 * np.sin(2.0 * np.pi * at[:, None] * rng.uniform(0.5, 1.5, J) + rng.uniform(0.0, 6.0, J))
    turns = np.zeros((frames, J, 4), np.float32)
    half += rng.normal(0.0, 2e-4, half.shape)
    turns[..., 0], turns[..., 1] = np.cos(half), np.sin(half)
    hips = np.column_stack([np.zeros(frames), np.full(frames, REST_HIPS_HEIGHT), 1.3 * at]).astype(np.float32)
    contacts, gaits = np.ones((frames, 4), np.float32), np.zeros(frames, np.int8)
    return Clip(f"walk {seed}", 60.0, hips, turns, contacts, gaits=gaits)


def session_of(path: Path, *clips: Clip, poses: PoseEdits | None = None) -> Path:
    """A file of one take for each clip."""
    session = Session()
    for clip in clips:
        take = Take(motion=Motion.of(clip))
        session = edits.with_new_take(session, take if poses is None else replace(take, poses=poses))
    return written(path, history_of(session), path.parent / "cache")


def hour(path: Path, poses: PoseEdits | None = None) -> Path:
    return session_of(path, walk(HOUR), poses=poses)


def large(path: Path) -> Path:
    """About 100 MB: twelve takes of half an hour."""
    return session_of(path, *(walk(HOUR // 2, seed) for seed in range(12)))


def zeros(path: Path, frames: int = 200_000, piece: int = 300) -> Path:
    """Frames that fold to nothing, and a pose layer over all of them."""
    session_of(path, still(3), poses=PoseEdits(layer=LAYER))
    _change(path, lambda connection: _zeros(connection, frames, piece))
    return path


def _zeros(connection: sqlite3.Connection, frames: int, piece: int) -> None:
    key, header = connection.execute("SELECT key, header FROM motions").fetchone()
    connection.execute("DELETE FROM frames")
    longer = json.dumps(json.loads(header) | {"frames": frames})
    connection.execute("UPDATE motions SET header = ?", (longer,))
    packed = {n: zlib.compress(bytes(PACKED_FRAME_BYTES * n)) for n in {piece, frames % piece or piece}}
    for first in range(0, frames, piece):
        count = min(piece, frames - first)
        row = (key, first, count, PACKED_FRAME_BYTES * count, packed[count])
        connection.execute("INSERT INTO frames VALUES (?, ?, ?, ?, ?, 0)", row)


def one_frame_pieces(path: Path) -> Path:
    return zeros(path, piece=1)


def many_steps(path: Path, count: int = 20_000) -> Path:
    """One document under many numbers."""
    session_of(path, still(30))
    _change(path, lambda connection: connection.executemany(
        "INSERT INTO steps SELECT ?, label, document, 0 FROM steps WHERE number = 1", ((n,) for n in range(2, count))
    ))  # fmt: skip
    return path


def heavy_steps(path: Path) -> Path:
    """Steps whose documents are as large as a text may be, and are none."""
    session_of(path, still(30))
    text = json.dumps({"takes": [[0] * 1000] * 390, "x": "y" * (8 << 20)})
    _change(path, lambda connection: connection.executemany(
        "INSERT INTO steps VALUES (?, 'x', ?, 0)", ((n, text) for n in range(2, 12))
    ))  # fmt: skip
    return path


def unused_rows(path: Path, count: int = 900_000) -> Path:
    session_of(path, still(30))
    _change(path, lambda connection: connection.executemany(
        "INSERT INTO blobs VALUES (?, 0, ?, 0)", ((f"{n:032x}", zlib.compress(b"")) for n in range(count))
    ))  # fmt: skip
    return path


def full_rows(path: Path) -> Path:
    """As many rows as a table may have."""
    return unused_rows(path, 90_000)


def unwritten_steps(path: Path, count: int = 1_500_000) -> Path:
    """Changes without end next to the session."""
    session_of(path, still(30))
    text = json.dumps([["put_step", [n, "x", "{}"], {}] for n in range(count)])
    unwritten_files(path)[0].write_bytes(zlib.compress(text.encode("ascii"), 1))
    return path


def many_takes(path: Path) -> Path:
    """Takes without number that share one motion."""
    session_of(path, still(30))

    def change(connection: sqlite3.Connection) -> None:
        (text,) = connection.execute("SELECT document FROM steps WHERE number = 1").fetchone()
        value = json.loads(text)
        value["takes"] *= 9999
        connection.execute("UPDATE steps SET document = ?", (json.dumps(value),))

    _change(path, change)
    return path


def unnamed_motions(path: Path, count: int = 60_000) -> Path:
    """Motions of two frames that no step names."""
    session_of(path, still(30))

    def change(connection: sqlite3.Connection) -> None:
        (header,) = connection.execute("SELECT header FROM motions").fetchone()
        frames = zlib.compress(bytes(2 * PACKED_FRAME_BYTES))
        for n in range(count):
            row = sealed("motions", (n + 5, f"{n:032x}", header))
            connection.execute("INSERT INTO motions VALUES (?, ?, ?, ?)", row)
            row = (f"{n:032x}", 2 * PACKED_FRAME_BYTES, frames)
            connection.execute("INSERT INTO frames VALUES (?, 0, 2, ?, ?, 0)", row)

    _change(path, change)
    return path


def _change(path: Path, change: Callable[[sqlite3.Connection], object]) -> None:
    with closing(sqlite3.connect(path)) as connection, connection:
        change(connection)
    reseal(path)


PINNED = PoseEdits(pins=(Pin(Pinned.LEFT_HAND, (0.25, 1.0, 0.5), 0.5, 3600.0),), layer=LAYER)
# honest ones first
SIZES: dict[str, Callable[[Path], Path]] = {
    "an hour": hour,
    "an hour with a pose layer": lambda path: hour(path, PoseEdits(layer=LAYER)),
    "an hour with a layer and a pin": lambda path: hour(path, PINNED),
    "six hours, 100 MB": large,
    "200,000 zero frames and a layer": zeros,
    "two million zero frames": lambda path: zeros(path, 1_999_999),
    "200,000 pieces of one frame": one_frame_pieces,
    "20,000 steps": many_steps,
    "steps of 8 MB": heavy_steps,
    "900,000 unused rows": unused_rows,
    "90,000 unused rows": full_rows,
    "1,500,000 unwritten steps": unwritten_steps,
    "9,999 takes": many_takes,
    "60,000 unnamed motions": unnamed_motions,
}


def main() -> int:
    """Make each session and open it, alone and in the application, in processes of their own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="sessions whose name holds this")
    parser.add_argument("--make", nargs=2, metavar=("NAME", "FILE"), help="make one and end")
    options = parser.parse_args()
    if options.make:
        SIZES[options.make[0]](Path(options.make[1]))
        return 0
    print(
        "session | MB | open (s) | play (s) | CPU (s) | MB | the window answers (s) | plays (s) | longest frame (s) | CPU (s) | MB | said"
    )
    for name in (name for name in SIZES if options.only in name):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.sport"
            python = [sys.executable, "-m"]
            subprocess.run([*python, "tests.damage.sizes", "--make", name, str(path)], check=True)
            size_mb = sum(file.stat().st_size for file in Path(folder).glob("*")) / (1 << 20)
            opening = [*python, "tests.damage.opening", str(path)]
            alone, window = (
                subprocess.run(command, check=False, capture_output=True, text=True)
                for command in (opening, [*opening, "--window"])
            )
            cells = [name, f"{size_mb:.1f}"]
            for done in (alone, window):
                *numbers, said = (done.stdout.rstrip("\n") or done.stderr[-300:]).split(" | ")
                cells += numbers
            print(" | ".join([*cells, said]), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
