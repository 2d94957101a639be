"""Export of trained weights for the runtime: ONNX graphs and a metadata file with their hashes."""

import datetime
import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from runtime.motion.features import FPS, LAYOUT_VERSION
from runtime.motion.model_files import FOLDED, write_metadata
from runtime.skeleton import SPORT_SKELETON, J
from training.batches import Normalisation
from training.export.graph import export_graph
from training.export.model_card import model_card
from training.export.step import FrameGraph, StepGraph, export_step
from training.networks.content import JOINT_FEATURES, SEQUENCE_LENGTH, ContentEncoder
from training.networks.diffusion import ReverseStep
from training.networks.generator import Generator
from training.presets import ModelConfig

CODES = ("mean", "log_variance")  # outputs


class MixtureStepGraph(FrameGraph):
    """One frame by the one-layer MoE decoder E_d, with the interface of `StepGraph`; noise has no effect."""

    def __init__(self, generator: Generator, normal: Normalisation) -> None:
        super().__init__(generator, normal)
        self.decoder = generator.mixture_decoder

    def forward(
        self, x: Tensor, noise: Tensor, front_bias: Tensor, content_weight: Tensor, content_bias: Tensor
    ) -> tuple[Tensor, Tensor]:
        e, alpha = self.embed(x, front_bias, content_weight, content_bias)
        return self.decoder(e, alpha) * self.y_deviation + self.y_mean, alpha


class PromptGraph(nn.Module):
    """Maps six sentence embeddings `(N, 6, D)` to standardised Z^t, mean and log-variance (Eq. 2), all `(N, 6, 64)`.

    In the ablation without a content encoder the only output is the standardised embeddings, its Z^t.
    """

    centre: Tensor
    deviation: Tensor

    def __init__(self, content: ContentEncoder | None, centre: Tensor, deviation: Tensor) -> None:
        super().__init__()
        self.text = None if content is None else content.text
        self.register_buffer("centre", centre.view(6, -1))
        self.register_buffer("deviation", deviation.view(6, -1))

    def forward(self, embeddings: Tensor) -> tuple[Tensor, ...]:
        if self.text is None:
            return ((embeddings - self.centre) / self.deviation,)
        code = self.text(embeddings)
        return (code.mean - self.centre) / self.deviation, code.mean, code.log_variance


class MotionGraph(nn.Module):
    """The stage-1 motion encoder on sequences in physical units, as from `training.stages.content.Sequences`.

    Maps joints `(N, 40, 31, 9)` relative to the root (position with the ground's height removed, 6D rotation) and root
    velocity `(N, 40, 3)`, every second frame at 60 Hz, to mean and log-variance `(N, 6, 64)` of Z^m.
    """

    joint_mean: Tensor
    joint_deviation: Tensor
    root_deviation: Tensor

    def __init__(self, content: ContentEncoder, scales: dict[str, Tensor]) -> None:
        super().__init__()
        self.motion = content.motion
        for name, value in scales.items():
            self.register_buffer(name, value)

    def forward(self, joints: Tensor, root: Tensor) -> tuple[Tensor, Tensor]:
        code = self.motion((joints - self.joint_mean) / self.joint_deviation, root / self.root_deviation)
        return code.mean, code.log_variance


