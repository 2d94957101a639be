"""A signal ends every command at any moment, in a sentence, with its own code, and leaves nothing."""

import contextlib
import os
import signal
import sys
import time
from pathlib import Path

import pytest

from runtime import interrupts
from runtime.atomic import atomic_path, temporary_folder, write_together
from runtime.errors import FileError
from runtime.formats.bvh_clip import save_bvh
from tests.fuzz.files import clip
from tests.signals.commands import Ended, Place

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows sends no signals to another process")
AT_MOMENT = Path(__file__).parents[1] / "signals" / "at_moment.py"
GENERATE = ("generate", "--prompt", "walk", "--seconds", "0.2", "--out")
CONVERT = ("convert", "take.bvh")
IN_TEMPORARY = ("open", "-sport-", "1")
# the signal; the moment: an event, what its argument holds, how often; the command
MOMENTS = {
    "as the parser is imported": ("SIGINT", ("import", "argparse", "1"), (*CONVERT, "out.glb")),
    "as numpy is imported": ("SIGTERM", ("import", "numpy", "1"), (*CONVERT, "out.glb")),
    "in the midst of numpy": ("SIGINT", ("import", "numpy.linalg", "1"), (*CONVERT, "out.glb")),
    "as a character is imported": ("SIGINT", ("import", "pygltflib", "1"), (*CONVERT, "out.glb")),
    "as the viewer is imported": ("SIGTERM", ("import", "imgui_bundle", "1"), ("view", "--offscreen")),
    "as the networks are loaded": ("SIGINT", ("import", "onnxruntime", "1"), (*GENERATE, "new/deep/out.bvh")),
    "in a check of the target": ("SIGTERM", IN_TEMPORARY, (*CONVERT, "out.html")),
    "in the file": ("SIGINT", ("open", "-sport-", "2"), (*CONVERT, "out.csv")),
    "in one of two files": ("SIGTERM", ("open", "-sport-", "4"), (*CONVERT, "out.bvh")),
    "in a folder of its own": ("SIGINT", ("os.mkdir", "tmp/.-sport-", "1"), (*CONVERT, "out.usdz")),
}


@pytest.fixture
def place(tmp_path: Path) -> Place:
    inputs = tmp_path / "inputs"
    save_bvh(clip(), inputs / "take.bvh")
    return Place(tmp_path / "place", inputs)


def ended(place: Place, name: str, moment: tuple[str, str, str], arguments: tuple[str, ...]) -> Ended:
    command = [sys.executable, str(AT_MOMENT), name, *moment, "--", *arguments]
    return place.ended(place.start(command), time.monotonic(), limit_s=120.0)


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_signal_ends_a_command_and_leaves_nothing(moment: str, place: Place) -> None:
    name, event, arguments = MOMENTS[moment]
    if arguments[-1] == "out.usdz":
        pytest.importorskip("pxr")
    number = getattr(signal, name)
    found = ended(place, name, event, arguments)
    assert found.code == 128 + number, found.said
    what = "Ctrl+C" if name == "SIGINT" else name
    *before, last = found.said.splitlines()
    assert last == f"sport: stopped by {what}; unfinished files were removed."
    assert before == (["sport: new/deep: this folder is new."] if arguments[-1].startswith("new") else [])
    assert found.left == []


def test_a_batch_ends_with_its_workers_and_goes_on_later(place: Place) -> None:
    (place.folder / "work" / "list.csv").write_text("prompt\n" + "walk\n" * 6)
    place.before = place.files()
    arguments = (*GENERATE, "clips", "--batch", "list.csv", "--workers", "2")
    found = ended(place, "SIGTERM", ("open", "manifest.jsonl", "1"), arguments)  # as the first row is done
    assert found.code == 143, found.said
    assert found.said.splitlines()[-1] == "sport: stopped by SIGTERM; run the same command again to continue."
    assert "Traceback" not in found.said
    assert "leaked" not in found.said
    assert found.running == 0
    assert not any("-sport-" in name for name in found.left)


def test_an_old_file_and_other_files_stay(place: Place) -> None:
    for name in ("out.csv", "other.txt"):
        (place.folder / "work" / name).write_text("old")
    ended(place, "SIGINT", ("open", "-sport-", "2"), (*CONVERT, "out.csv"))
    assert {(place.folder / "work" / name).read_text() for name in ("out.csv", "other.txt")} == {"old"}


def test_an_ignored_signal_stays_ignored(place: Place) -> None:
    moment = [str(AT_MOMENT), "SIGHUP", "import", "numpy", "1"]
    command = ["nohup", sys.executable, *moment, "--", *CONVERT, "o.csv"]
    found = place.ended(place.start(command), time.monotonic(), limit_s=120.0)
    assert found.code == 0
    assert "work/o.csv" in found.left


def test_what_is_undone_when_the_process_ends_is_forgotten_when_it_is_done(tmp_path: Path) -> None:
    before = dict(interrupts._UNFINISHED.actions)
    with temporary_folder() as folder, atomic_path(tmp_path / "a") as path:
        assert {folder, path} <= interrupts._UNFINISHED.actions.keys()
        path.write_text("a")
    assert not folder.exists()
    with interrupts.removed_when_ended(tmp_path / "b"):
        assert tmp_path / "b" in interrupts._UNFINISHED.actions
    assert interrupts._UNFINISHED.actions == before


def test_one_action_that_fails_does_not_keep_the_others_from_being_called(
    capfd: pytest.CaptureFixture[str],
) -> None:
    unfinished = interrupts._Unfinished()
    called: list[int] = []
    unfinished.actions = {1: lambda: called.append(1), 2: lambda: 1 // 0, 3: lambda: called.append(3)}
    unfinished.undo()
    assert called == [3, 1]
    assert capfd.readouterr().err == "not undone: ZeroDivisionError: integer division or modulo by zero\n"


def test_a_child_ends_with_its_time() -> None:
    done = interrupts.run_child([sys.executable, "-c", "import sys; print(1); sys.exit(3)"])
    assert (done.returncode, done.stdout.strip()) == (3, "1")


def test_of_files_that_belong_together_none_is_new_when_one_has_no_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a", "b"):
        (tmp_path / name).write_text("old")
    write = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if data == b"new b":
            raise OSError(28, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(FileError, match="No space left"):
        write_together({tmp_path / "a": "new a", tmp_path / "b": "new b"})
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a": "old", "b": "old"}


@pytest.mark.parametrize("inside", [True, False], ids=["a whole file", "any file"])
@pytest.mark.parametrize("beside", [True, False])
def test_a_temporary_folder_without_room_is_one_sentence(beside: bool, inside: bool, tmp_path: Path) -> None:
    place = tmp_path / "out.png" if beside else None

    def write() -> None:
        with temporary_folder(place) as folder:
            (folder / "part").write_text("x")
            with atomic_path(folder / "whole") if inside else contextlib.nullcontext():
                raise OSError(28, "No space left on device")

    with pytest.raises(FileError, match=r"No space left on device\. (Choose a folder|Make room)") as found:
        write()
    assert "-sport-" not in str(found.value)
    assert list(tmp_path.iterdir()) == []
