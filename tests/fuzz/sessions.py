"""Targets that are sessions: the file with its rows, what takes were driven by, and the states of controllers in it."""

import io
import json
import random
import sqlite3
import zlib
from collections.abc import Callable
from contextlib import closing
from functools import cache
from pathlib import Path

import numpy as np

from runtime.motion.controller import Controller
from runtime.motion.snapshot import Snapshot
from runtime.session import edits
from runtime.session.document_reader import STRUCTURE_ERRORS
from runtime.session.history import History
from runtime.session.motion import Motion
from runtime.session.session import Session, Take
from runtime.session.session_file import SessionFile
from runtime.takes.clip import Clip
from runtime.takes.input_recording import InputRecording, resimulated_take
from runtime.terrain.height_map import Terrain
from tests.helpers.full_session import driven_take, full_session, history_of, snapshot_bytes, text_of, written
from tests.helpers.walker import WalkerModel

from .mutate import damaged_bytes, damaged_json
from .target import Target, put

MODE = slice(18, 20)  # of a database's head: 2 for a log of its own, which one in memory cannot have


@cache
def _session(folder: Path) -> bytes:
    session = full_session(folder / "cache", folder)
    history = history_of(session, edits.renamed(session, 1, "other"))
    return written(folder / "seed.sport", history, folder / "cache").read_bytes()


def _session_seeds(folder: Path) -> list[bytes]:
    return [_session(folder)]


@cache
def _short_session(folder: Path) -> bytes:
    session = edits.with_new_take(Session(), Take(motion=Motion.of(*driven_take(12))))
    return written(folder / "short.sport", history_of(session), folder / "cache").read_bytes()


def _short_session_seeds(folder: Path) -> list[bytes]:
    return [_short_session(folder)]


def _state_seeds(_folder: Path) -> list[bytes]:
    return [snapshot_bytes()]


# --- damage
def _in_rows(change: Callable[[random.Random, sqlite3.Connection], None]):
    """Damage to the rows of a database, whose pages are whole then; sometimes to all bytes."""

    def damage(rng: random.Random, data: bytes) -> bytes:
        if rng.random() < 0.2:
            return damaged_bytes(rng, data)
        plain, mode = bytearray(data), data[MODE]
        plain[MODE] = b"\1\1"
        with closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
            connection.deserialize(bytes(plain))
            connection.execute("PRAGMA ignore_check_constraints = ON")
            for _ in range(rng.choice((1, 1, 1, 3))):
                try:
                    change(rng, connection)
                except (sqlite3.Error, OverflowError, *STRUCTURE_ERRORS):
                    continue  # no value of a row, or no document any more
            made = bytearray(connection.serialize())
        made[MODE] = mode
        return bytes(made)

    return damage


def _texts(rng: random.Random, connection: sqlite3.Connection) -> None:
    """Another value in a text: of a step, a take, a motion, its input, a character or a name."""
    kind = rng.choice(("steps", "steps", "takes", "takes", "motions", "motions", "meta", "any"))
    if kind == "steps":
        _edit(rng, connection, "steps", "number", "document", damaged_json)
    elif kind == "takes":
        rows = connection.execute("SELECT key, content FROM blobs").fetchall()
        texts = [(key, zlib.decompress(content)) for key, content in rows]
        key, text = rng.choice([(key, text) for key, text in texts if text[:1] == b"{"])
        _put_blob(connection, key, damaged_json(rng, text))
    elif kind == "motions":
        _edit(rng, connection, "motions", "number", "header", damaged_json)
    elif kind == "meta":
        _edit(rng, connection, "meta", "name", "value", damaged_bytes)
    else:
        table, column = rng.choice(
            (("steps", "number"), ("steps", "label"), ("blobs", "size"), ("frames", "count"), ("frames", "number"),
             ("frames", "motion"), ("motions", "key"), ("blobs", "key"))
        )  # fmt: skip
        value = rng.choice((0, -1, 1, 299, 1 << 40, 2.5, None, "x", "../../x", b"\0", "\0", "9" * 5000))
        (count,) = connection.execute(f"SELECT count(*) FROM {table}").fetchone()
        place = f"(SELECT {column} FROM {table} LIMIT 1 OFFSET {rng.randrange(max(count, 1))})"
        connection.execute(f"UPDATE OR IGNORE {table} SET {column} = ? WHERE {column} = {place}", (value,))


def _values(rng: random.Random, connection: sqlite3.Connection) -> None:
    """Other bytes of as many in frames, sticks, states, styles and heights; sometimes in a text."""
    if rng.random() < 0.3:
        _texts(rng, connection)
        return
    table, key = rng.choice((("blobs", "key"), ("frames", "rowid")))
    rows = connection.execute(f"SELECT {key}, content FROM {table}").fetchall()
    at, content = rng.choice(rows)
    plain = zlib.decompress(content)
    made = _state(rng, plain) if plain[:2] == b"PK" else _flipped(rng, plain)
    values = (len(made), zlib.compress(made, 1), at)
    connection.execute(f"UPDATE {table} SET size = ?, content = ? WHERE {key} = ?", values)


