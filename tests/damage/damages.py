"""Damages of one session, each drawn by a seed: wrong bits, pages, a cut, tables that are empty, swapped pieces."""

from __future__ import annotations

import random
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from runtime.errors import FileError
from runtime.session import edits
from runtime.session.motion import Motion
from runtime.session.session import Session, Take
from runtime.session.session_file import SessionFile
from runtime.session.sqlite_file import kept_aside
from runtime.session.tables import PAGE_BYTES, TABLES, checksum
from runtime.takes.clip import Clip
from tests.helpers.full_session import history_of, still, written

FRAMES = (700, 400, 90)  # of the takes: pieces of 300
NAMES = ("Läufer über Stock", "走る男", "take three")


def seed_session(folder: Path) -> Path:
    """A session of three takes with names, edits and a longer history."""
    session = Session()
    steps = []
    for frames, name in zip(FRAMES, NAMES, strict=True):
        motion = Motion.of(still(frames, f"motion of {frames}", frames))
        session = edits.with_new_take(session, Take(motion=motion, name=name, note=f"{name}!"))
        steps.append(session)
    steps.append(edits.trimmed(session, 2, 10, 300))
    steps += [replace(steps[-1], selected=number) for number in (1, 2, 3)]
    return written(folder / "seed.sport", history_of(*steps), folder / "cache")


