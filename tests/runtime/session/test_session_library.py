"""Untitled sessions: which ones the next start finds, and which ones go."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from runtime.assets import PROJECT_ROOT
from runtime.session.database import Database
from runtime.session.library import find, keep_newest, look_at, new_path, remove
from runtime.session.stored_rows import Writer


def untitled(folder: Path, work: Callable[[Writer], None] | None = None, close: bool = True) -> Database:
    """A session of two takes in `folder`."""
    session = Database.create(new_path(folder))
    values = {"name": "stairs", "takes": "2", "seconds": "3.5", "ended": "1", "picture": b"PNG"}
    session.submit(work or of_meta("Record", **values))
    assert session.flush()
    if close:
        assert session.close()
    return session


def test_what_is_shown_of_a_session(tmp_path: Path) -> None:
    session = untitled(tmp_path)
    (found,) = find(tmp_path)
    told = (found.path, found.name, found.ended, found.takes, found.seconds)
    assert told == (session.path, "stairs", True, 2, 3.5)
    assert found.picture == b"PNG"
    assert abs(found.saved_s - time.time()) < 60
    remove(found.path)


def test_a_session_without_a_summary_may_hold_work(tmp_path: Path) -> None:
    bare = untitled(tmp_path, lambda writer: writer.put_step(0, "", "{}"))
    (found,) = find(tmp_path)
    told = (found.path, found.name, found.ended, found.takes, found.picture)
    assert told == (bare.path, "Untitled", False, 0, b"")
    assert find(tmp_path / "none") == []


def test_a_session_that_is_open_is_not_found_nor_removed(tmp_path: Path) -> None:
    held = untitled(tmp_path, close=False)
    closed = untitled(tmp_path)
    assert [summary.path for summary in find(tmp_path)] == [closed.path]
    keep_newest(tmp_path, 0)
    keep_newest(tmp_path, 0)
    remove(held.path)
    assert [path.name for path in tmp_path.glob("*.sport")] == [held.path.name]
    assert held.flush()
    assert held.steps() == [(0, "Record")]
    held.close()
    assert len(find(tmp_path)) == 1


KILLED = """
import os, sys
from pathlib import Path
from tests.runtime.session.test_session_library import untitled
untitled(Path(sys.argv[1]), close=False)
os.kill(os.getpid(), 9)
"""


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
def test_a_session_that_was_cut_off_is_found_with_what_its_log_holds(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], cwd=PROJECT_ROOT, check=False)
    assert done.returncode == -9
    (found,) = find(tmp_path)
    assert found.takes == 2
    remove(found.path)
    assert list(tmp_path.iterdir()) == []


def of_meta(label: str = "", **values: str | bytes) -> Callable[[Writer], None]:
    """A session of one step with these values."""

    def work(writer: Writer) -> None:
        writer.put_step(0, label, "{}")
        for name, value in values.items():
            writer.set_meta(name, value)

    return work


def cut_off(writer: Writer) -> None:
    """A first recording that was killed."""
    of_meta(takes="0", edits="")(writer)
    writer.put_motion("m", "{}")
    writer.put_frames("m.tail", 0, 15, b"frames")


def test_only_what_was_offered_before_is_removed_and_what_has_takes_last(tmp_path: Path) -> None:
    path = of_meta(takes="0", edits="1")
    kinds = {"takes": None, "a recording": cut_off, "a path": path, "another path": path}
    paths = {name: untitled(tmp_path, work).path for name, work in kinds.items()}
    names = {path: name for name, path in paths.items()}

    def kept(count: int) -> list[str]:
        return [names[summary.path] for summary in keep_newest(tmp_path, count)]

    assert kept(2) == list(kinds)[::-1]  # all are offered once
    assert kept(3) == ["another path", "a recording", "takes"]
    paths["new"] = untitled(tmp_path, of_meta(takes="0", edits="1")).path
    names[paths["new"]] = "new"
    assert kept(2) == ["new", "a recording", "takes"]
    assert kept(1) == ["a recording"]
    assert [path for path in tmp_path.glob("*.sport")] == [paths["a recording"]]


def test_without_the_list_of_what_was_offered_nothing_is_removed(tmp_path: Path) -> None:
    for _ in range(3):
        untitled(tmp_path)
    for content in ("", "{}", "[5]", None):
        assert len(keep_newest(tmp_path, 0)) == 3
        file = tmp_path / "offered.json"
        file.unlink() if content is None else file.write_text(content)


def test_a_summary_costs_little_and_its_numbers_can_be_shown(tmp_path: Path) -> None:
    untitled(tmp_path, of_meta(picture=bytes(9 << 20)))
    assert find(tmp_path)[0].damaged
    untitled(tmp_path, of_meta(seconds="inf"))
    assert find(tmp_path)[0].seconds == 1e9


def test_empty_sessions_go_and_what_cannot_be_read_is_offered_as_damaged(tmp_path: Path) -> None:
    for work in (lambda writer: writer.set_meta("name", "empty"), of_meta(takes="0", edits="")):
        untitled(tmp_path, work)
    (tmp_path / "20200101-000000-0000-x.sport").write_bytes(b"of another program")
    untitled(tmp_path, of_meta(takes="many"))
    (tmp_path / "folder.sport").mkdir()
    assert [(summary.damaged, summary.has_motions) for summary in find(tmp_path)] == [(True, True)] * 2
    assert len(list(tmp_path.iterdir())) == 3
    remove(tmp_path / "none.sport")
    assert look_at(tmp_path / "none.sport") is None