def _edit(
    rng: random.Random, connection: sqlite3.Connection, table: str, key: str, column: str, damage
) -> None:
    at, value = rng.choice(connection.execute(f"SELECT {key}, {column} FROM {table}").fetchall())
    plain = value if isinstance(value, bytes) else value.encode()
    made = damage(rng, plain)
    text = made if isinstance(value, bytes) else made.decode("utf-8", "replace")
    connection.execute(f"UPDATE {table} SET {column} = ? WHERE {key} = ?", (text, at))


def _put_blob(connection: sqlite3.Connection, key: str, content: bytes) -> None:
    values = len(content), zlib.compress(content), key
    connection.execute("UPDATE blobs SET size = ?, content = ? WHERE key = ?", values)
    for number, document in connection.execute("SELECT number, document FROM steps").fetchall():
        parts = [part.split(" ") for part in json.loads(document)["takes"]]
        for part in parts:
            part[1] = str(len(content)) if part[2] == key else part[1]
        changed = json.loads(document) | {"takes": [" ".join(part) for part in parts]}
        connection.execute("UPDATE steps SET document = ? WHERE number = ?", (json.dumps(changed), number))


def _state(rng: random.Random, data: bytes) -> bytes:
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


def _flipped(rng: random.Random, data: bytes) -> bytes:
    """As many bytes, some of them others."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 4, 16)) if data else 0):
        changed[rng.randrange(len(changed))] = rng.choice((0, 1, 63, 127, 128, 191, 255))
    return bytes(changed)


# --- reading
def _opened(folder: Path, data: bytes) -> tuple[SessionFile, History]:
    for left in folder.glob("input.sport-*"):
        left.unlink()
    return SessionFile.open(put(folder, "input.sport", data), folder / "cache")


def _read_session(folder: Path, data: bytes) -> None:
    file, history = _opened(folder, data)
    try:
        session = history.present.session
        for step in history.steps:
            step.label.encode()
        for take in session.takes:
            take.title.encode()
            take.made.header.describe().encode()
            assert np.isfinite(take.made.clip.pose(0).positions).all()
            assert np.isfinite(take.clip.pose(take.range[0]).positions).all()
            inputs = take.made.inputs
            assert inputs is None or len(inputs.prompts()) >= 0
        path = file.character_path(session.character)
        assert path is None or path.is_relative_to(folder / "cache")
        json.dumps(file.view)
        copy = folder / "copy.sport"
        copy.unlink(missing_ok=True)
        file.save_copy(copy)
        again, found = SessionFile.open(copy, folder / "cache")  # what was read can be written
        assert text_of(found.present.session) == text_of(session)
        again.close()
    finally:
        file.close()


def _resimulate(folder: Path, data: bytes) -> None:
    """Takes of a damaged session are resimulated: twice the same bytes, and once more after they were saved."""
    file, history = _opened(folder, data)
    try:
        for take in history.present.session.takes[:1]:
            inputs = take.made.inputs
            if inputs is None:
                continue
            (first, made), (second, _) = (_driven(take.made.clip, inputs) for _ in range(2))
            assert first.local_rotations.tobytes() == second.local_rotations.tobytes()
            assert np.isfinite(first.pose(len(first) - 1).positions).all()
            third, _ = _driven(first, _kept(folder, first, made))
            assert third.local_rotations.tobytes() == first.local_rotations.tobytes()
            assert third.hips_positions.tobytes() == first.hips_positions.tobytes()
    finally:
        file.close()


def _kept(folder: Path, clip: Clip, inputs: InputRecording) -> InputRecording:
    """What drove a take, once it was in a file."""
    path = folder / "again.sport"
    path.unlink(missing_ok=True)
    session = edits.with_new_take(Session(), Take(motion=Motion.of(clip, inputs)))
    written(path, history_of(session), folder / "cache")
    file, history = SessionFile.open(path, folder / "cache")
    try:
        found = history.present.session.takes[0].made.inputs
        assert found is not None
        return found
    finally:
        file.close()


def _driven(clip: Clip, inputs: InputRecording) -> tuple[Clip, InputRecording]:
    return resimulated_take(clip, inputs, Controller(WalkerModel(), Terrain.flat(), seed=7), 0)


TARGETS = (
    Target("session", _session_seeds, _in_rows(_texts), _read_session, 0.5),
    Target("session resimulated", _short_session_seeds, _in_rows(_values), _resimulate, 0.2),
    Target("controller state", _state_seeds, damaged_bytes, lambda _, data: Snapshot.from_bytes(data)),
)
