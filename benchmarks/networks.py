"""The exported networks in three forms, against each other and against the memory that they have to read.

python -m benchmarks.networks                              layers of the shipped model, its own weights
python -m benchmarks.networks --preset paper               any preset, random weights (needs the extra `[train]`)

`plain` blends the content experts in every frame, `folded` has them folded once for each prompt, `int8` is the same with
8-bit weights. One run measures all, so that they are compared under the same conditions. `--markdown FILE` puts the table
between the lines `<!-- networks NAME: begin -->` and `<!-- networks NAME: end -->` of a document.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench import cpu_name
from runtime.arrays import Float32Array
from runtime.assets import PROJECT_ROOT, model_folder
from runtime.atomic import check_target, write_atomic
from runtime.errors import UsageError, run_command
from runtime.motion.model_files import FOLDED, INT8_GRAPH, open_graph, read_graph, read_metadata
from training.markdown import check_section, write_section

BYTES = 256 << 20  # well beyond any cache


def read_bandwidth(threads: int, repeats: int = 8) -> float:
    """GB/s at which `threads` threads read together: the best of `repeats` searches for a maximum."""
    parts = np.array_split(np.ones(BYTES // 4, np.int32), threads)
    best = float("inf")
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(repeats):
            begin = time.perf_counter()
            list(pool.map(np.max, parts))
            best = min(best, time.perf_counter() - begin)
    return BYTES / best / 1e9


Feed = dict[str, Float32Array]

BATCHES = (1, 8, 32)
# Every row is timed in rounds minutes apart: other tenants of a machine come and go, and would else decide single rows.
ROUNDS, SECONDS = 3, 0.7  # seconds of a row in each round, and at least MIN_FRAMES
MIN_FRAMES, MAX_FRAMES, WARM_UP = 10, 350, 10
ERROR_FRAMES = 100


@dataclass(frozen=True)
class Variant:
    """A graph to be timed; `styles` is "shared" by the batch or one for "each" character."""

    name: str
    path: Path
    data: bytes
    styles: str


@dataclass(frozen=True)
class TimingRow:
    """One line of the table; times in ms for the whole batch."""

    variant: str
    styles: str
    batch: int
    threads: int
    median: float
    fastest: float
    p99: float
    processor: float  # processor time, all threads, median
    floor: float  # weights once through at this run's read bandwidth
    megabytes: float  # graph and folded weights of the batch
    relative_error: float | None  # from `folded`, of y around its mean in standard deviations


def main(argv: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="benchmarks.networks", description="Time the exported networks.")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--preset", help="random weights of this preset")
    which.add_argument(
        "--model", type=model_folder, metavar="DIR", help="exported model (default: the shipped one)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="put the table into this document")
    options = parser.parse_args(argv)
    return run(options.json, options.preset, options.model, options.markdown)


def run(
    json_path: Path | None,
    preset: str | None = None,
    model: Path | None = None,
    markdown: Path | None = None,
) -> int:
    """Measure, print a table, write `json_path` and put the table into `markdown`; the exit code."""
    if json_path is not None:
        check_target(json_path)
    threads = [count for count in (1, 2) if count <= (os.cpu_count() or 1)]
    model = model or model_folder()
    network = preset or model.name
    if markdown is not None:
        check_section(markdown, f"networks {network}")
    load = others_load()
    with tempfile.TemporaryDirectory() as folder:
        variants = _variants(Path(folder), preset, model)
        bandwidth = {count: read_bandwidth(count) for count in threads}
        rows = measure(variants, bandwidth, _errors(variants) if preset else _known_errors(model))
    figures = {
        "network": network,
        "cpu": cpu_name(),
        "cores": os.cpu_count(),
        "cores_busy": None if load is None else round(load, 2),
        "read_bandwidth_gb_s": {str(count): round(value, 1) for count, value in bandwidth.items()},
        "rows": [asdict(row) for row in rows],
    }
    print(table(figures))
    if markdown is not None:
        write_section(markdown, f"networks {network}", table(figures))
    if json_path is not None:
        write_atomic(json_path, json.dumps(figures, indent=1) + "\n")
    return 0


def others_load(seconds: float = 2.0) -> float | None:
    """Cores that other processes keep busy just now; None where the system does not say (/proc/stat)."""

    def busy() -> tuple[float, float]:
        fields = [int(field) for field in Path("/proc/stat").read_text(encoding="ascii").split()[1:9]]
        return sum(fields) - fields[3] - fields[4], sum(fields)  # without idle and waiting for a disk

    try:
        before = busy()
        time.sleep(seconds)
        after = busy()
    except (OSError, ValueError):
        return None
    return (os.cpu_count() or 1) * (after[0] - before[0]) / max(1.0, after[1] - before[1])


def _variants(folder: Path, preset: str | None, model: Path) -> list[Variant]:
    """Untrained graphs for a preset; for a model its own, and untrained ones for those that it lacks."""
    _untrained(folder, ["--preset", preset] if preset else ["--model", str(model)])
    metadata = {"sha256": {}} if preset else read_metadata(model)
    variants = []
    for name, graph, styles in (
        ("", "style", ()),
        ("plain", "plain", ("each",)),
        ("folded", "step", ("shared", "each")),
        ("folded int8", INT8_GRAPH, ("shared", "each")),
    ):
        if graph in metadata["sha256"]:
            path, data = model / f"{graph}.onnx", read_graph(model, graph, metadata)
        else:
            path = folder / f"{graph}.onnx"
            data = path.read_bytes()
            name += "" if preset else " (random weights)"
        variants += [Variant(name, path, data, way) for way in styles or ("",)]
    return variants


def _untrained(folder: Path, arguments: list[str]) -> None:
    """A process of its own: torch's threads and memory would be measured with the networks."""
    command = [sys.executable, "-m", "training.export.untrained", str(folder), *arguments]
    done = subprocess.run(command, cwd=PROJECT_ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise UsageError(f"networks to be timed: {last[:300]}", "Run pip install -e '.[train]'.")


def measure(
    variants: Sequence[Variant], bandwidth: dict[int, float], errors: dict[str, float]
) -> list[TimingRow]:
    """Time every variant at every batch; the first is the style graph, which folds random prompts."""
    prompts, folds = _prompts(variants[0])
    random = np.random.default_rng(0)
    frames: dict[tuple[Variant, int, int], list[tuple[float, float]]] = {}
    held: dict[tuple[Variant, int, int], int] = {}
    for _, variant, threads in product(range(ROUNDS), variants[1:], bandwidth):
        session = open_graph(variant.path, variant.data, threads)
        for batch in BATCHES:
            if batch == 1 and variant.styles == "each" and "z" not in _sizes(session):
                continue  # the same as one shared style
            feed = _feed(session, batch, prompts, folds, variant.styles, random)
            row = variant, batch, threads
            held[row] = len(variant.data) + sum(feed[name].nbytes for name in FOLDED if name in feed)
            frames.setdefault(row, []).extend(_times(session, feed))
    return [
        TimingRow(
            variant.name,
            variant.styles,
            batch,
            threads,
            *_figures(times),
            floor=held[variant, batch, threads] / bandwidth[threads] / 1e6,
            megabytes=held[variant, batch, threads] / 1e6,
            relative_error=errors.get(variant.name),
        )
        for (variant, batch, threads), times in frames.items()
    ]


def _prompts(style: Variant) -> tuple[Float32Array, list[Feed]]:
    """Random Z^t `(32, 6, 64)`, and each folded."""
    session = open_graph(style.path, style.data, 1)
    shape = session.get_inputs()[0].shape
    prompts = np.random.default_rng(2).standard_normal((max(BATCHES), *shape), np.float32)
    return prompts, [dict(zip(FOLDED, session.run(list(FOLDED), {"z": z}), strict=True)) for z in prompts]


def _sizes(session: Any) -> dict[str, list[int]]:
    return {value.name: value.shape for value in session.get_inputs()}


def _feed(
    session: Any, batch: int, prompts: Float32Array, folds: list[Feed], styles: str, random: Any
) -> Feed:
    sizes = _sizes(session)
    feed = {n: random.standard_normal((batch, *sizes[n][1:]), np.float32) for n in ("x", "noise")}
    if "z" in sizes:
        return feed | {"z": prompts[:batch].reshape(batch, -1)}
    chosen = folds[: batch if styles == "each" else 1]
    return feed | {name: np.stack([fold[name] for fold in chosen]) for name in FOLDED}


def _times(session: Any, feed: Feed) -> list[tuple[float, float]]:
    """Seconds and processor seconds of the frames of one round."""
    for _ in range(WARM_UP):
        session.run(None, feed)
    times: list[tuple[float, float]] = []
    end = time.perf_counter() + SECONDS
    while len(times) < MIN_FRAMES or (time.perf_counter() < end and len(times) < MAX_FRAMES):
        begin, used = time.perf_counter(), time.process_time()
        session.run(None, feed)
        processor = time.process_time() - used
        times.append((time.perf_counter() - begin, processor))
    return times


def _figures(times: Sequence[tuple[float, float]]) -> tuple[float, float, float, float]:
    """Median, fastest and 99th percentile of the time, and the median of the processor time, in ms."""
    ms, processor = 1e3 * np.array(times).T
    return float(np.median(ms)), float(ms.min()), float(np.percentile(ms, 99)), float(np.median(processor))


def _errors(variants: Sequence[Variant]) -> dict[str, float]:
    """Of single frames on random inputs, by variant: the difference from the folded graph."""
    prompts, folds = _prompts(variants[0])
    outputs: dict[str, Float32Array] = {}
    for variant in variants[1:]:
        session, random, ys = open_graph(variant.path, variant.data, 1), np.random.default_rng(1), []
        for number in range(0 if variant.name in outputs else ERROR_FRAMES):
            own = slice(number % len(folds), number % len(folds) + 1)
            ys.append(session.run(["y"], _feed(session, 1, prompts[own], folds[own], "shared", random))[0])
        outputs.setdefault(variant.name, np.concatenate(ys) if ys else np.zeros(0, np.float32))
    expected = outputs.pop("folded")
    scale = expected.std(0) + 1e-6
    spread = np.linalg.norm((expected - expected.mean(0)) / scale)
    return {name: float(np.linalg.norm((y - expected) / scale) / spread) for name, y in outputs.items()}


def _known_errors(model: Path) -> dict[str, float]:
    """What the model's own metadata say, measured on its walks."""
    section = read_metadata(model).get("quantised", {})
    return {"folded int8": section["relative_error"]} if "relative_error" in section else {}


def table(figures: dict[str, Any]) -> str:
    """The figures as Markdown."""
    speeds = ", ".join(f"{v} GB/s on {n} thread(s)" for n, v in figures["read_bandwidth_gb_s"].items())
    busy = "an unknown number" if figures["cores_busy"] is None else f"{figures['cores_busy']:.1f}"
    return "\n".join(
        [
            f"network {figures['network']} on {figures['cpu']}, {figures['cores']} cores, {busy} of them busy"
            f" with other work at the start; reads {speeds}",
            "",
            *_lines(TimingRow(**row) for row in figures["rows"]),
        ]
    )


def _lines(rows: Iterable[TimingRow]) -> Iterable[str]:
    yield "| form | styles | batch | threads | ms median | fastest | p99 | processor ms | floor | MB | error |"
    yield "| --- | --- | --: | --: | --: | --: | --: | --: | --: | --: | --: |"
    for row in rows:
        error = "" if row.relative_error is None else f"{100 * row.relative_error:.2g} %"
        yield (
            f"| {row.variant} | {row.styles} | {row.batch} | {row.threads} | {row.median:.2f} | {row.fastest:.2f}"
            f" | {row.p99:.2f} | {row.processor:.2f} | {row.floor:.2f} | {row.megabytes:.1f} | {error} |"
        )


if __name__ == "__main__":
    raise SystemExit(run_command("networks", main))
