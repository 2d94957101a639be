"""`python -m tests.fuzz [--count N] [--only NAME] [--first N] [--markdown FILE]`: a table of what came of N damaged inputs.

The exit code is 1 on a failure. `--markdown` puts the table into a document, whole: rows of several runs do not add up.

Each batch is a process of its own, so that one that crashes or is killed for memory costs its batch alone.
`--only NAME --first K --count 1` reads one input of the table again.
"""

import argparse
import multiprocessing
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from training.markdown import check_section, write_section

from .run import TARGETS, Tally, damaged, run_apart
from .target import Target

BATCH = 2000
SHOWN = 10  # failures of a target
SECTION = "damaged input"
HEAD = (
    "| reader | inputs | read | refused | failures | slowest, s | most, MB |",
    "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
)


def main() -> int:
    """Run the targets; 1 when an input made one fail."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="inputs in all")
    parser.add_argument("--only", default="", help="name of a target")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--keep", type=Path, help="write this one input to a file instead of reading it")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="put the table into this document")
    options = parser.parse_args()
    chosen = [target for target in TARGETS.values() if options.only in ("", target.name)]
    if not chosen:
        parser.error(f"--only: choose one of {', '.join(TARGETS)}")
    if options.markdown is not None:
        if options.only:
            parser.error("--markdown: the table is of all readers; leave --only out.")
        check_section(options.markdown, SECTION)
    if options.keep is not None:
        with tempfile.TemporaryDirectory(prefix="sport-fuzz-") as folder:
            options.keep.write_bytes(damaged(chosen[0], chosen[0].seeds(Path(folder)), options.first))
        return 0
    lines, failed = _table(chosen, options.first, options.count)
    if options.markdown is not None:
        write_section(options.markdown, SECTION, "\n".join(lines))
    return 1 if failed else 0


def _table(chosen: list[Target], first: int, count: int) -> tuple[list[str], int]:
    """The lines of the table, printed as they come, and the number of failures."""
    share = count / sum(target.weight for target in chosen)
    lines: list[str] = []

    def put(*added: str) -> None:
        lines.extend(added)
        print("\n".join(added), flush=True)

    put(*HEAD)
    total = Tally()
    for target in chosen:
        tally = _in_batches(target.name, first, max(1, round(share * target.weight)))
        put(row(target.name, tally))
        for number, problem in tally.failures[:SHOWN]:
            print(f"  {target.name} {number}: {problem}", file=sys.stderr, flush=True)
        total.add(tally)
    put(row("**all**", total))
    return lines, len(total.failures)


def row(name: str, tally: Tally) -> str:
    """A line of the table."""
    return (
        f"| {name} | {tally.inputs:,} | {tally.read:,} | {tally.refused:,} | {len(tally.failures):,} |"
        f" {tally.slowest_s:.2f} | {tally.most_mb:.0f} |"
    )


def _in_batches(name: str, first: int, count: int) -> Tally:
    tally = Tally()
    end = first + count
    with tempfile.TemporaryDirectory(prefix="sport-fuzz-") as folder:
        progress = Path(folder) / "number"
        while first < end:
            part, done = _batch(name, first, min(BATCH, end - first), progress)
            tally.add(part)
            first += done
    return tally


def _batch(name: str, first: int, count: int, progress: Path) -> tuple[Tally, int]:
    """What came of a batch and how many of its inputs were tried: a crash ends it at the input that did it."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        try:
            return pool.submit(run_apart, name, first, count, progress).result(), count
        except BrokenProcessPool as error:
            if not progress.is_file():  # not one input: a mistake of the target itself
                raise
            number, reason = int(progress.read_text(encoding="utf-8")), str(error)
    before = _batch(name, first, number - first, progress)[0] if number > first else Tally()
    before.add(Tally(inputs=1, failures=[(number, reason)]))
    return before, number - first + 1


if __name__ == "__main__":
    sys.exit(main())
