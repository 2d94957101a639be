"""`python -m tests.full_disk [--only ENDING]`: every format onto a full disk of its own (as root), as a table."""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.full_disk.writing import ROOM_KB, session, writers

DISK_KB = 320
SESSION = {"out.sport", "out.sport-wal", "out.sport-shm", ".out.sport.lock"}  # what was recorded stays


def main() -> int:
    """Print a row for each format; 1 when anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="endings that hold this")
    options = parser.parse_args()
    bad = 0
    print("| ending | writes | whole | refused | wrong |\n| --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as disk, tempfile.TemporaryDirectory() as folder:
        copied = Path(folder) / "a.sport"
        session(copied)
        for ending in writers(copied):
            if options.only in ending:
                bad += one(ending, Path(disk), copied)
    return int(bad > 0)


def one(ending: str, disk: Path, copied: Path) -> int:
    """Print the row of an ending; how many writes went wrong. A session of a megabyte is copied onto the disk, too."""
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK_KB}k", "tmpfs", str(disk)]
    subprocess.run(mount, check=True)
    try:
        command = [sys.executable, "-m", "tests.full_disk.writing", ending, str(disk), str(copied)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    finally:
        subprocess.run(["umount", str(disk)], check=True)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    found = [line for line in lines if "kb" in line]
    wrong = [
        line for line in found
        if {*line["left"]} - SESSION or not line["kept"] or line["said"].startswith("DEFECT") or "Error" in line["said"]
    ]  # fmt: skip
    whole = sum(not line["said"] for line in found)
    crashed = len(found) < 2 * len(ROOM_KB)
    counts = f"{len(found)} | {whole} | {len(found) - whole} | {len(wrong) + crashed}"
    print(f"| {ending} | {counts} |", flush=True)
    for line in wrong[:40]:
        print(f"{ending}: {line}", file=sys.stderr)
    if crashed:
        at = f"{lines[-1:]}: {done.stderr[-600:]}"
        print(f"{ending}: ended with {done.returncode} at {at}", file=sys.stderr)
    elif done.stderr:
        print(f"{ending}: {done.stderr[-300:]}", file=sys.stderr)
    return len(wrong) + crashed


if __name__ == "__main__":
    sys.exit(main())
