"""Speed of the exported networks in three forms, compared with each other and with memory bandwidth.

python -m benchmarks.networks                              layers of the shipped model, its own weights
python -m benchmarks.networks --preset paper               any preset, random weights (needs the extra `[train]`)

`plain` blends the content experts in every frame, `folded` folds them once per prompt, `int8` is `folded` with 8-bit
weights. One run measures all under the same conditions. `--markdown FILE` writes the table
between the lines `<!-- networks NAME: begin -->` and `<!-- networks NAME: end -->` of a document.
"""

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.timing import clock_and_processor_ms, cpu_name, times_ms
from runtime.arrays import Float32Array
from runtime.assets import PROJECT_ROOT
from runtime.atomic import temporary_folder
from runtime.errors import UsageError
from runtime.motion.model_files import FOLDED, INT8_GRAPH, open_graph, read_graph, read_metadata
from training.evaluation.experiment import Arguments, Experiment, Setting, option, run_alone
from training.markdown import table as markdown_table

Feed = dict[str, Float32Array]

BYTES = 256 << 20  # read in the bandwidth test, far larger than any cache
BATCHES = (1, 8, 32)
# Every row is timed in rounds minutes apart, so that temporary load from others does not affect single rows.
ROUNDS, ROUND_S = 3, 0.7  # time per row and round, with at least MIN_FRAMES
MIN_FRAMES, MAX_FRAMES, WARM_UP = 10, 350, 10
ERROR_FRAMES = 100


@dataclass(frozen=True)
class Variant:
    """A graph to time; `styles` is "shared" by the batch or "each" for one per character."""

    name: str
    path: Path
    data: bytes
    styles: str


