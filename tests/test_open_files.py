"""Each take that is nowhere else holds a file open: a long list meets no limit, and where it does, saving still works."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from app_driver import Start, run

from runtime.open_files import SPARE
from runtime.takes.journal import ROW, Header, TakeJournal, find_journals
from runtime.takes.metadata import UNKNOWN

resource = pytest.importorskip("resource")
TAKES = 60


@pytest.fixture
def limits() -> Iterator[tuple[int, int]]:
    """Files that are open now, and the hard limit; the soft one is as before afterwards."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    handle = os.open(os.devnull, os.O_RDONLY)
    os.close(handle)
    yield handle, before[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_more_takes_than_a_program_may_hold_open_when_it_starts(
    start: Start, tmp_path: Path, limits: tuple[int, int]
) -> None:
    used, hard = limits
    resource.setrlimit(resource.RLIMIT_NOFILE, (used + 40, hard))
    app = start(terrain="flat")
    run(app, 5)
    for _ in range(TAKES):
        app.takes.save_last()
    items = app.editor.session.takes
    journals = [item.journal for item in items if item.journal is not None]
    for journal in journals:
        journal._thread.join()
    assert [journal.problem for journal in journals] == [""] * TAKES
    assert len(list((tmp_path / "config" / "journals").glob("*.take"))) == TAKES


def held(folder: Path) -> list[TakeJournal]:
    """Journals of one frame each, written to their ends and still held."""
    journals = []
    for _ in range(TAKES):
        journal = TakeJournal(folder, Header("Take", 60.0, "flat", UNKNOWN))
        journal.add_row(np.ones(ROW, np.float32))
        journal.finish()
        journal._thread.join()
        journals.append(journal)
    return journals


def test_where_no_more_are_allowed_some_are_left_for_a_project(
    tmp_path: Path, limits: tuple[int, int]
) -> None:
    used, hard = limits
    resource.setrlimit(resource.RLIMIT_NOFILE, (used + 20 + SPARE, hard))
    journals = held(tmp_path)
    refused = [journal.problem for journal in journals if journal.problem]
    assert TAKES - 30 <= len(refused) <= TAKES - 10
    assert all("files are open. Save the project, or export takes." in problem for problem in refused)
    assert len(list(tmp_path.glob("*.take"))) == TAKES - len(refused)
    others = [os.open(os.devnull, os.O_RDONLY) for _ in range(SPARE - 4)]
    for handle in others:
        os.close(handle)
    for journal in journals:
        journal.delete()


def test_of_more_that_were_cut_off_than_may_be_open_the_first_are_offered(
    tmp_path: Path, limits: tuple[int, int]
) -> None:
    for journal in held(tmp_path):
        journal.release()
    used, hard = limits
    resource.setrlimit(resource.RLIMIT_NOFILE, (used + 20 + SPARE, hard))
    found, complaints = find_journals(tmp_path)
    assert 10 <= len(found) <= 30
    assert not complaints
    for journal in found:
        journal.delete()
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    more, complaints = find_journals(tmp_path)
    assert len(more) == TAKES - len(found)
    assert not complaints
    for journal in more:
        journal.delete()
