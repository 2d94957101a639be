"""Every reader meets a few dozen damaged inputs; `python -m tests.fuzz --count 100000` is the long run."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("onnx")
pytest.importorskip("openai")

from runtime.assets import PROJECT_ROOT
from runtime.errors import FileError
from tests.fuzz.run import TARGETS, Tally, run
from tests.fuzz.target import Target


@pytest.mark.parametrize("name", TARGETS)
def test_damage_ends_in_a_sentence(name: str, tmp_path: Path) -> None:
    count = max(3, round(20 * TARGETS[name].weight))
    tally = run(TARGETS[name], tmp_path, 0, count, measured=False)
    assert tally.failures == []
    assert tally.read + tally.refused == tally.inputs == count


def test_a_failure_is_found_and_the_damage_is_the_same_each_time(tmp_path: Path) -> None:
    seen: list[bytes] = []

    def read(_folder: Path, data: bytes) -> None:
        seen.append(data)
        if b"9" in data:
            raise KeyError("nine")
        if b"-" in data:
            raise FileError("two\nlines")

    target = Target(
        "numbers", lambda _: [b"1 2 3"], lambda rng, _: str(rng.randrange(-20, 20)).encode(), read
    )
    first, second = run(target, tmp_path, 0, 60), run(target, tmp_path, 0, 60)
    assert seen[: len(seen) // 2] == seen[len(seen) // 2 :]
    assert first.failures == second.failures
    assert {problem.split()[0] for _, problem in first.failures} == {"KeyError"}
    assert first.refused > 0


def test_batches_survive_a_crash(tmp_path: Path) -> None:
    total = Tally()
    total.add(Tally(2, 1, 0, 0.5, 3.0, [(1, "x")]))
    total.add(Tally(1, 1, 0, 0.1, 9.0, []))
    assert (total.inputs, total.read, total.slowest_s, total.most_mb) == (3, 2, 0.5, 9.0)
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", "--count", "5", "--only=--blend-weights"],
        cwd=PROJECT_ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "| --blend-weights | 5 |" in done.stdout


def test_the_table_in_the_document_has_every_reader_and_adds_up() -> None:
    text = (PROJECT_ROOT / "docs/results/damaged_input.md").read_text(encoding="utf-8")
    table = text.partition("<!-- damaged input: begin -->")[2].partition("<!-- damaged input: end -->")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.strip().splitlines()[2:]]
    figures = {name: [int(cell.replace(",", "")) for cell in cells[:4]] for name, *cells in rows}
    total = figures.pop("**all**")
    assert list(figures) == list(TARGETS)
    assert [sum(column) for column in zip(*figures.values(), strict=True)] == total
    assert all(read + refused + failed == inputs for inputs, read, refused, failed in figures.values())