# --- damages: each changes the bytes of a file
def wrong_bits(rng: random.Random, path: Path) -> None:
    data = bytearray(path.read_bytes())
    for _ in range(rng.choice((1, 1, 1, 1, 2, 8))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    path.write_bytes(data)


def page(rng: random.Random, path: Path) -> None:
    """A page of zeros, of ones, of noise, or of another place."""
    data = bytearray(path.read_bytes())
    at, other = (PAGE_BYTES * rng.randrange(len(data) // PAGE_BYTES) for _ in range(2))
    copied = bytes(data[other : other + PAGE_BYTES])
    content = (bytes(PAGE_BYTES), b"\xff" * PAGE_BYTES, rng.randbytes(PAGE_BYTES), copied)
    data[at : at + PAGE_BYTES] = rng.choice(content)
    path.write_bytes(data)


def swapped_pages(rng: random.Random, path: Path) -> None:
    data = bytearray(path.read_bytes())
    a, b = (PAGE_BYTES * n for n in rng.sample(range(len(data) // PAGE_BYTES), 2))
    data[a : a + PAGE_BYTES], data[b : b + PAGE_BYTES] = data[b : b + PAGE_BYTES], data[a : a + PAGE_BYTES]
    path.write_bytes(data)


def cut(rng: random.Random, path: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: rng.randrange(PAGE_BYTES, len(data))])


def sector(rng: random.Random, path: Path) -> None:
    """512 bytes of noise or zeros."""
    data = bytearray(path.read_bytes())
    at = 512 * rng.randrange(len(data) // 512)
    data[at : at + 512] = rng.choice((bytes(512), rng.randbytes(512)))
    path.write_bytes(data)


def _in_rows(
    change: Callable[[random.Random, sqlite3.Connection], None],
) -> Callable[[random.Random, Path], None]:
    def damage(rng: random.Random, path: Path) -> None:
        with closing(sqlite3.connect(path, isolation_level=None)) as connection:
            connection.execute("PRAGMA ignore_check_constraints = ON")
            change(rng, connection)
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    return damage


def _emptied(rng: random.Random, connection: sqlite3.Connection) -> None:
    connection.execute(f"DELETE FROM {rng.choice(['steps', 'steps', 'meta', 'motions', 'blobs', 'lost'])}")


def _without_a_row(rng: random.Random, connection: sqlite3.Connection) -> None:
    table = rng.choice(["steps", "meta", "motions", "blobs", "frames"])
    row = f"SELECT rowid FROM {table} ORDER BY random() LIMIT 1"
    connection.execute(f"DELETE FROM {table} WHERE rowid = ({row})")


def _swapped_pieces(rng: random.Random, connection: sqlite3.Connection) -> None:
    table = rng.choice(["frames", "blobs", "steps", "motions"])
    column = {"frames": "content", "blobs": "content", "steps": "document", "motions": "header"}[table]
    rows = connection.execute(f"SELECT rowid, {column} FROM {table}").fetchall()
    (a, first), (b, second) = rng.sample(rows, 2)
    connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (second, a))
    connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (first, b))


def _other_text(rng: random.Random, connection: sqlite3.Connection) -> None:
    places = "steps.label steps.document motions.header meta.value motions.key blobs.key"
    table, column = rng.choice(places.split(" ")).split(".")
    rows = connection.execute(f"SELECT rowid, {column} FROM {table}").fetchall()
    number, text = rng.choice([row for row in rows if isinstance(row[1], str) and row[1]])
    at = rng.randrange(len(text))
    text = text[:at] + chr(rng.randrange(97, 123)) + text[at + 1 :]
    connection.execute(f"UPDATE OR IGNORE {table} SET {column} = ? WHERE rowid = ?", (text, number))


DAMAGES: dict[str, Callable[[random.Random, Path], None]] = {
    "wrong bits": wrong_bits,
    "a page": page,
    "swapped pages": swapped_pages,
    "a cut": cut,
    "a sector": sector,
    "an empty table": _in_rows(_emptied),
    "a row is missing": _in_rows(_without_a_row),
    "swapped pieces": _in_rows(_swapped_pieces),
    "another text": _in_rows(_other_text),
}


# --- what must hold
@dataclass
class Known:
    """What the seed holds: clips by their keys, and all texts."""

    clips: dict[str, Clip]
    texts: set[str]

    @staticmethod
    def of(path: Path) -> Known:
        file, history = SessionFile.open(path, path.parent / "cache")
        clips = {take.made.key: take.made.clip for take in history.present.session.takes}
        steps = [step for step in history.steps]
        texts = {text for step in steps for text in _texts(step.label, step.session)}
        file.close()
        return Known(clips, texts)


def _texts(label: str, session: Session) -> set[str]:
    takes = [(t.name, t.note, t.made.header.name, t.made.header.terrain) for t in session.takes]
    return {label, *(text for take in takes for text in take)}


def pieces_left(path: Path) -> dict[tuple[str, int], int]:
    """Pieces whose rows SQLite still reads and whose checksums fit: motion and first frame, count."""
    found = {}
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True)) as connection:
            connection.text_factory = bytes
            for motion, *rest in connection.execute("SELECT * FROM frames"):
                row = (motion.decode("utf-8", "replace") if isinstance(motion, bytes) else motion, *rest[:-1])
                if all(isinstance(v, int | str | bytes) for v in row) and checksum("frames", row) == rest[-1]:
                    found[row[0], row[1]] = row[2]
    except (sqlite3.Error, UnicodeDecodeError):
        pass  # then more than SQLite finds is a gain
    return found


def check(path: Path, known: Known) -> str:
    """What went wrong with a damaged session when it was opened; "" for nothing."""
    before, pieces = path.read_bytes(), pieces_left(path)
    wanted = {key for key, _ in pieces}
    try:
        file, history = SessionFile.open(path, path.parent / "cache")
    except FileError as error:
        lost = f"refused with {len(pieces)} pieces: {error}" if pieces else ""
        return lost or ("" if path.read_bytes() == before else "refused, and the file is another one")
    try:
        takes = {take.made.key: take for step in history.steps for take in step.session.takes}
        problem = _compared(takes, pieces, wanted, known)
        allowed = known.texts | {"Recovered take", "flat", ""}
        for step in history.steps:
            for text in _texts(step.label, step.session) - allowed:
                problem = problem if text.startswith("recovery of ") else f"another text {text!r}"
        present = {take.made.key for take in history.present.session.takes}
        listed = {take.made.key for s in history.steps for take in s.session.takes}
        if not problem and not wanted <= present | listed:
            problem = "a take is not in the list"
        if file.database.repaired and not any(f.read_bytes() == before for f in kept_aside(path)):
            problem = problem or "the damaged file is not kept"
        return problem
    finally:
        file.close()


def _compared(
    takes: dict[str, Take], pieces: dict[tuple[str, int], int], wanted: set[str], known: Known
) -> str:
    for key in wanted & known.clips.keys():
        if key not in takes:
            return f"a take of {len(known.clips[key])} frames is lost"
        clip = takes[key].made.clip
        for (motion, first), count in pieces.items():
            if motion == key:
                had = clip.hips_positions[first : first + count], clip.local_rotations[first : first + count]
                seed, part = known.clips[key], slice(first, first + count)
                same = seed.hips_positions[part], seed.local_rotations[part]
                if not all(np.array_equal(a, b) for a, b in zip(had, same, strict=True)):
                    return f"frames from {first} on are others"
    return ""


assert TABLES
