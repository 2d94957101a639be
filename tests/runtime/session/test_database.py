"""The file of a session: what is kept of it when a process, a disk or a folder goes, and two windows on one file."""

import contextlib
import errno
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from runtime.assets import PROJECT_ROOT
from runtime.errors import FileError
from runtime.session import renewal
from runtime.session.database import Database
from runtime.session.renewal import Renewal
from runtime.session.sqlite_file import FileInUse, file_errors, kept_aside, lock_of, side_files
from runtime.session.stored_rows import Writer

RIGHTS = "-dac_override,-dac_read_search,-fowner"  # of root, to whom nothing is denied
ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
DROPPED = ["setpriv", f"--bounding-set={RIGHTS}", f"--inh-caps={RIGHTS}"] if ROOT else []
POSIX = pytest.mark.skipif(os.name == "nt", reason="POSIX")


@pytest.fixture
def files(tmp_path: Path) -> Iterator[list[Database]]:
    """Databases that the end of a test closes."""
    opened: list[Database] = []
    yield opened
    for database in opened:
        database.close(60.0)


@pytest.fixture
def session(tmp_path: Path, files: list[Database]) -> Database:
    files.append(Database.create(tmp_path / "folder" / "a.sport"))
    return files[0]


def fill(writer: Writer) -> None:
    writer.put_step(1, "Record", '{"takes": 1}')
    writer.put_blob("b", bytes(1000))
    writer.put_motion("m", "header")
    writer.put_frames("m", 0, 15, b"frames")
    writer.set_meta("name", "walk")
    writer.set_meta("picture", b"\x89PNG")


def step(number: int) -> Any:
    return lambda writer: writer.put_step(number, "", "{}")


def content(database: Database) -> dict[str, Any]:
    """All that can be read."""
    motions = {key: (database.motion(key), list(database.frames(key))) for key in database.motions()}
    return {"steps": {n: (label, database.step(n)) for n, label in database.steps()}, "motions": motions}


