"""Names of files: taken once, by one program; links and modes kept; devices left alone."""

import errno
import os
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from runtime.atomic import check_target, write_atomic, write_new
from runtime.errors import FileError
from runtime.safe_read import printable

posix = pytest.mark.skipif(os.name != "posix", reason="modes, links and pipes of POSIX")


def test_writers_at_the_same_moment_all_keep_their_files(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        paths = list(pool.map(lambda i: write_new(tmp_path / "take.bvh", str(i)), range(40)))
    assert len(set(paths)) == 40
    assert sorted(path.read_text("utf-8") for path in paths) == sorted(map(str, range(40)))
    assert set(tmp_path.iterdir()) == set(paths)  # no temporary file is left


def test_a_disk_without_hard_links_takes_names_as_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise OSError(errno.EPERM, "not here")

    monkeypatch.setattr(os, "link", refused)
    assert write_new(tmp_path / "a.txt", "1").name == "a.txt"
    assert write_new(tmp_path / "a.txt", "2").name == "a-2.txt"
    assert (tmp_path / "a.txt").read_text("utf-8") == "1"


@posix
def test_the_mode_is_the_umasks_or_that_of_the_old_file(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        write_atomic(tmp_path / "mine", "x")
        assert stat.S_IMODE(write_new(tmp_path / "new", "x").stat().st_mode) == 0o600
        os.umask(0o002)
        write_atomic(tmp_path / "ours", "x")
        (tmp_path / "old").write_text("x", encoding="utf-8")
        (tmp_path / "old").chmod(0o640)
        write_atomic(tmp_path / "old", "y")
    finally:
        os.umask(before)
    modes = {name: stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("mine", "ours", "old")}
    assert modes == {"mine": 0o600, "ours": 0o664, "old": 0o640}


@posix
def test_a_link_is_followed_and_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    link = tmp_path / "link.bvh"
    link.symlink_to(tmp_path / "deep" / "real.bvh")
    write_atomic(link, "1")  # of a file that is not there yet
    write_atomic(link, "2")
    assert link.is_symlink()
    assert (tmp_path / "deep" / "real.bvh").read_text("utf-8") == "2"
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["real.bvh"]


@posix
def test_devices_and_pipes_are_refused_and_stay(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for target in (tmp_path / "pipe", Path(os.devnull)):
        for attempt in (check_target, lambda path: write_atomic(path, "x")):
            with pytest.raises(FileError, match="device or a pipe"):
                attempt(target)
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


def test_names_that_are_no_text_can_be_shown() -> None:
    assert printable(Path(os.fsdecode(b"walk-\xff.bvh"))) == "walk-\ufffd.bvh"
    assert printable("Löwe 獅子") == "Löwe 獅子"
