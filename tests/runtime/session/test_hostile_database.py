"""Session files from elsewhere: refused in one sentence or read, soon, without running anything that stands in them."""

import os
import random
import shutil
import sqlite3
import time
import zlib
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from runtime.errors import FileError
from runtime.session.database import Database
from runtime.session.sqlite_file import kept_aside, lock_of, side_files
from runtime.session.stored_rows import Writer
from runtime.session.tables import SCHEMA_VERSION, TABLES, create, version_of
from tests.helpers.counting import bounded
from tests.helpers.full_session import packed_zeros, reseal
from tests.runtime.session.test_database import content


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A session as this program writes it."""
    session = Database.create(tmp_path / "folder" / "a.sport")

    def work(writer: Writer) -> None:
        for number in range(3):
            writer.put_step(number, f"step {number}", "{}" * 3000)
            writer.put_blob(f"b{number}", os.urandom(3000))
            writer.put_motion(f"m{number}", '{"frames": 75}')
            for piece in range(5):
                writer.put_frames(f"m{number}", 15 * piece, 15, os.urandom(2000))
        writer.set_meta("name", "walk")

    session.submit(work)
    assert session.close()
    return session.path


def refused(path: Path, match: str = "") -> str:
    """What opening says, and reading as well; the file stays as it was, and nothing lies next to it."""
    before = path.read_bytes()
    said = ""
    for use in (Database.open, Database.read):
        with bounded(), pytest.raises(FileError, match=match) as caught:
            use(path)
        said = str(caught.value)
        assert str(path) in said
        assert "\n" not in said
    assert path.read_bytes() == before
    assert not lock_of(path).exists()
    return said


def opened(path: Path, use: Callable[[Database], object], match: str) -> None:
    """It can be opened, but not what `use` wants of it; nor does that cost much."""
    for how in (Database.open, Database.read):
        database = how(path)
        try:
            with bounded(), pytest.raises(FileError, match=match):
                use(database)
        finally:
            database.close()


def salvaged(path: Path, wanted: dict[str, object]) -> None:
    """It opens with rows that are those of `wanted`, without anything else of it; the file itself is kept aside."""
    before = path.read_bytes()
    with pytest.raises(FileError, match=path.name):
        Database.read(path)
    with bounded():
        database = Database.open(path)
    assert content(database) == wanted
    assert "It was damaged" in database.repaired
    (aside,) = kept_aside(path)
    assert aside.read_bytes() == before
    assert kept_aside(path, 1.0) == []
    assert database.close()
    again = Database.open(path)
    assert (again.repaired, content(again)) == ("", wanted)
    assert again.close()


def change(path: Path, *statements: str, values: tuple[object, ...] = (), sealed: bool = True) -> None:
    """Change a file as any program can; `sealed`: with checksums that fit."""
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA ignore_check_constraints = ON")
    connection.execute("PRAGMA writable_schema = ON")
    for statement in statements:
        connection.execute(statement, values if "?" in statement else ())
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.close()
    if sealed:
        reseal(path)


# --- no session
@pytest.mark.parametrize(
    "data",
    [b"", b"x", b"SQLite format 3\0", b"PK\5\6" + bytes(18), random.Random(1).randbytes(9000), b"\0" * 8192],
)
def test_what_is_no_database(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.sport").write_bytes(data)
    refused(tmp_path / "a.sport", "not a session|damaged")


@pytest.fixture
def rows(path: Path) -> dict[str, object]:
    """All that can be read of the session."""
    database = Database.read(path)
    found = content(database)
    database.close()
    return found


@pytest.mark.parametrize("name", ["application_id", "user_version"])
def test_a_wrong_number_in_the_head_costs_nothing(name: str, path: Path, rows: dict[str, object]) -> None:
    change(path, f"PRAGMA {name} = 7")
    salvaged(path, rows)


def test_a_later_version_is_refused_with_the_advice_to_update(path: Path) -> None:
    sums = [f"UPDATE {table} SET checksum = 5" for table in TABLES]
    change(path, "PRAGMA user_version = 7", *sums, sealed=False)
    assert refused(path, "a later version of this program").endswith("Update this program.")


def test_a_session_of_the_first_version_gets_its_checksums(tmp_path: Path) -> None:
    connection = sqlite3.connect(tmp_path / "old.sport", isolation_level=None)
    create(connection, 1)
    connection.execute("INSERT INTO steps VALUES (3, 'über', '{}')")
    connection.execute("INSERT INTO motions VALUES (1, 'm', '{\"frames\": 15}')")
    connection.execute("INSERT INTO frames VALUES ('m', 0, 15, 5, ?)", (zlib.compress(b"poses"),))
    connection.close()
    for use in (Database.read, Database.open):
        database = use(tmp_path / "old.sport")
        motions = {"m": ('{"frames": 15}', [(15, b"poses")])}
        assert content(database) == {"steps": {3: ("über", "{}")}, "motions": motions}
        database.close()
    with closing(sqlite3.connect(tmp_path / "old.sport")) as connection:
        assert version_of(connection) == SCHEMA_VERSION


SCHEMAS = {
    "trigger": "CREATE TRIGGER t AFTER INSERT ON steps BEGIN DELETE FROM steps; END",
    "view": "CREATE VIEW v AS SELECT 1",
    "endless view": "CREATE VIEW v AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x FROM c",
    "view for a table": "UPDATE sqlite_master SET type = 'view', rootpage = 0, sql = 'CREATE VIEW steps AS WITH RECURSIVE "
    "c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x AS number, 1 AS label, 1 AS document FROM c' WHERE name = 'steps'",
    "table": "CREATE TABLE other (x)",
    "index": "CREATE INDEX i ON steps (hex(label))",
    "virtual table": "CREATE VIRTUAL TABLE v USING fts5(x)",
    "generated column": "ALTER TABLE steps ADD COLUMN g AS (randomblob(100000000))",
    "no check": "UPDATE sqlite_master SET sql = 'CREATE TABLE steps (number INTEGER PRIMARY KEY, label, document)' WHERE name = 'steps'",
    "no SQL": "UPDATE sqlite_master SET sql = 'CREATE nonsense' WHERE name = 'steps'",
    "one table twice": "UPDATE sqlite_master SET rootpage = (SELECT rootpage FROM sqlite_master WHERE name = 'blobs') WHERE name = 'frames'",
    "statistics": "ANALYZE",
}


@pytest.mark.parametrize("kind", SCHEMAS)
def test_of_a_file_with_other_tables_only_our_rows_are_used(
    kind: str, path: Path, rows: dict[str, object]
) -> None:
    try:
        change(path, SCHEMAS[kind], sealed=False)
    except sqlite3.OperationalError as error:
        pytest.skip(f"this SQLite cannot: {error}")
    if kind == "one table twice":
        motions = rows["motions"]
        rows["motions"] = {key: (header, motions[key][1]) for key, (header, _) in motions.items()}
    salvaged(path, rows)


# --- values
def test_values_of_another_type(path: Path) -> None:
    for statement in (
        "UPDATE blobs SET content = 'text'",
        "UPDATE blobs SET size = -1",
        "UPDATE blobs SET size = 'many'",
        "UPDATE frames SET count = 1e300",
        "UPDATE frames SET number = x'00' WHERE number = 45",
        "UPDATE steps SET document = x'00'",
        "UPDATE meta SET value = 3",
        "UPDATE motions SET header = zeroblob(5)",
    ):
        other = path.with_name("other.sport")
        shutil.copyfile(path, other)
        change(other, statement)
        with pytest.raises(FileError, match="of another type or too large"):
            Database.read(other)
        database = Database.open(other)
        assert "It was damaged" in database.repaired
        assert database.close()


def test_text_that_is_none(path: Path) -> None:
    text = "CAST(x'80ff' AS TEXT), document = CAST(x'6100ed' AS TEXT)"
    change(path, f"UPDATE steps SET label = {text}", sealed=False)
    database = Database.read(path)
    for use in (database.steps, lambda: database.step(1)):
        with pytest.raises(FileError):
            use()
    database.close()
    database = Database.open(path)
    assert database.steps() == []
    assert len(database.motions()) == 3
    database.close()


def test_zero_bytes_in_text_are_text(path: Path) -> None:
    change(path, "UPDATE steps SET label = CAST(x'610062' AS TEXT)")
    database = Database.open(path)
    assert database.steps()[0] == (0, "a\0b")
    database.close()


def test_a_bomb_is_not_unfolded(path: Path) -> None:
    bomb = packed_zeros(300 << 20)
    change(path, "UPDATE blobs SET content = ?", values=(bomb,))  # the size is that of before
    opened(path, lambda database: database.blob("b0"), "expected 3000 bytes")
    change(path, "UPDATE blobs SET size = ?", values=(300 << 20,))
    opened(path, lambda database: database.blob("b0"), "unpacks to more than")
    change(path, "UPDATE blobs SET size = ?, content = x'00'", values=(20 << 20,))
    opened(path, lambda database: database.blob("b0"), "incorrect header|expected")
    change(path, "UPDATE frames SET size = ?", values=(100 << 20,))
    opened(path, lambda database: list(database.frames("m0")), "expected")


def test_many_that_are_small_alone_are_counted_together(path: Path) -> None:
    bomb = packed_zeros(60 << 20)
    change(path, "UPDATE frames SET content = ?, size = 60 << 20", values=(bomb,))
    opened(path, lambda database: list(database.frames("m0")), "unpacks to more than")


def test_content_that_goes_on_or_is_cut_off(path: Path) -> None:
    content = zlib.compress(bytes(3000))
    for wrong in (content + b"x", content[:-3], b""):
        change(path, "UPDATE blobs SET content = ?", values=(wrong,))
        opened(path, lambda database: database.blob("b1"), "expected 3000 bytes")


def test_a_long_text(path: Path) -> None:
    change(path, "UPDATE steps SET document = ? WHERE number = 1", values=("x" * (20 << 20),))
    shutil.copyfile(path, path.with_name("b.sport"))
    database = Database.open(path.with_name("b.sport"))
    assert [number for number, _ in database.steps()] == [0, 2]
    database.close()
    database = Database.read(path, thorough=False)
    with pytest.raises(FileError, match="too long"):
        database.step(1)
    database.close()
    change(path, "DELETE FROM steps WHERE number = 1")
    change(path, "UPDATE steps SET label = ?", values=("x" * (3 << 20),))
    change(path, "UPDATE motions SET header = ?", values=("x" * (3 << 20),))
    database = Database.read(path)
    database.budget.left = 2 << 20
    for use in (database.steps, lambda: database.motion("m0")):
        with pytest.raises(FileError, match="unpacks to more than"):
            use()
    database.close()


def test_rows_that_an_index_does_not_know(path: Path, rows: dict[str, object]) -> None:
    """Two rows of one key: an index that lies about it."""
    change(path, "UPDATE sqlite_master SET sql = replace(sql, 'PRIMARY KEY', '') WHERE name = 'blobs'",
           "DELETE FROM sqlite_master WHERE name = 'sqlite_autoindex_blobs_1'")  # fmt: skip
    change(path, "INSERT INTO blobs SELECT * FROM blobs")
    salvaged(path, rows)


# --- bytes
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_pipes_devices_folders_and_links(path: Path, tmp_path: Path) -> None:
    def each(file: Path, match: str) -> None:
        for use in (Database.open, Database.read):
            with bounded(), pytest.raises(FileError, match=match):
                use(file)

    os.mkfifo(tmp_path / "pipe.sport")
    (tmp_path / "zero.sport").symlink_to("/dev/zero")
    (tmp_path / "round.sport").symlink_to(tmp_path / "round.sport")
    for name in ("pipe.sport", "zero.sport", "round.sport"):
        each(tmp_path / name, "not a regular file")
    each(tmp_path, "this is a folder")
    each(tmp_path / "none.sport", "No such file")
    each(tmp_path / "a\0b.sport", "null|NUL|name")
    each(tmp_path / f"{'x' * 242}.sport", "1 bytes too long")
    each(tmp_path / ("a" * 5000), "too long")
    for file in side_files(path):
        os.mkfifo(file)
        each(path, "not a regular file")
        file.unlink()
        file.symlink_to(tmp_path / "elsewhere")
        each(path, "not a regular file")
        file.unlink()
    path.with_name("a.sport-journal").write_bytes(b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7" + bytes(600))
    each(path, "of another program")


def test_a_link_to_a_session_is_that_session(path: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.sport"
    link.symlink_to(path)
    database = Database.open(link)
    assert database.path == path
    assert lock_of(path).exists()
    database.close()
    assert link.is_symlink()


def test_a_file_that_is_too_large(path: Path) -> None:
    with path.open("r+b") as file:
        file.truncate((1 << 29) + 1)
    for use in (Database.open, Database.read):
        with pytest.raises(FileError, match="larger than 512 MB"):
            use(path)


def test_a_damaged_file_is_kept_for_thirty_days(path: Path, rows: dict[str, object]) -> None:
    kept = []
    for days in (29, 31):
        stamp = time.strftime("%Y%m%d-%H%M%S", time.localtime(time.time() - 86400 * days))
        kept.append(path.with_name(f"{path.name}.damaged-{stamp}"))
        kept[-1].write_bytes(b"damaged")
    database = Database.open(path)
    assert content(database) == rows
    database.close()
    assert [file.exists() for file in kept] == [True, False]
