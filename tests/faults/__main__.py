"""`python -m tests.faults [--times N] [--seconds S]`: every fault N times, as a table; 1 when anything more was lost."""

import argparse
import sys
import tempfile
from pathlib import Path

from tests.faults.faults import all_faults


def main() -> int:
    """Make the faults and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=3.0, help="recorded before the fault")
    parser.add_argument("--only", default="", help="faults whose name holds this")
    options = parser.parse_args()
    bad = 0
    print(
        "| fault | times | most lost (s) | exit codes | the take is in | failures |\n| --- | --- | --- | --- | --- | --- |"
    )
    for name, fault in all_faults().items():
        if options.only not in name:
            continue
        outcomes = []
        for _ in range(options.times):
            with tempfile.TemporaryDirectory() as folder:
                outcomes.append(fault(Path(folder), options.seconds))
        problems = [problem for outcome in outcomes for problem in outcome.problems]
        bad += len(problems)
        codes = ", ".join(map(str, sorted({outcome.code for outcome in outcomes})))
        worst = max(outcome.lost_s for outcome in outcomes)
        counts = f"{worst:.2f} | {codes} | {outcomes[0].where} | {len(problems)}"
        print(f"| {name} | {len(outcomes)} | {counts} |", flush=True)
        for problem in problems:
            print(f"{name}: {problem}", file=sys.stderr)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
