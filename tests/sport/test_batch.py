"""Batches: lists, what is made again and what is not, workers that die, and a real batch killed half way."""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import pytest

from runtime.assets import PROJECT_ROOT
from runtime.errors import FileError, UsageError
from runtime.file_lock import open_locked
from sport import cli, clips, parser
from sport.batch import run, work
from sport.batch.rows import BatchRow, Task, plan, read_rows, sha256
from sport.commands import generate


def base(*words: str) -> argparse.Namespace:
    return parser.build_parser().parse_args(["generate", "--batch", "list.csv", "--out", "clips", *words])


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def planned(*values: dict[str, Any], words: Sequence[str] = ()) -> tuple[list[Task], list]:
    rows = [BatchRow(number, value) for number, value in enumerate(values, 1)]
    return plan(rows, generate.row_parser(), base(*words))


def lines(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / run.MANIFEST).read_text(encoding="utf-8").splitlines()]


def test_csv_and_json_lines_say_the_same(tmp_path: Path) -> None:
    text = '\ufeffprompt,--seed,Ground out\r\n"old, frail",3,g.obj\r\n\r\ndrunk,,\r\n'
    table = write(tmp_path / "a.csv", text)
    text = '{"prompt": "old, frail", "seed": 3, "ground-out": "g.obj"}\n\n{"prompt": "drunk", "seed": null}\n'
    found, same = read_rows(table), read_rows(write(tmp_path / "a.jsonl", text))
    assert [row.values for row in found] == [
        {"prompt": "old, frail", "seed": "3", "ground_out": "g.obj"}, {"prompt": "drunk"}]  # fmt: skip
    assert [{k: str(v) for k, v in row.values.items()} for row in same] == [row.values for row in found]
    assert [row.number for row in same] == [1, 2]


def test_rows_that_cannot_be_read_are_no_reason_to_refuse_the_list(tmp_path: Path) -> None:
    found = read_rows(write(tmp_path / "a.jsonl", '{"seed": 1}\n{"seed"\n[1]\n{"seed": [1]}\n'))
    assert [bool(row.error) for row in found] == [False, True, True, True]
    (found,) = read_rows(write(tmp_path / "a.jsonl", '{"prompt": "old\u2028frail\x85"}\r\n'))
    assert found.values == {"prompt": "old\u2028frail\x85"}, "only a line's end ends a row"
    found = read_rows(write(tmp_path / "a.csv", "seed\n1\n1,2\n"))
    assert [row.error for row in found] == ["", "more cells than the header has"]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.txt", "seed\n1\n", "expected .csv or .jsonl"),
        ("a.csv", "", "no rows"),
        ("a.csv", "seed\n", "no rows"),
        ("a.csv", "seed,seed\n1,2\n", "two with the same one"),
        ("a.jsonl", "\n", "no rows"),
    ],
)
def test_lists_that_cannot_be_used(name: str, text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises((FileError, UsageError), match=said):
        read_rows(write(tmp_path / name, text))


def test_rows_go_over_the_arguments_of_the_command() -> None:
    tasks, refused = planned(
        {"prompt": "old", "seed": "4", "loop": "yes"},
        {"parts": "parts.json", "loop": "no", "out": "deep/b.glb"},
        {"blend": "-5 % drunk", "speed": 0.5},
        words=["--prompts", "0:walk; 2:drunk", "--terrain", "hills", "--fps", "30", "--loop"],
    )
    assert not refused
    a, b, c = (task.options for task in tasks)
    assert (a.prompt, a.prompts, a.seed, a.loop, a.terrain, a.fps) == ("old", None, 4, True, "hills", 30.0)
    assert (b.parts, b.prompts, b.loop, b.out) == (Path("parts.json"), None, False, Path("deep/b.glb"))
    assert (c.prompts, c.blend, c.speed, c.out) == ("0:walk; 2:drunk", "-5 % drunk", 0.5, Path("00003.bvh"))


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"seed": "x"}, "invalid int value"),
        ({"loop": "maybe"}, "expected true or false"),
        ({"model": "nobody"}, "no model of this name"),
        ({"out": "../a.bvh"}, "below the folder"),
        ({"out": str(Path("/a.bvh").resolve())}, "below the folder"),
        ({"out": ".sport-batch/a.bvh"}, "below the folder"),
        ({"ground_out": "00001.BVH"}, "row 1 writes"),
        ({"out": "E\u0301.bvh"}, "row 1 writes"),  # one name on a disk that composes letters
    ],
)
def test_rows_that_cannot_be_made_are_refused_alone(values: dict[str, Any], said: str) -> None:
    tasks, (refused,) = planned({"ground_out": "\u00e9.bvh"}, values)
    assert [task.number for task in tasks] == [1]
    assert refused.number == 2
    assert said in refused.error


@pytest.mark.parametrize("name", ["prompy", "batch"])
def test_a_column_that_is_no_argument_is_said_with_those_that_are(name: str) -> None:
    with pytest.raises(UsageError, match=f"column {name}: no argument.*Columns are .*seconds"):
        planned({name: "1"})


