"""Clips a minute of `sport generate --batch` beside processes that write no manifest: python -m benchmarks.batch [--clips 40] [--seconds 4].

Both make the same clips on the same number of cores, start of the processes included. `cpu_share` compares the
processor's time in place of the clock's, which other programs on the machine do not change.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from runtime.atomic import write_atomic
from runtime.errors import run_command

PROMPTS = ("a proud walk", "drunk", "an old man", "march like a soldier")


def make_clips(folder: Path, numbers: list[int], seconds: float) -> None:
    """What a process without a manifest does: load once, then clip after clip."""
    from runtime.formats.prepare import ExportOptions
    from runtime.formats.table import save_motion
    from runtime.generate import generate_clip
    from runtime.motion.model import load_model
    from runtime.prompts.prompter import Prompter

    model = load_model(None)
    prompter = Prompter(model)
    for k in numbers:
        prompt = PROMPTS[k % len(PROMPTS)]
        clip = generate_clip(prompt, seconds=seconds, seed=k, model=model, prompter=prompter)
        save_motion(clip, folder / f"{k:05d}.bvh", ExportOptions())


def by_processes(folder: Path, clips: int, seconds: float, workers: int) -> None:
    """Every process makes its share of the clips."""
    context = multiprocessing.get_context("spawn")
    team = [
        context.Process(target=make_clips, args=(folder, list(range(first, clips, workers)), seconds))
        for first in range(workers)
    ]
    for process in team:
        process.start()
    for process in team:
        process.join()
    if any(process.exitcode for process in team):
        raise RuntimeError("a process failed")


def by_batch(folder: Path, clips: int, seconds: float, workers: int) -> None:
    """The command."""
    rows = [{"prompt": PROMPTS[k % len(PROMPTS)], "seed": k, "out": f"{k:05d}.bvh"} for k in range(clips)]
    table = folder / "list.jsonl"
    table.write_text("".join(json.dumps(row) + "\n" for row in rows))
    command = [sys.executable, "-m", "sport", "generate", "--batch", str(table), "--out", str(folder / "clips"),
               "--seconds", f"{seconds:g}", "--workers", f"{workers}"]  # fmt: skip
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def measure(clips: int, seconds: float, workers: int) -> dict[str, float]:
    """Both ways, one after the other."""
    figures: dict[str, float] = {"clips": clips, "seconds": seconds, "workers": workers}
    for name, make in (("batch", by_batch), ("processes", by_processes)):
        with tempfile.TemporaryDirectory() as folder:
            begin, cpu = time.perf_counter(), _cpu_s()
            make(Path(folder), clips, seconds, workers)
            figures[f"{name}_a_minute"] = 60.0 * clips / (time.perf_counter() - begin)
            figures[f"{name}_cpu_s"] = _cpu_s() - cpu
    figures["share"] = figures["batch_a_minute"] / figures["processes_a_minute"]
    figures["cpu_share"] = figures["processes_cpu_s"] / figures["batch_cpu_s"]
    return figures


def _cpu_s() -> float:
    """Processor's time of all processes that have ended below this one."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.batch", description=__doc__)
    parser.add_argument("--clips", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each clip")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    text = json.dumps(measure(args.clips, args.seconds, args.workers), indent=1)
    print(text)
    if args.json is not None:
        write_atomic(args.json, text + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("batch", main))