class StyleGraph(nn.Module):
    """Maps Z^t `(6, 64)` to the folded modulator weights, and to the natural speeds (walk, jog, m/s) and rest rhythm that
    `training.export.pace` fits."""

    regression: Tensor

    def __init__(self, generator: Generator, speeds: Tensor) -> None:
        super().__init__()
        self.modulator = generator.modulator
        # (n + 1, 2 or 2 + 2 C), intercept in the last row; its name must differ from that of the output
        self.register_buffer("regression", speeds)

    def forward(self, z: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        flat = z.reshape(1, -1)
        speeds = (flat @ self.regression[:-1] + self.regression[-1])[0]
        return (*self.modulator.fold(flat), speeds)


@dataclass(kw_only=True)
class Trained:
    """Inputs of the export."""

    config: ModelConfig
    content: ContentEncoder | None  # None: the ablation without one
    generator: Generator
    normal: Normalisation
    style_centre: Tensor
    style_deviation: Tensor
    speeds: Tensor
    steps: list[ReverseStep]
    sigma_bar_squared: np.ndarray
    start: dict[str, list[float]]  # y and phase of a standing frame, the initial state
    credits: list[str]
    notes: dict[str, object]
    curves: dict[str, str]  # stage to its last losses
    neutral: np.ndarray  # (6, 64) standardised Z^t of neutral walking, the origin of `strength`
    sequence_scales: dict[str, Tensor]  # stage 1: joint_mean, joint_deviation (31, 9), root_deviation (3,)
    decoder: str = "diffusion"  # or "mixture": the decoder of stage 2 (w/o-Diffusion)


def export_model(trained: Trained, folder: Path) -> None:
    """Write prompt, style, step and motion.onnx and metadata.json; graphs must agree with torch to 1e-4."""
    folder.mkdir(parents=True, exist_ok=True)
    generator = trained.generator.cpu().eval()
    normal = trained.normal.to(torch.device("cpu"))
    mixture = trained.decoder == "mixture"
    step = MixtureStepGraph(generator, normal) if mixture else StepGraph(generator, normal, trained.steps)
    torch.manual_seed(0)
    sizes, scale = trained.config, (trained.style_centre.cpu(), trained.style_deviation.cpu())
    content = None if trained.content is None else trained.content.cpu()
    prompt = {"embeddings": torch.randn(2, 6, sizes.sentence_size)}
    style, own = StyleGraph(generator, trained.speeds), {"z": torch.randn(6, sizes.style_size // 6)}
    given = ["z", *CODES] if content is not None else ["z"]
    errors = {
        "prompt": export_graph(PromptGraph(content, *scale), prompt, given, folder / "prompt.onnx"),
        "style": export_graph(style, own, [*FOLDED, "speeds"], folder / "style.onnx", (None,)),
        "step": export_step(step, generator, len(trained.steps), folder / "step.onnx"),
    }
    if content is not None:
        errors["motion"] = _export_motion(content, trained.sequence_scales, folder)
    _write_metadata(trained, folder, errors)


def _export_motion(content: ContentEncoder, scales: dict[str, Tensor], folder: Path) -> float:
    joints = torch.randn(2, SEQUENCE_LENGTH, J, JOINT_FEATURES)
    sequence = {"joints": joints, "root": torch.randn(2, SEQUENCE_LENGTH, 3)}
    return export_graph(MotionGraph(content, scales), sequence, CODES, folder / "motion.onnx")


def _write_metadata(trained: Trained, folder: Path, errors: dict[str, float]) -> None:
    metadata = {
        "format": "sport-model",
        "layout_version": LAYOUT_VERSION,
        "name": trained.config.name,
        "joints": list(SPORT_SKELETON.names),
        "fps": FPS,
        "config": asdict(trained.config),
        "decoder": trained.decoder,
        "text_encoder": {
            "name": trained.config.text_encoder,
            "dimensions": trained.config.text_size,
            "direction_words": trained.config.direction_words,
            "one_sided": trained.config.one_sided_words,
        },
        "strength": {"default": 1.0, "neutral": trained.neutral.flatten().tolist()},
        "reverse_steps": [asdict(s) for s in trained.steps],
        "sigma_bar_squared": trained.sigma_bar_squared.tolist(),
        "sha256": {n: hashlib.sha256((folder / f"{n}.onnx").read_bytes()).hexdigest() for n in errors},
        "onnx_error": errors,
        "start": trained.start,
        "exported": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "credits": trained.credits,
        "notes": trained.notes,
        "curves": trained.curves,
    }
    write_metadata(folder, metadata)
    (folder / "README.md").write_text(model_card(metadata, trained.curves), encoding="utf-8")
