"""Trains a rival network on imported clips and writes it as a model folder, as the viewer loads them.

    python -m training.baselines pfnn --clips DIR --out RUNS/pfnn/seed0/model [--steps 20000] [--seed 0]

The loss is the mean squared error of normalised y, as all of these papers have it. The optimiser is AdamW with a cosine to zero.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from runtime.arrays import Array
from runtime.assets import model_folder
from runtime.atomic import write_atomic
from runtime.controls import Gait
from runtime.errors import FileError
from runtime.motion.features import INPUT, INPUT_SIZE, LAYOUT_VERSION, OUTPUT, OUTPUT_SIZE, C, L
from runtime.motion.model import load_model
from runtime.motion.model_files import read_metadata
from runtime.prompts.prompter import Prompter
from runtime.skeleton import SPORT_SKELETON
from training.baselines.motion_matching import MIN_FRAMES, ROLLOUTS, speeds
from training.baselines.networks import Baseline, FilmModulated, PhaseFunctioned, StyleByLabel
from training.baselines.phases import phase_vectors, windows
from training.evaluation.metrics.motion import original_clips
from training.evaluation.motion.evaluated_model import style_texts
from training.export.graph import export_graph
from training.frames import LAYERED, PLAIN, ClipFrames, clip_frames
from training.presets import preset

Report = Callable[[str], None]

LEAST_DEVIATION = 1e-2  # of x and y in physical units: what never changes is not blown up
LIMIT = 5.0  # deviations that a normalised input may have


@dataclass(frozen=True)
class LabelledFrames:
    """Training frames of many clips: x `(N, 472)`, y `(N, 473)`, and the style of each."""

    x: Array
    y: Array
    style: NDArray[np.integer]
    styles: tuple[str, ...]


def frames_of(clip: ClipFrames) -> tuple[Array, Array]:
    """x and y of a clip on its own ground, with phases out of its contacts."""
    y = clip.y.astype(np.float32)
    x = np.zeros((len(y), INPUT_SIZE), np.float32)
    x[:, : INPUT["phase"].start] = clip.x
    x[:, INPUT["heights"]] = clip.heights[:, 0]
    x[:, INPUT["joint_positions"]][:, 1::3] -= clip.previous_ground[:, :1]
    y[:, OUTPUT["joint_positions"]][:, 1::3] -= clip.ground[:, :1]
    before, after = windows(phase_vectors(y[:, OUTPUT["contacts"]] > 0.5))
    x[:, INPUT["phase"]], y[:, OUTPUT["phase"]] = before.reshape(len(x), -1), after.reshape(len(y), -1)
    return x, y


def read_frames(folder: Path, method: Method, most: int, seed: int, report: Report) -> LabelledFrames:
    """Frames of the captured clips that training sees, up to `most`, clips at random; FileError where there is none."""
    paths = original_clips(folder)
    order = np.random.default_rng(seed).permutation(len(paths))
    xs, ys, labels, count = [], [], [], 0
    for number in order:
        if count >= most:
            break
        with np.load(paths[number], allow_pickle=False) as file:
            rollout, style = str(file["source"]) == ROLLOUTS, str(file["style"])
            skipped = str(file["split"]) == "held_out" or str(file["tier"]) == LAYERED
            skipped |= bool(file["mirrored"]) or len(file["gait"]) < MIN_FRAMES
            skipped |= rollout and not method.rollouts
            skipped |= method.neutral and not style.startswith(PLAIN)
        if skipped:
            continue
        x, y = frames_of(clip_frames(paths[number]))
        xs.append(x.astype(np.float16))
        ys.append(y.astype(np.float16))
        labels.append(PLAIN if method.neutral else style)
        count += len(x)
    if not xs:
        raise FileError(f"{folder}: no clips to train on.", "Import captured clips first.")
    report(f"{count} frames of {len(xs)} clips")
    styles = tuple(sorted(set(labels)))
    index = np.repeat([styles.index(s) for s in labels], [len(x) for x in xs])
    return LabelledFrames(np.concatenate(xs), np.concatenate(ys), index, styles)


@dataclass(frozen=True)
class Method:
    """One rival: its network, and which clips it learns from."""

    name: str
    network: Callable[[int, int], Baseline]  # styles, hidden width
    hidden: int = 512
    neutral: bool = False  # neutral styles alone, as one
    rollouts: bool = False  # terrain rollouts too


METHODS = {
    "pfnn": Method("pfnn", lambda s, h: PhaseFunctioned(s, h), neutral=True, rollouts=True),
    "mason2022": Method("mason2022", lambda s, h: FilmModulated(s, h)),
    "style-label": Method(
        "style-label", lambda s, h: StyleByLabel(s, replace(preset("small"), hidden=h)), hidden=128
    ),
}


def fit(
    network: Baseline, frames: LabelledFrames, steps: int, batch: int, rate: float, seed: int, report: Report
) -> float:
    """Train in place; the mean loss of the last tenth of the steps."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    sample = rng.choice(len(frames.x), min(len(frames.x), 20_000), replace=False)
    for name, chosen in (("x", frames.x[sample]), ("y", frames.y[sample])):
        values = torch.from_numpy(chosen.astype(np.float32))
        getattr(network, f"{name}_mean").copy_(values.mean(0))
        getattr(network, f"{name}_deviation").copy_(values.std(0).clamp_min(LEAST_DEVIATION))
    trained = [p for p in network.parameters() if p.requires_grad]
    optimiser = torch.optim.AdamW(trained, rate, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    network.train()
    losses = []
    for step in range(steps):
        rows = rng.integers(0, len(frames.x), batch)
        x, y = (torch.from_numpy(v[rows].astype(np.float32)) for v in (frames.x, frames.y))
        label = nn.functional.one_hot(torch.from_numpy(frames.style[rows]), len(frames.styles)).float()
        made = network.normalised(scaled(network, x), x, label)
        loss = (made - (y - network.y_mean) / network.y_deviation).square().mean()
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(trained, 1.0)
        optimiser.step()
        schedule.step()
        losses.append(float(loss.detach()))
        if step % max(1, steps // 20) == 0:
            report(f"step {step}: {np.mean(losses[-100:]):.4f}")
    network.eval()
    return float(np.mean(losses[-max(1, steps // 10) :]))


def scaled(network: Baseline, x: Tensor) -> Tensor:
    """Normalised x, within LIMIT."""
    return ((x - network.x_mean) / network.x_deviation).clamp(-LIMIT, LIMIT)


class LabelGraph(nn.Module):
    """Z^t `(6, 64)` to the label of the nearest description, in the form of a folded style, and its speeds."""

    def __init__(self, codes: Array, labels: NDArray[np.integer], pace: Array) -> None:
        super().__init__()
        self.register_buffer("codes", torch.from_numpy(codes.reshape(len(codes), -1).astype(np.float32)))
        one_hot = np.eye(len(pace), dtype=np.float32)[labels]
        self.register_buffer("labels", torch.from_numpy(one_hot))
        self.register_buffer("pace", torch.from_numpy(pace.astype(np.float32)))
        self.codes: Tensor
        self.labels: Tensor
        self.pace: Tensor

    def forward(self, z: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """One-hot label `(S,)`, two empty tensors, and walking and jogging speed."""
        away = (self.codes - z.reshape(1, -1)).square().sum(1)
        nearest = (away <= away.min()).to(z.dtype)
        label = (nearest[:, None] * self.labels).sum(0) / nearest.sum()
        nothing = 0.0 * z.reshape(-1)[:1]
        return label, nothing, nothing.clone(), label @ self.pace


class BaselineStepGraph(nn.Module):
    """A frame in the form of our step graph; noise and the empty tensors change nothing."""

    def __init__(self, network: Baseline) -> None:
        super().__init__()
        self.network = network

    def forward(
        self, x: Tensor, noise: Tensor, front_bias: Tensor, content_weight: Tensor, content_bias: Tensor
    ) -> tuple[Tensor, Tensor]:
        """y and a share of one."""
        network = self.network
        label = front_bias.expand(x.shape[0], -1) + 0.0 * (content_weight.sum() + content_bias.sum())
        y = network.normalised(scaled(network, x), x, label)
        y = y * network.y_deviation + network.y_mean
        rest = 0.0 * noise.sum((1, 2, 3))[:, None]
        return y + rest, torch.ones_like(rest)


def export(network: Baseline, frames: LabelledFrames, beside: Path, out: Path, notes: dict[str, Any]) -> Path:
    """Write a model folder: our three graphs, of which the text side is that of the model `beside`."""
    out.mkdir(parents=True, exist_ok=True)
    shutil.copy(beside / "prompt.onnx", out / "prompt.onnx")
    to_style = Prompter(load_model(beside))
    texts = style_texts(frames.styles)
    codes = {s: [to_style(d) for d in texts[s]] for s in frames.styles}
    labels = np.repeat(np.arange(len(frames.styles)), [len(codes[s]) for s in frames.styles])
    gait = frames.x[:, INPUT["gait"]].reshape(len(frames.x), L, -1)[:, L // 2].argmax(1)
    root = frames.y[:, OUTPUT["root"]].astype(np.float32)
    pace = speeds(root, gait, frames.style, len(frames.styles))
    every = np.concatenate([np.stack(codes[s]) for s in frames.styles])
    names = ("front_bias", "content_weight", "content_bias")
    export_graph(
        LabelGraph(every, labels, pace),
        (torch.zeros(6, 64),),
        ("z",),
        (*names, "speeds"),
        ({},),
        out / "style.onnx",
    )
    batch = torch.export.Dim("batch", min=1, max=64)
    example = (
        torch.zeros(2, INPUT_SIZE), torch.zeros(2, 1, 1, OUTPUT_SIZE), torch.ones(2, len(frames.styles)) / len(frames.styles),
        torch.zeros(2, 1), torch.zeros(2, 1),
    )  # fmt: skip
    shapes = tuple({0: batch} for _ in example)
    export_graph(
        BaselineStepGraph(network), example, ("x", "noise", *names), ("y", "alpha"), shapes, out / "step.onnx"
    )
    stands = np.flatnonzero(gait == Gait.STAND)
    start = frames.y[stands[0] if len(stands) else 0].astype(float)
    told = read_metadata(beside)
    metadata: dict[str, Any] = {
        "format": "sport-model",
        "layout_version": LAYOUT_VERSION,
        "name": str(notes["method"]),
        "decoder": str(notes["method"]),
        "config": {"output_size": OUTPUT_SIZE, "experts": 1, "style_size": 384},
        "parameters": sum(p.numel() for p in network.parameters() if p.requires_grad),
        "reverse_steps": [0],
        "joints": list(SPORT_SKELETON.names),
        "styles": list(frames.styles),
        "sha256": {
            n: hashlib.sha256((out / f"{n}.onnx").read_bytes()).hexdigest()
            for n in ("prompt", "style", "step")
        },
        "start": {"output": start.tolist(), "phase": [0.0, 1.0] * (C * (L + 1))},
        "notes": notes,
    }
    metadata |= {k: told[k] for k in ("text_encoder", "text_encoder_sha256") if k in told}
    write_atomic(out / "metadata.json", json.dumps(metadata, indent=1) + "\n")
    return out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What the command needs."""
    parser.add_argument("--clips", type=Path, required=True, metavar="DIR", help="folder of imported clips")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="model folder to write")
    parser.add_argument("--model", type=model_folder, metavar="DIR", help="whose prompts it understands")
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--rate", type=float, default=1e-3, help="of learning, at first")
    parser.add_argument(
        "--hidden", type=int, metavar="N", help="width (default: that of the paper, or of preset small)"
    )
    parser.add_argument("--frames", type=int, default=600_000, help="at most; clips are taken at random")
    parser.add_argument("--seed", type=int, default=0)


def main(args: argparse.Namespace, report: Report) -> Path:
    """Train and export."""
    method = METHODS[args.method]
    frames = read_frames(args.clips, method, args.frames, args.seed, report)
    torch.manual_seed(args.seed)
    network = method.network(len(frames.styles), args.hidden or method.hidden)
    loss = fit(network, frames, args.steps, args.batch, args.rate, args.seed, report)
    notes = {"method": method.name, "steps": args.steps, "batch": args.batch, "seed": args.seed, "loss": loss}
    return export(network, frames, args.model or model_folder(), args.out, notes)
