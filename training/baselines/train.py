"""Trains the network of another method on imported clips and writes a model folder for the viewer.

    python -m training.ablations --clips DIR --out RUNS --only pfnn --baseline-steps 20000

The loss is the mean squared error of normalised y, as in all of these papers. The optimiser is AdamW with cosine decay to zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.errors import FileError
from runtime.motion.features import INPUT, INPUT_SIZE, OUTPUT, OUTPUT_SIZE, C, L
from runtime.motion.model_files import FOLDED
from training.baselines import folders, networks
from training.baselines.folders import Order, Report
from training.baselines.networks import Baseline
from training.evaluation.motion.capture import TERRAIN_GROUP, ClipInfo
from training.export.graph import export_graph
from training.frames import PLAIN, ClipFrames, clip_frames
from training.presets import preset

MIN_DEVIATION = 1e-2  # of x and y in physical units, so that constant entries are not amplified
MAX_FRAMES = 600_000  # of randomly chosen clips
BATCH, MAX_LEARNING_RATE = 256, 1e-3  # samples per step; initial rate


@dataclass(frozen=True)
class LabelledFrames:
    """Training frames of many clips: x `(N, 472)`, y `(N, 473)`, and their styles."""

    x: Array
    y: Array
    style: NDArray[np.integer]
    styles: tuple[str, ...]


def frames_of(clip: ClipFrames) -> tuple[Array, Array]:
    """Return x and y of a clip on its own ground, with phases from its contacts."""
    y = clip.y.astype(np.float32)
    x = np.zeros((len(y), INPUT_SIZE), np.float32)
    x[:, : INPUT["phase"].start] = clip.x
    x[:, INPUT["heights"]] = clip.heights[:, 0]
    x[:, INPUT["joint_positions"]][:, 1::3] -= clip.previous_ground[:, :1]
    y[:, OUTPUT["joint_positions"]][:, 1::3] -= clip.ground[:, :1]
    before, after = networks.windows(networks.phase_vectors(y[:, OUTPUT["contacts"]] > 0.5))
    x[:, INPUT["phase"]], y[:, OUTPUT["phase"]] = before.reshape(len(x), -1), after.reshape(len(y), -1)
    return x, y


def read_frames(folder: Path, method: Method, most: int, seed: int, report: Report) -> LabelledFrames:
    """Read frames of random captured training clips, up to `most`; FileError if there are none."""
    xs, ys, labels, count = [], [], [], 0
    for clip in folders.training_clips(folder, seed):
        if not method.learns_from(clip):
            continue
        x, y = frames_of(clip_frames(clip.path))
        xs.append(x.astype(np.float16))
        ys.append(y.astype(np.float16))
        labels.append(PLAIN if method.neutral else clip.style)
        count += len(x)
        if count >= most:
            break
    if not xs:
        raise FileError(f"{folder}: no clips to train on.", "Import captured clips first.")
    report(f"{count} frames of {len(xs)} clips")
    styles = tuple(sorted(set(labels)))
    index = np.repeat([styles.index(s) for s in labels], [len(x) for x in xs])
    return LabelledFrames(np.concatenate(xs), np.concatenate(ys), index, styles)


@dataclass(frozen=True)
class Method:
    """A method: its network, and its choice of training clips."""

    name: str
    network: Callable[[int], Baseline]  # from the number of styles
    neutral: bool = False  # only neutral styles, as one label
    rollouts: bool = False  # terrain rollouts too

    def learns_from(self, clip: ClipInfo) -> bool:
        """Return whether a clip is among its training data."""
        kind = self.rollouts or clip.group != TERRAIN_GROUP
        return kind and (not self.neutral or clip.style.startswith(PLAIN))


METHODS = {
    "pfnn": Method("pfnn", networks.PhaseFunctioned, neutral=True, rollouts=True),
    "mason2022": Method("mason2022", networks.FilmModulated),
    "style-label": Method(
        "style-label", lambda styles: networks.StyleByLabel(styles, replace(preset("small"), hidden=128))
    ),
}


def fit(network: Baseline, frames: LabelledFrames, steps: int, seed: int, report: Report) -> float:
    """Train in place; returns the mean loss of the last tenth of the steps."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    sample = rng.choice(len(frames.x), min(len(frames.x), 20_000), replace=False)
    for name, chosen in (("x", frames.x[sample]), ("y", frames.y[sample])):
        values = torch.from_numpy(chosen.astype(np.float32))
        getattr(network, f"{name}_mean").copy_(values.mean(0))
        getattr(network, f"{name}_deviation").copy_(values.std(0).clamp_min(MIN_DEVIATION))
    trained = [p for p in network.parameters() if p.requires_grad]
    optimiser = torch.optim.AdamW(trained, MAX_LEARNING_RATE, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    network.train()
    losses = []
    for step in range(steps):
        rows = rng.integers(0, len(frames.x), BATCH)
        x, y = (torch.from_numpy(v[rows].astype(np.float32)) for v in (frames.x, frames.y))
        label = nn.functional.one_hot(torch.from_numpy(frames.style[rows]), len(frames.styles)).float()
        made = network.normalised(network.scaled(x), x, label)
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


class LabelGraph(nn.Module):
    """Maps Z^t `(6, 64)` to the label of the nearest description, in the format of a folded style, and to its speeds."""

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
        """Return a one-hot label `(S,)`, two empty tensors, and walking and jogging speed."""
        away = (self.codes - z.reshape(1, -1)).square().sum(1)
        nearest = (away <= away.min()).to(z.dtype)
        label = (nearest[:, None] * self.labels).sum(0) / nearest.sum()
        nothing = 0.0 * z.reshape(-1)[:1]
        return label, nothing, nothing.clone(), label @ self.pace


class BaselineStepGraph(nn.Module):
    """One frame with the interface of our step graph; noise and the empty tensors have no effect."""

    def __init__(self, network: Baseline) -> None:
        super().__init__()
        self.network = network

    def forward(
        self, x: Tensor, noise: Tensor, front_bias: Tensor, content_weight: Tensor, content_bias: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return y and a weight of one."""
        label = front_bias.expand(x.shape[0], -1) + 0.0 * (content_weight.sum() + content_bias.sum())
        rest = 0.0 * noise.sum((1, 2, 3))[:, None]
        return self.network(x, label) + rest, torch.ones_like(rest)


def export(network: Baseline, frames: LabelledFrames, model: Path, out: Path, notes: dict[str, Any]) -> Path:
    """Write a model folder with our three graphs; the text side is that of `model`."""
    folders.copy_text_side(model, out)
    codes = folders.style_codes(model, frames.styles)
    labels = np.repeat(np.arange(len(frames.styles)), [len(codes[s]) for s in frames.styles])
    gait = frames.x[:, INPUT["gait"]].reshape(len(frames.x), L, -1)[:, L // 2].argmax(1)
    pace = folders.speeds(
        frames.y[:, OUTPUT["root"]].astype(np.float32), gait, frames.style, len(frames.styles)
    )
    label = LabelGraph(np.concatenate([codes[s] for s in frames.styles]), labels, pace)
    export_graph(label, {"z": torch.zeros(6, 64)}, (*FOLDED, "speeds"), out / "style.onnx", ({},))
    count = len(frames.styles)
    folded = torch.ones(2, count) / count, torch.zeros(2, 1), torch.zeros(2, 1)
    inputs = {"x": torch.zeros(2, INPUT_SIZE), "noise": torch.zeros(2, 1, 1, OUTPUT_SIZE)}
    inputs |= dict(zip(FOLDED, folded, strict=True))
    export_graph(BaselineStepGraph(network), inputs, ("y", "alpha"), out / "step.onnx")
    stands = np.flatnonzero(gait == Gait.STAND)
    start = frames.y[stands[0] if len(stands) else 0].astype(float)
    own = {
        "name": notes["method"],
        "decoder": notes["method"],
        "parameters": sum(p.numel() for p in network.parameters() if p.requires_grad),
        "styles": list(frames.styles),
        "start": {"output": start.tolist(), "phase": [0.0, 1.0] * (C * (L + 1))},
        "notes": notes,
    }
    return folders.write_metadata(model, out, ["style.onnx", "step.onnx"], own)


def make(order: Order, report: Report) -> Path:
    """Train and export a method."""
    method = METHODS[order.method]
    frames = read_frames(order.clips, method, MAX_FRAMES, order.seed, report)
    torch.manual_seed(order.seed)
    network = method.network(len(frames.styles))
    loss = fit(network, frames, order.steps, order.seed, report)
    notes = {"method": method.name, "steps": order.steps, "batch": BATCH, "seed": order.seed, "loss": loss}
    return export(network, frames, order.model, order.out, notes)
