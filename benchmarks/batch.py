"""Clips per minute of `sport generate --batch`: python -m benchmarks.batch [--clips 40] [--seconds 4]."""

import json
import os
import subprocess
import sys
from pathlib import Path

from benchmarks.timing import times_ms
from runtime.atomic import temporary_folder
from training.evaluation.experiment import Experiment, Setting, option, run_alone

PROMPTS = ("a proud walk", "drunk", "an old man", "march like a soldier")


def make_clips(folder: Path, clips: int, seconds: float, workers: int) -> None:
    """Run the command, including the start of its processes."""
    rows = [{"prompt": PROMPTS[k % len(PROMPTS)], "seed": k, "out": f"{k:05d}.bvh"} for k in range(clips)]
    table = folder / "list.jsonl"
    table.write_text("".join(json.dumps(row) + "\n" for row in rows))
    command = [sys.executable, "-m", "sport", "generate", "--batch", str(table), "--out", str(folder / "clips"),
               "--seconds", f"{seconds:g}", "--workers", f"{workers}"]  # fmt: skip
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def clips_a_minute(setting: Setting) -> str:
    """Measure; returns the result as a sentence."""
    args = setting.args
    os.environ["OMP_NUM_THREADS"] = "1"
    with temporary_folder() as folder:
        ms = times_ms(lambda: make_clips(folder, args.clips, args.seconds, args.workers), 1)[0]
    rate = 6e4 * args.clips / ms
    return f"{args.clips} clips of {args.seconds:g} s on {args.workers} workers: {rate:.1f} per minute"


BATCH = Experiment(
    __doc__,
    clips_a_minute,
    str,
    "batch",
    options=(
        option("--clips", type=int, default=40),
        option("--seconds", type=float, default=4.0, help="length of each clip"),
        option("--workers", type=int, default=2),
    ),
)

if __name__ == "__main__":
    raise SystemExit(run_alone(BATCH, "batch"))