def test_the_key_changes_with_arguments_and_with_the_files_they_name(tmp_path: Path) -> None:
    parts = write(tmp_path / "parts.json", "{}")

    def key(**values: Any) -> str:
        return planned(values)[0][0].key

    keys = {key(), key(seed=1), key(seed=1, loop=True), key(parts=str(parts))}
    parts.write_text("{ }")
    assert len(keys | {key(parts=str(parts))}) == 5
    assert key(seed=1) == key(seed="1")


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Clips are texts of their prompt and seed, made in this process; what was made, in order."""
    made: list[str] = []

    def write_clips(options: argparse.Namespace, tools: object) -> None:
        made.append(options.prompt)
        if options.prompt == "fails":
            raise UsageError(f"{options.out}: cannot.", "Try another.")
        if options.prompt == "breaks":
            raise ZeroDivisionError("a defect")
        options.out.parent.mkdir(exist_ok=True)
        options.out.write_text(f"{options.prompt} {options.seed}")
        options.out.with_name(options.out.name + ".json").write_text("{}")
        print(f"sport: {options.out}: 60 frames")
        print("sport: “drunk”: hardly shown", file=sys.stderr)

    class Here(Executor):
        """Makes a row when it is submitted."""

        def submit(self, function: Any, /, task: Task) -> Future:  # type: ignore[override]
            if task.options.prompt == "stop":
                raise KeyboardInterrupt
            future: Future = Future()
            future.set_result(function(task))
            return future

    monkeypatch.setattr(clips, "write_clips", write_clips)
    monkeypatch.setattr(run, "processes", lambda workers, scratch: Here())
    monkeypatch.setattr(work, "QUEUED_PER_CORE", 1)
    monkeypatch.setattr(run, "cores", lambda: 1)
    return made


def batch(tmp_path: Path, *prompts: str) -> tuple[int, Path]:
    table = write(tmp_path / "list.csv", "prompt,seed\n" + "".join(f"{p},7\n" for p in prompts))
    return cli.main(["generate", "--batch", str(table), "--out", str(tmp_path / "clips")]), tmp_path / "clips"


def test_failures_are_listed_and_end_nothing(
    fake: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, folder = batch(tmp_path, "old", "fails", "breaks", "drunk")
    assert code == 1
    found = lines(folder)
    assert [line["error"] for line in found] == [
        None, "00002.bvh: cannot. Try another.", "ZeroDivisionError: a defect", None]  # fmt: skip
    assert (folder / "00004.bvh").read_text() == "drunk 7"
    assert found[3]["file"] == "00004.bvh"
    assert found[3]["sha256"] == sha256(folder / "00004.bvh")
    assert set(found[3]["files"]) == {"00004.bvh", "00004.bvh.json"}
    assert found[3]["arguments"] == {"prompt": "drunk", "seed": "7"}
    assert found[3]["notes"] == ["“drunk”: hardly shown"]
    assert found[3]["seconds"] >= 0.0
    said = capsys.readouterr()
    assert "2 of 4 clips" in said.out
    assert "2 failed" in said.out
    assert "sport: row 2: 00002.bvh: cannot. Try another." in said.err


def test_a_text_that_is_none_is_one_failure(fake: list[str], tmp_path: Path) -> None:
    table = write(tmp_path / "a.jsonl", '{"prompt": "a \\ud800"}\n{"prompt": "old"}\n')
    assert cli.main(["generate", "--batch", str(table), "--out", str(tmp_path / "clips")]) == 1
    assert [bool(line["error"]) for line in lines(tmp_path / "clips")] == [True, False]


@pytest.mark.parametrize(("link", "code"), [("sub", 1), ("a.bvh", 1), ("manifest.jsonl", 2)])
@pytest.mark.parametrize("there", [False, True], ids=["dangling", "led elsewhere"])
def test_no_link_in_the_folder_is_followed(
    link: str, code: int, there: bool, fake: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = write(tmp_path / "list.csv", "prompt,seed,out\nold,7,sub/a.bvh\ndrunk,7,a.bvh\n")
    folder, elsewhere = tmp_path / "clips", tmp_path / "elsewhere"
    folder.mkdir()
    if there and link == "sub":
        elsewhere.mkdir()
    elif there:
        elsewhere.write_text("mine")
    (folder / link).symlink_to(elsewhere)
    assert cli.main(["generate", "--batch", str(table), "--out", str(folder)]) == code
    assert f"{folder / link}: this is a link." in capsys.readouterr().err
    assert elsewhere.exists() == there
    assert not there or (not any(elsewhere.iterdir()) if link == "sub" else elsewhere.read_text() == "mine")


def test_a_second_run_makes_what_is_missing_changed_or_failed(fake: list[str], tmp_path: Path) -> None:
    assert batch(tmp_path, "old", "drunk", "fails", "proud")[0] == 1
    fake.clear()
    (tmp_path / "clips" / "00002.bvh").write_text("half")
    (tmp_path / "clips" / "00004.bvh.json").unlink()
    code, folder = batch(tmp_path, "old", "drunk", "tired", "proud", "new")
    assert code == 0
    assert fake == ["drunk", "tired", "proud", "new"]
    assert [line["row"] for line in lines(folder)] == [1, 2, 3, 4, 5]
    fake.clear()
    assert batch(tmp_path, "old", "drunk", "tired", "proud", "new")[0] == 0
    assert fake == []


def test_ctrl_c_leaves_whole_files_and_the_next_run_goes_on(fake: list[str], tmp_path: Path) -> None:
    code, folder = batch(tmp_path, "old", "drunk", "stop", "proud")
    assert code == 130
    assert sorted(p.name for p in folder.glob("*.bvh")) == ["00001.bvh", "00002.bvh"]
    with (folder / run.MANIFEST).open("a") as file:
        file.write('{"row": 3, "err')  # as a crash cuts it off
    fake.clear()
    code, folder = batch(tmp_path, "old", "drunk", "tired", "proud")
    assert code == 0
    assert fake == ["tired", "proud"]
    assert [line["row"] for line in lines(folder)] == [1, 2, 3, 4]


def test_two_batches_do_not_write_into_one_folder(
    fake: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "clips").mkdir()
    handle = open_locked(tmp_path / "clips" / ".sport-batch.lock", create=True)
    assert handle is not None
    assert batch(tmp_path, "old")[0] == 2
    os.close(handle)
    assert "another batch writes into it" in capsys.readouterr().err
    assert not fake


def test_workers_need_a_batch(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["generate", "--out", str(tmp_path / "a.bvh"), "--workers", "2"]) == 2
    assert "--workers: works with --batch only" in capsys.readouterr().err


@pytest.mark.parametrize("terminal", [True, False])
def test_progress_tells_speed_and_time_left(
    terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    progress = run.BatchProgress(32, 2, begun_s=time.monotonic() - 30.0)
    for number in range(30):
        progress.add(failed=number == 1)
    shown = capsys.readouterr().err
    assert "16 of 32 clips, 1 failed, 28.0 a minute, 34 s left" in shown
    assert shown.count("\n") == (1 if terminal else 10)


class Deadly:
    """Ends the process that unpickles it."""

    def __reduce__(self) -> tuple:
        return os._exit, (7,)


def test_a_worker_that_dies_costs_its_row_alone(tmp_path: Path) -> None:
    good = planned({"seconds": "0.1"}, {"seconds": "-1"})[0]
    bad = Task(9, {"deadly": Deadly()}, good[0].options, "")
    target = tmp_path / "clips"
    made = work.make_rows([bad, *good], target, lambda: work.processes(1), 1)
    found = {line["row"]: line for line in made}
    assert found[9]["error"] == "its worker process ended"
    assert found[1]["error"] is None
    assert "--seconds" not in found[2]["error"]
    assert "seconds -1: expected" in found[2]["error"]
    assert (target / "00001.bvh").is_file()


def test_a_batch_killed_half_way_goes_on_and_ends_complete(tmp_path: Path) -> None:
    """The real command with the shipped model; its clips are those of `sport generate`, byte by byte."""
    prompts = ["a proud walk", "drunk", "a proud walk", "drunk"]
    table = write(tmp_path / "list.jsonl", "".join(
        json.dumps({"prompt": p, "seed": k, "out": f"clip-{k}.bvh"}) + "\n" for k, p in enumerate(prompts)))  # fmt: skip
    folder = tmp_path / "clips"
    command = [sys.executable, "-m", "sport", "generate", "--batch", str(table), "--out", str(folder),
               "--seconds", "0.1", "--workers", "1"]  # fmt: skip
    process = subprocess.Popen(command, cwd=PROJECT_ROOT, stderr=subprocess.DEVNULL)
    try:
        end = time.monotonic() + 300.0  # on a busy machine
        while len(run.read_lines(folder / run.MANIFEST)) < 2:
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.01)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    before = run.read_lines(folder / run.MANIFEST)
    assert 2 <= len(before) < 4
    done = subprocess.run(command, cwd=PROJECT_ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert f"{len(before)} of 4 clips already exist" in done.stderr
    found = lines(folder)
    assert [line["row"] for line in found] == list(range(1, 5))
    names = {name for line in found for name in line["files"]}
    assert {p.name for p in folder.iterdir()} == names | {run.MANIFEST, ".sport-batch.lock"}
    for line in found:
        assert line["error"] is None
        assert sha256(folder / line["file"]) == line["sha256"]
    out = tmp_path / "clip-3.bvh"
    assert cli.main(["generate", "drunk", "--seed", "3", "--seconds", "0.1", "--out", str(out)]) == 0
    assert out.read_bytes() == (folder / "clip-3.bvh").read_bytes()
    assert (tmp_path / "clip-3.bvh.json").read_bytes() == (folder / "clip-3.bvh.json").read_bytes()
