"""A damaged session gives back every take that can be had, and changes no text: a share of `python -m tests.damage`."""

import json
import random
import sqlite3
import zlib
from contextlib import closing
from pathlib import Path

import pytest

from runtime.session import session_file
from runtime.session.document import header_text
from runtime.session.frames import PACKED_FRAME_BYTES
from runtime.session.motion import MotionHeader
from runtime.session.recovery import fill_gaps
from runtime.session.session_file import SessionFile
from runtime.session.sqlite_file import in_memory
from runtime.session.tables import put_rows, sealed
from tests.damage.damages import DAMAGES, FRAMES, Known, check, seed_session
from tests.damage.damages import NAMES as NAMES_OF_SEED
from tests.damage.ends import DONE, KINDS, offered
from tests.damage.names import NAMES, lost


@pytest.fixture(scope="module")
def seed(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, Known]:
    """A session's file, and what it holds."""
    path = seed_session(tmp_path_factory.mktemp("seed"))
    return path.read_bytes(), Known.of(path)


@pytest.mark.parametrize("kind", DAMAGES)
def test_takes_that_can_be_had_are_had(kind: str, seed: tuple[bytes, Known], tmp_path: Path) -> None:
    content, known = seed
    for number in range(4):
        path = tmp_path / f"{number}.sport"
        path.write_bytes(content)
        DAMAGES[kind](random.Random(number), path)
        assert check(path, known) == "", number


def test_a_wrong_bit_of_a_row_is_turned_back(seed: tuple[bytes, Known], tmp_path: Path) -> None:
    content, known = seed
    at = content.index(b'"name": "motion of 400"') + 12
    data = bytearray(content)
    data[at] ^= 4
    (tmp_path / "a.sport").write_bytes(data)
    file, history = SessionFile.open(tmp_path / "a.sport", tmp_path)
    assert "damaged" in file.repaired
    assert [len(take.made.clip) for take in history.present.session.takes] == list(FRAMES)
    assert {take.made.header.name for take in history.present.session.takes} <= known.texts
    assert len(history.steps) == 8
    file.close()


@pytest.mark.parametrize("table", ["steps", "blobs"])
def test_without_steps_or_texts_every_motion_is_a_take(
    table: str, seed: tuple[bytes, Known], tmp_path: Path
) -> None:

    (tmp_path / "a.sport").write_bytes(seed[0])
    with closing(sqlite3.connect(tmp_path / "a.sport")) as connection, connection:
        connection.execute(f"DELETE FROM {table}")
    for _ in range(3):
        file, history = SessionFile.open(tmp_path / "a.sport", tmp_path)
        takes = history.present.session.takes
        assert [take.frames for take in takes] == list(FRAMES)
        if table == "steps":  # their names and notes are in texts of their own
            assert [take.note for take in takes] == ["Läufer über Stock!", "走る男!", "take three!"]
        assert all(len(take.made.clip) == take.frames for take in takes)
        assert file.close()


def test_what_is_too_much_to_recover_at_once_can_be_had_from_the_lost_takes(
    seed: tuple[bytes, Known], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_file, "MAX_RECOVERED_TAKES", 1)
    (tmp_path / "a.sport").write_bytes(seed[0])
    with closing(sqlite3.connect(tmp_path / "a.sport")) as connection, connection:
        connection.execute("DELETE FROM steps")
    file, history = SessionFile.open(tmp_path / "a.sport", tmp_path)
    assert file.flush(20.0)
    assert (file.recovered, file.unrecovered) == (1, 2)
    assert [take.frames for take in history.present.session.takes] == [FRAMES[-1]]
    found = file.found_takes(file.lost_takes)
    wanted = set(zip(FRAMES[:2], NAMES_OF_SEED[:2], strict=True))
    assert {(take.frames, take.name) for take in found} == wanted
    file.close()


def test_every_motion_of_a_long_session_is_mended() -> None:
    count = 6000
    with closing(in_memory()) as connection:
        text = header_text(MotionHeader("take", 60.0, 30))
        frames = zlib.compress(bytes(2 * PACKED_FRAME_BYTES))
        for number in range(count):
            key = f"{number:032x}"
            put_rows(connection, "motions", [sealed("motions", (number, key, text))])
            put_rows(connection, "frames", [sealed("frames", (key, 0, 2, 2 * PACKED_FRAME_BYTES, frames))])
        assert fill_gaps(connection) == (count, 0)
        headers = [json.loads(header) for (header,) in connection.execute("SELECT header FROM motions")]
    assert {header["frames"] for header in headers} == {2}


@pytest.mark.parametrize(("done", "end"), KINDS)
def test_the_next_start_offers_what_holds_work(done: str, end: str, tmp_path: Path) -> None:
    assert offered(done, end, tmp_path) is DONE[done][1]


@pytest.mark.parametrize("name", NAMES[::8])
def test_what_has_a_name_of_any_script_is_there_after_every_opening(name: str, tmp_path: Path) -> None:
    assert lost(name, tmp_path, 2) == ""