def read_bandwidth(threads: int) -> float:
    """Return the read bandwidth of `threads` threads in GB/s: the best of eight searches for a maximum."""
    parts = np.array_split(np.ones(BYTES // 4, np.int32), threads)
    with ThreadPoolExecutor(threads) as pool:
        return BYTES / min(times_ms(lambda: list(pool.map(np.max, parts)), 8)) / 1e6


def figures_of(setting: Setting) -> dict[str, Any]:
    """Measure read bandwidth and all rows; returns them with a description of the machine."""
    preset, model = setting.args.preset, setting.folders[0]
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    with temporary_folder() as folder:
        variants = _variants(folder, preset, model)
        bandwidth = {count: read_bandwidth(count) for count in (1, 2) if count <= (os.cpu_count() or 1)}
        rows = measure(variants, bandwidth, _errors(variants) if preset else _known_errors(model))
    return {
        "network": preset or model.name,
        "cpu": cpu_name(),
        "cores": os.cpu_count(),
        "load": round(load, 2),
        "read_bandwidth_gb_s": {str(count): round(value, 1) for count, value in bandwidth.items()},
        "rows": rows,
    }


def _variants(folder: Path, preset: str | None, model: Path) -> list[Variant]:
    """Return untrained graphs for a preset; for a model its own graphs, and untrained ones where missing."""
    _untrained(folder, ["--preset", preset] if preset else ["--model", str(model)])
    metadata = {"sha256": {}} if preset else read_metadata(model)
    variants = []
    for name, graph, styles in (
        ("", "style", ("",)),
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
        variants += [Variant(name, path, data, way) for way in styles]
    return variants


def _untrained(folder: Path, arguments: list[str]) -> None:
    """A separate process: torch's threads and memory would be measured with the networks."""
    command = [sys.executable, "-m", "training.export.untrained", str(folder), *arguments]
    done = subprocess.run(command, cwd=PROJECT_ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise UsageError(f"networks to be timed: {last[:300]}", "Run pip install -e '.[train]'.")


def measure(
    variants: Sequence[Variant], bandwidth: dict[int, float], errors: dict[str, float]
) -> list[dict[str, Any]]:
    """Time every variant at every batch; the first is the style graph, which folds random prompts.

    A row has times in ms for the whole batch, `floor` for reading the weights once, and the graph's and folded
    weights' `megabytes`; `error` is that of y against `folded`, in standard deviations.
    """
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
    rows = []
    for (variant, batch, threads), times in frames.items():
        ms, processor = np.array(times).T
        megabytes = held[variant, batch, threads] / 1e6
        row_times = (np.median(ms), ms.min(), np.percentile(ms, 99), np.median(processor))
        rows.append(
            {
                **{"variant": variant.name, "styles": variant.styles, "batch": batch, "threads": threads},
                **dict(zip(("median", "fastest", "p99", "processor"), map(float, row_times), strict=True)),
                "floor": megabytes / bandwidth[threads],
                "megabytes": megabytes,
                "error": errors.get(variant.name),
            }
        )
    return rows


def _prompts(style: Variant) -> tuple[Float32Array, list[Feed]]:
    """Return random Z^t `(32, 6, 64)`, and their folded forms."""
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
    """Measure wall and CPU milliseconds of the frames of one round."""
    times_ms(lambda: session.run(None, feed), WARM_UP)
    times: list[tuple[float, float]] = []
    end = time.perf_counter() + ROUND_S
    while len(times) < MIN_FRAMES or (time.perf_counter() < end and len(times) < MAX_FRAMES):
        (ms,), (used,) = clock_and_processor_ms(lambda: session.run(None, feed), 1)
        times.append((ms, used))
    return times


def _errors(variants: Sequence[Variant]) -> dict[str, float]:
    """Measure the difference of each variant from the folded graph, on single frames with random inputs."""
    prompts, folds = _prompts(variants[0])
    outputs: dict[str, Float32Array] = {}
    for variant in {v.name: v for v in variants[1:]}.values():
        session, random, ys = open_graph(variant.path, variant.data, 1), np.random.default_rng(1), []
        for number in range(ERROR_FRAMES):
            own = slice(number % len(folds), number % len(folds) + 1)
            ys.append(session.run(["y"], _feed(session, 1, prompts[own], folds[own], "shared", random))[0])
        outputs[variant.name] = np.concatenate(ys)
    expected = outputs.pop("folded")
    scale = expected.std(0) + 1e-6
    spread = np.linalg.norm((expected - expected.mean(0)) / scale)
    return {name: float(np.linalg.norm((y - expected) / scale) / spread) for name, y in outputs.items()}


def _known_errors(model: Path) -> dict[str, float]:
    """Read the errors in the model's metadata, measured on its walks."""
    section = read_metadata(model).get("quantised", {})
    return {"folded int8": section["relative_error"]} if "relative_error" in section else {}


def table(figures: dict[str, Any]) -> str:
    """Return the figures as Markdown."""
    speeds = ", ".join(f"{v} GB/s on {n} thread(s)" for n, v in figures["read_bandwidth_gb_s"].items())
    about = f"network {figures['network']} on {figures['cpu']}, {figures['cores']} cores, load {figures['load']:.1f}"
    head = ["form", "styles", "batch", "threads", "ms median", "fastest", "p99", "processor ms", "floor"]
    rows = [
        [
            *(str(row[k]) for k in ("variant", "styles", "batch", "threads")),
            *(f"{row[k]:.2f}" for k in ("median", "fastest", "p99", "processor", "floor")),
            f"{row['megabytes']:.1f}",
            "" if row["error"] is None else f"{100 * row['error']:.2g} %",
        ]
        for row in figures["rows"]
    ]
    return "\n".join(
        [f"{about} at the start; reads {speeds}", "", *markdown_table([*head, "MB", "error"], rows)]
    )


def _check(args: Arguments) -> None:
    if args.preset and args.model:
        raise UsageError("--preset and --model: only one can be timed.", "Omit one.")


NETWORKS = Experiment(
    "Time the exported networks.",
    figures_of,
    table,
    lambda args: f"networks {args.preset or Setting(args).folders[0].name}",
    options=("model", option("--preset", help="random weights of this preset")),
    check=_check,
)

if __name__ == "__main__":
    raise SystemExit(run_alone(NETWORKS, "networks"))