def wait(condition: Any, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def copied(database: Database, folder: Path) -> Path:
    """The files as they are now, as a killed process leaves them."""
    folder.mkdir(parents=True)
    for file in (database.path, side_files(database.path)[0]):
        shutil.copyfile(file, folder / file.name)
    return folder / database.path.name


# --- what was written is read
KEYS = st.sampled_from(["a", "b", "käse\0"])
TEXTS = st.text(st.characters(codec="utf-8"), max_size=20)
PIECES = st.binary(max_size=200)


class Model(RuleBasedStateMachine):
    """A database against dicts; what is killed is opened again as its files were."""

    @initialize()
    def begin(self) -> None:
        import tempfile

        self.folder = Path(tempfile.mkdtemp(prefix="session-"))
        self.count = 0
        self.patch = pytest.MonkeyPatch()
        self.patch.setattr(Renewal, "_mend", lambda *_: None)  # to it these motions are damaged
        self.database = Database.create(self.folder / "0.sport")
        self.steps: dict[int, tuple[str, str]] = {}
        self.blobs: dict[str, bytes] = {}
        self.motions: dict[str, str] = {}
        self.frames: dict[tuple[str, int], tuple[int, bytes]] = {}
        self.meta: dict[str, str] = {}

    def teardown(self) -> None:
        self.database.close(60.0)
        self.patch.undo()
        shutil.rmtree(self.folder)

    def fresh(self) -> Path:
        self.count += 1
        return self.folder / f"{self.count}.sport"

    @rule(number=st.integers(-3, 9), label=TEXTS, document=TEXTS)
    def put_step(self, number: int, label: str, document: str) -> None:
        self.database.submit(lambda writer: writer.put_step(number, label, document))
        self.steps[number] = label, document

    @rule(first=st.none() | st.integers(0, 9), before=st.none() | st.integers(0, 9))
    def drop_steps(self, first: int | None, before: int | None) -> None:
        self.database.submit(lambda writer: writer.drop_steps(first, before))
        gone = {
            n for n in self.steps if (first is not None and n >= first) or (before is not None and n < before)
        }
        self.steps = {number: value for number, value in self.steps.items() if number not in gone}

    @rule(key=KEYS, header=TEXTS)
    def put_motion(self, key: str, header: str) -> None:
        self.database.submit(lambda writer: writer.put_motion(key, header))
        self.motions[key] = header

    @rule(key=KEYS, number=st.integers(0, 4), count=st.integers(1, 300), piece=PIECES)
    def put_frames(self, key: str, number: int, count: int, piece: bytes) -> None:
        self.database.submit(lambda writer: writer.put_frames(key, number, count, piece))
        self.frames[key, number] = count, piece

    @rule(key=KEYS)
    def drop_frames(self, key: str) -> None:
        self.database.submit(lambda writer: writer.drop_frames(key))
        self.frames = {at: piece for at, piece in self.frames.items() if at[0] != key}

    @rule(key=KEYS, piece=PIECES)
    def put_blob(self, key: str, piece: bytes) -> None:
        self.database.submit(lambda writer: writer.put_blob(key, piece))
        self.blobs.setdefault(key, piece)

    @rule(name=KEYS, value=TEXTS)
    def set_meta(self, name: str, value: str) -> None:
        self.database.submit(lambda writer: writer.set_meta(name, value))
        self.meta[name] = value

    @rule(keys=st.sets(KEYS))
    def remove_lost(self, keys: set[str]) -> None:
        self.database.submit(lambda writer: writer.remove(keys))
        self.motions = {key: header for key, header in self.motions.items() if key not in keys}
        self.frames = {at: piece for at, piece in self.frames.items() if at[0] not in keys}
        self.blobs = {key: piece for key, piece in self.blobs.items() if key not in keys}

    @rule()
    def open_again(self) -> None:
        assert self.database.close()
        beside = (*side_files(self.database.path), lock_of(self.database.path))
        assert not any(file.exists() for file in beside)
        self.database = Database.open(self.database.path)
        self.adopt_headers()

    def adopt_headers(self) -> None:
        """An opened file has headers that say how many frames there are; the others are as they were."""
        framed = {key for key, _ in self.frames}
        assert set(self.motions) <= set(self.database.motions()) <= set(self.motions) | framed
        now = {key: self.database.motion(key) for key in self.database.motions()}
        assert all(now[key] == header for key, header in self.motions.items() if key not in framed)
        self.motions = now

    @rule()
    def kill(self) -> None:
        assert self.database.flush()
        path = copied(self.database, self.folder / f"killed-{self.count}")
        self.count += 1
        self.database.close()
        self.database = Database.open(path)
        self.adopt_headers()

    @rule()
    def save_as(self) -> None:
        before = self.database.path
        self.database.save_as(self.fresh())
        assert self.database.path == self.folder / f"{self.count}.sport"
        Database.open(before).close()  # nothing holds it

    @rule()
    def save_copy(self) -> None:
        path = self.fresh()
        self.database.save_copy(path)
        copy = Database.read(path)
        self.check(copy)
        copy.close()

    @precondition(lambda self: self.count % 2)
    @rule()
    def remove(self) -> None:
        """Another program removes the file; the next change writes it again."""
        self.database.flush()
        if os.name != "nt":
            self.database.path.unlink()
            self.set_meta("a", "again")

    @invariant()
    def same(self) -> None:
        assert self.database.flush(60.0), self.database.problem
        self.check(self.database)

    def check(self, database: Database) -> None:
        assert database.steps() == [(number, self.steps[number][0]) for number in sorted(self.steps)]
        documents = {number: document for number, (_, document) in self.steps.items()}
        assert {number: database.step(number) for number in self.steps} == documents
        assert database.motions() == list(self.motions)
        assert {key: database.motion(key) for key in self.motions} == self.motions
        for key in {at[0] for at in self.frames} | set(self.motions):
            expected = [self.frames[at] for at in sorted(self.frames) if at[0] == key]
            assert list(database.frames(key)) == expected
        assert {key: database.blob(key) for key in self.blobs} == self.blobs
        assert {name: database.meta(name, "none") for name in self.meta} == self.meta


TestModel = Model.TestCase
TestModel.settings = settings(max_examples=12, stateful_step_count=12, deadline=None, derandomize=True)


def test_what_is_missing_is_said(session: Database) -> None:
    session.submit(fill)
    assert session.flush()
    assert (session.blob("b"), session.motion("m"), session.meta("name")) == (bytes(1000), "header", "walk")
    assert (session.meta("none", "so"), session.meta_bytes("picture")) == ("so", b"\x89PNG")
    for ask in (lambda: session.blob("c"), lambda: session.step(7), lambda: session.motion("n")):
        with pytest.raises(FileError, match="is missing"):
            ask()
    assert list(session.frames("n")) == []


def test_the_check_of_an_opened_file_ends_with_it(session: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(self: Database) -> None:
        time.sleep(0.2)

    assert session.close()
    monkeypatch.setattr(Database, "_check_integrity", slow)
    assert Database.open(session.path).close()
    assert "sport-session check" not in [thread.name for thread in threading.enumerate()]


def test_the_frame_does_not_wait(session: Database) -> None:
    held, waited = threading.Event(), []
    session.submit(lambda writer: waited.append(held.wait(20.0)))
    for number in range(200):
        session.submit(step(number))
    assert waited == []  # nothing is written yet
    held.set()
    assert session.flush()
    assert len(session.steps()) == 200


def test_a_change_is_on_disk_unasked_and_in_the_file_itself_when_nothing_follows(
    session: Database, tmp_path: Path
) -> None:
    session.submit(fill)
    wait(lambda: session.steps() == [(1, "Record")])
    wait(lambda: os.stat(session.path).st_size > 0 and _alone(session.path, tmp_path / "alone.sport") == 1)


def _alone(path: Path, copy: Path) -> int:
    """Steps that a copy without the log has."""
    shutil.copyfile(path, copy)
    alone = Database.read(copy)
    count = len(alone.steps())
    alone.close()
    time.sleep(0.05)
    return count


def test_reading_again_costs_the_budget_nothing_and_what_this_process_wrote_is_free(
    session: Database,
) -> None:
    session.submit(fill)
    session.close()
    again = Database.open(session.path)
    before = again.budget.left
    for _ in range(3):
        again.blob("b")
    assert before - 1100 < again.budget.left < before - 1000
    again.budget.left = 10
    again.submit(lambda writer: writer.put_blob("c", bytes(5000)))
    assert again.flush()
    assert again.blob("c") == bytes(5000)
    with pytest.raises(FileError, match="unpacks to more than"):
        list(again.frames("m"))
    again.close()


def test_a_defect_of_one_change_is_said_and_holds_up_no_other(session: Database) -> None:
    def wrong(writer: Writer) -> None:
        writer.put_step(5, "", "{}")
        raise KeyError("five")

    for work in (step(1), wrong, step(2)):
        session.submit(work)
    assert not session.flush()
    assert "report this defect" in session.problem
    assert [number for number, _ in session.steps()] == [1, 2]
    session.submit(lambda writer: writer.put_frames("m", -1, 15, b""))
    session.submit(step(3))
    assert not session.close()
    again = Database.open(session.path)
    assert [number for number, _ in again.steps()] == [1, 2, 3]
    again.close()


# --- processes
RECORD = """
import sys, time
from pathlib import Path
from runtime.session import renewal
from runtime.session.database import Database
from runtime.session.renewal import Renewal
database = Database.create(Path(sys.argv[1]))
database.submit(lambda writer: writer.put_motion("m", ""))
for number in range(10_000):
    database.submit(lambda writer, number=number: writer.put_frames("m", number, 15, bytes([number % 256]) * 3300))
    print(sum(1 for _ in database.frames("m")), flush=True)
    time.sleep(0.01)
"""


@contextlib.contextmanager
def recording(path: Path) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", RECORD, str(path)],
        cwd=PROJECT_ROOT, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    try:
        process.stdout.readline()
        yield process
    finally:
        process.kill()
        process.communicate()


def check_frames(database: Database) -> int:
    """How many pieces a recording has, none of them missing or wrong."""
    pieces = list(database.frames("m"))
    assert pieces == [(15, bytes([number % 256]) * 3300) for number in range(len(pieces))]
    return len(pieces)


def test_a_killed_process_loses_nothing_that_it_could_read_and_its_lock(tmp_path: Path) -> None:
    path = tmp_path / "a.sport"
    for least in (5, 20):
        with recording(path) as process:
            with pytest.raises(FileInUse, match="another window"):
                Database.open(path)
            copy = Database.read(path)  # while it is written
            assert copy.motions() in ([], ["m"])
            copy.close()
            assert process.stdout is not None
            for line in process.stdout:  # pieces that it can read
                if int(line) >= least:
                    break
            process.send_signal(signal.SIGKILL if os.name != "nt" else signal.SIGTERM)
            readable = max([least, *map(int, process.stdout)])
        database = Database.open(path)
        assert check_frames(database) >= readable
        assert database.close()
        path.unlink()


def test_two_windows(session: Database, tmp_path: Path, files: list[Database]) -> None:
    other = Database.create(tmp_path / "b.sport")
    files.append(other)
    session.submit(fill)
    other.submit(step(9))
    for target in (session.save_as, session.save_copy):
        with pytest.raises(FileInUse):
            target(other.path)
    assert other.flush()
    assert other.steps() == [(9, "")]
    other.close()
    with pytest.raises(FileError, match="exists"):
        Database.create(other.path)
    session.save_as(other.path)  # closed now: replaced
    assert content(session)["steps"] == {1: ("Record", '{"takes": 1}')}
    session.save_as(session.path)
    assert not lock_of(tmp_path / "folder" / "a.sport").exists()


def test_a_log_that_was_left_is_not_read_as_that_of_a_new_file(session: Database, tmp_path: Path) -> None:
    session.submit(step(7))
    session.flush()
    left = copied(session, tmp_path / "left")
    other = Database.create(tmp_path / "other.sport")
    other.submit(fill)
    other.save_as(left)
    assert other.close()
    again = Database.open(left)
    assert [number for number, _ in again.steps()] == [1]
    again.close()


def test_reading_only(session: Database, tmp_path: Path) -> None:
    session.submit(fill)
    session.close()
    before = sorted(path.name for path in session.path.parent.iterdir())
    reader = Database.read(session.path)
    assert reader.steps() == [(1, "Record")]
    with pytest.raises(FileError, match="reading only"):
        reader.submit(fill)
    assert sorted(path.name for path in session.path.parent.iterdir()) == before == ["a.sport"]
    reader.save_copy(tmp_path / "copy.sport")
    copy = Database.open(tmp_path / "copy.sport")
    assert copy.steps() == [(1, "Record")]
    copy.close()
    assert reader.close()
    with pytest.raises(FileError, match="closed"):
        reader.steps()


def test_what_was_removed_does_not_leave_with_the_file(session: Database) -> None:
    session.submit(lambda writer: writer.put_step(1, "", "SECRET" * 5000))
    session.submit(fill)
    session.flush()
    session.submit(lambda writer: writer.put_step(1, "", "x"))
    assert session.close()
    assert b"SECRET" not in session.path.read_bytes()


# --- disks and folders
@POSIX
@pytest.mark.parametrize("what", ["file", "log", "lock", "folder", "replaced"])
def test_what_was_removed_is_written_again_whole(session: Database, what: str) -> None:
    session.submit(fill)
    assert session.flush()
    log, lock = side_files(session.path)[:1], [lock_of(session.path)]
    for file in {"file": [session.path], "log": log, "lock": lock}.get(what, []):
        file.unlink()
    if what == "folder":
        shutil.rmtree(session.path.parent)
    if what == "replaced":
        (session.path.parent / "new").write_bytes(b"of another program")
        (session.path.parent / "new").replace(session.path)
    session.submit(step(2))
    assert session.flush()
    with pytest.raises(FileInUse):
        Database.open(session.path)
    session.path.unlink()
    wait(session.path.exists)  # also when nothing is done
    assert session.close()
    again = Database.open(session.path)
    assert [number for number, _ in again.steps()] == [1, 2]
    assert list(again.frames("m")) == [(15, b"frames")]
    kept = [file.read_bytes() for file in kept_aside(session.path)]
    assert (b"of another program" in kept) is (what == "replaced")
    again.close()


FULL = """
import resource, signal, sys
from pathlib import Path
from runtime.session import renewal
from runtime.session.database import Database
from runtime.session.renewal import Renewal
folder = Path(sys.argv[1])
database = Database.create(folder / "a.sport")
database.submit(lambda writer: writer.put_step(1, "", "{}"))
assert database.flush(), database.problem
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, -1))
for number in range(2, 200):
    database.submit(lambda writer, number=number: writer.put_step(number, "", str(number) * 2000))
assert not database.flush()
print(database.problem)
assert not database.flush(0.2)
assert [number for number, _ in database.steps()] == [1]
resource.setrlimit(resource.RLIMIT_FSIZE, (-1, -1))
if len(sys.argv) > 2:
    assert database.flush() and database.problem == "", database.problem
    assert len(database.steps()) == 199
    assert database.close()
else:
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, -1))
    assert not database.close(), "not all was written"
    for count in (199, 200):  # read all the same, with what was handed over
        again = Database.open(folder / "a.sport")
        assert len(again.steps()) == count
        again.submit(lambda writer: writer.put_step(200, "", "{}"))
        assert not again.flush()
        assert "Make room on the disk" in again.problem
        assert not again.close()
        assert again.handed_over is not None
"""


@POSIX
def test_a_full_disk_is_said_and_what_waits_is_written_when_there_is_room(tmp_path: Path) -> None:
    for words in ([], ["room"]):
        folder = tmp_path / "-".join(["full", *words])
        folder.mkdir()
        done = subprocess.run(
            [sys.executable, "-c", FULL, str(folder), *words],
            cwd=PROJECT_ROOT, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "a.sport: " in done.stdout
        assert "Make room on the disk" in done.stdout
        database = Database.open(folder / "a.sport")
        assert len(database.steps()) == (199 if words else 200)
        database.close()


def test_a_session_that_is_opened_on_a_full_disk_is_written_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.sport"
    database = Database.create(path)
    database.submit(lambda writer: writer.put_step(1, "", "{}"))
    assert database.close()

    def full(*_: object) -> NoReturn:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(renewal, "new_file", full)
        database = Database.open(path)
    database.submit(lambda writer: writer.put_step(2, "", "{}"))
    assert database.flush(), database.problem
    assert database.close()


DENIED = """
import os, sys
from pathlib import Path
from runtime.errors import FileError
from runtime.session import renewal
from runtime.session.database import Database
from runtime.session.renewal import Renewal
folder = Path(sys.argv[1])
own = Database.create(folder / "own.sport")
own.submit(lambda writer: writer.put_step(1, "", "{}"))
for use in (
    lambda: Database.create(folder / "denied" / "a.sport"),
    lambda: Database.open(folder / "denied" / "b.sport"),
    lambda: own.save_as(folder / "denied" / "c.sport"),
    lambda: own.save_copy(folder / "denied" / "c.sport"),
    lambda: Database.open(folder / "file.sport"),
    lambda: Database.read(folder / "file.sport"),
):
    try:
        use()
        print("none")
    except FileError as error:
        print(error)
print(Database.read(folder / "denied" / "b.sport").steps())
assert own.flush() and own.path == folder / "own.sport" and own.close()
"""


@POSIX
@pytest.mark.skipif(ROOT and shutil.which("setpriv") is None, reason="rights of POSIX")
def test_a_denied_folder_is_named_and_read_all_the_same(session: Database, tmp_path: Path) -> None:
    denied = tmp_path / "denied"
    denied.mkdir()
    session.submit(fill)
    for path in (denied / "b.sport", tmp_path / "file.sport"):
        session.save_copy(path)
    (tmp_path / "file.sport").chmod(0)
    denied.chmod(0o500)
    done = subprocess.run(
        [*DROPPED, sys.executable, "-c", DENIED, str(tmp_path)],
        cwd=PROJECT_ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    denied.chmod(0o700)
    assert done.returncode == 0, done.stderr
    *said, steps = done.stdout.splitlines()
    assert steps == "[(1, 'Record')]"
    names = ["a", "b", "c", "c", "file", "file"]
    for line, name in zip(said, names, strict=True):
        assert f"{name}.sport: " in line
        assert line.count(". ") == 1, line


def test_a_disk_that_hangs_is_left_alone(tmp_path: Path) -> None:
    session = Database.create(tmp_path / "a.sport")
    held = threading.Event()
    session.submit(lambda writer: held.wait(20.0) and None)
    wait(lambda: session._turn.locked())
    assert not session.flush(0.05)
    assert not session.close(0.05)
    held.set()
    assert session.close()


def test_reading_goes_on_while_the_file_becomes_another(session: Database, tmp_path: Path) -> None:
    session.submit(fill)
    assert session.flush()
    ended, wrong = threading.Event(), []

    def read() -> None:
        while not ended.is_set():
            try:
                assert session.blob("b") == bytes(1000)
                assert list(session.frames("m")) == [(15, b"frames")]
            except (FileError, AssertionError) as error:
                wrong.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    for number in range(5):
        session.save_as(tmp_path / f"{number}.sport")
        session.submit(step(number))
    if os.name != "nt":
        session.path.unlink()
    session.flush()
    ended.set()
    thread.join()
    assert wrong == []


@pytest.mark.parametrize("code", [sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE])
def test_a_full_disk_is_called_so_wherever_sqlite_meets_it(code: int, tmp_path: Path) -> None:
    error = sqlite3.OperationalError("disk I/O error")
    error.sqlite_errorcode = code
    said = r"there is no room left.* Make room on the disk"
    with pytest.raises(FileError, match=said), file_errors(tmp_path / "a"):
        raise error
