"""Stage 1: train the content encoder with body-part contrastive learning (Sec. III-C, Eq. 2, 3, 7 to 9)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from runtime.motion.features import OUTPUT
from training import losses as terms
from training.batches import FrameTensors, RandomRows
from training.composition import Composer, CompositionPlan, weighted
from training.frames import FIRST_OF_UPPER, FrameTable
from training.gpu import Losses, rows_of
from training.networks.content import (
    SEQUENCE_LENGTH,
    ContentEncoder,
    Gaussian,
    MeasuresReader,
    StatisticsReader,
)
from training.presets import ModelConfig
from training.session import MovingAverage, Session, StageLength, TrainingState, save_checkpoint, train
from training.styles import StyleTable, StyleTexts, pick_paraphrases
from training.text.clip_measures import clip_values

STRIDE = 2  # frames between samples: 40 samples span 1.3 s, more than one step
# Eq. 7. The paper's lambda_con is 1e-2, for 100 styles and a long training; this shorter training needs more.
CONTRAST_WEIGHT, KL_WEIGHT, EMBEDDING_WEIGHT = 0.1, 1e-5, 1e-5
# Of the pose statistics, not in the paper (training.networks.content.StatisticsReader).
STATISTICS_WEIGHT = 0.5
# Of the measures of clips, not in the paper either (training.networks.content.MeasuresReader).
MEASURES_WEIGHT = 2.0
MEASURED_CLIPS = 2048  # per step, whose words must predict their measures
STATISTICS_WINDOWS = 4096  # from which centre and deviation of the pose statistics are measured
TEXT_BATCHES = 4  # batches of windows per step whose statistics are predicted from words
# Standard deviation of the noise on embedding components (about 0.05), random per sentence: similar words give similar
# content, and the meaning of direction words is not memorised from the embeddings.
WORD_NOISE = (0.01, 0.03)
MEASURED_NOISE = (0.0, 0.012)  # for the measures: sentences of opposite edits are 0.3 apart


class Sequences:
    """Windows of 40 samples: joints `(B, 40, 31, 9)` and root displacement `(B, 40, 3)`, normalised."""

    def __init__(self, table: FrameTable, device: torch.device, composer: Composer | None = None) -> None:
        self.composer = composer
        self.y = torch.as_tensor(table.y).to(device)
        self.ground = torch.as_tensor(table.ground[:, 0]).to(device)
        probe = self.y[:: max(1, len(table) // 20000)].float()
        joints, root = self._split(probe, self.ground[:: max(1, len(table) // 20000)])
        self.joint_mean, self.joint_deviation = joints.mean(0), joints.std(0).clamp_min(0.05)
        self.root_deviation = root.std(0).clamp_min(0.05)

    @property
    def scales(self) -> dict[str, Tensor]:
        """Return the scales that normalise joints `(31, 9)` and root `(3,)`."""
        names = ("joint_mean", "joint_deviation", "root_deviation")
        return {name: getattr(self, name).cpu() for name in names}

    @staticmethod
    def _split(y: Tensor, ground: Tensor) -> tuple[Tensor, Tensor]:
        positions = y[..., OUTPUT["joint_positions"]].unflatten(-1, (-1, 3)).clone()
        positions[..., 1] -= ground[..., None]
        rotations = y[..., OUTPUT["joint_rotations"]].unflatten(-1, (-1, 6))
        return torch.cat([positions, rotations], -1), y[..., OUTPUT["root"]]

    def __call__(self, start: Tensor, plan: CompositionPlan | None = None) -> tuple[Tensor, Tensor]:
        """Return windows that begin at frames `start` `(B,)`, with parts of other clips according to `plan`."""
        index = start[:, None] + STRIDE * torch.arange(SEQUENCE_LENGTH, device=start.device)
        joints, root = self._split(self.y[index].float(), self.ground[index])
        if plan is not None and self.composer is not None:
            changed = plan.changed.any(1)
            at = rows_of(changed)
            pose = self.composer.poses(index[at].flatten(), plan[at].repeated(SEQUENCE_LENGTH))[0]
            heights = self.ground[index[at]].flatten()
            pose.positions[..., 1] -= heights[:, None]
            upper = torch.cat([pose.positions, pose.rotations], dim=-1).unflatten(0, (-1, SEQUENCE_LENGTH))
            own = joints[at, :, FIRST_OF_UPPER:]
            joints[at, :, FIRST_OF_UPPER:] = torch.where(changed[at, None, None, None], upper, own)
        return (joints - self.joint_mean) / self.joint_deviation, root / self.root_deviation


SPAN = STRIDE * (SEQUENCE_LENGTH - 1)  # frames from a window's first to its last


@dataclass
class ContentWindows:
    """First frames of windows `(B,)`, their composition plan, and the clips `(B, 6)` that describe each part."""

    start: Tensor
    plan: CompositionPlan
    clips: Tensor

    @staticmethod
    def around(frames: FrameTensors, rows: Tensor) -> ContentWindows:
        """Choose windows around frames `rows` `(B,)`, within their clips, and compose them at random."""
        start = torch.maximum(torch.minimum(rows, frames.last[rows] - SPAN), frames.first[rows])
        plan = frames.plan(start, SPAN)
        return ContentWindows(start, plan, plan.words(frames.clip[start]))


@dataclass
class Measured:
    """Measures of all clips, six tensors `(clips, n)`, and cumulative sampling weights `(clips,)`."""

    values: list[Tensor]
    cumulative: Tensor

    @staticmethod
    def read(folder: Path, table: FrameTable, weights: np.ndarray, device: torch.device) -> Measured:
        """Measure the clips of `table` in `folder`; a clip's weight is the sum of its frames'."""
        values = [torch.as_tensor(v).to(device) for v in clip_values(folder, table.names)]
        of_clips = np.bincount(table.clip, weights, len(table.names))
        return Measured(values, torch.as_tensor(np.cumsum(of_clips), dtype=torch.float64, device=device))

    def of(self, clips: Tensor) -> list[Tensor]:
        """Return the values of clips `(B,)`, or of one clip per part `(B, 6)`."""
        return [v[clips if clips.ndim == 1 else clips[:, k]] for k, v in enumerate(self.values)]


class ContentLosses:
    """The losses of stage 1 (Eq. 7) for a batch of windows and their clips."""

    def __init__(
        self,
        module: ContentEncoder,
        config: ModelConfig,
        sequences: Sequences,
        batch: int,
        data: ContentData,
    ) -> None:
        self.measured, self.frames, self.batch = data.measured, data.frames, batch
        self.module, self.config, self.sequences = module, config, sequences
        device = sequences.y.device
        self.embeddings = [torch.as_tensor(e).to(device) for e in data.texts.embeddings]
        self.index = torch.as_tensor(data.texts.index).to(device)
        self.keys = torch.as_tensor(data.texts.keys).to(device)

    def __call__(self, rows: Tensor) -> Losses:
        """Compute losses of windows around the first `batch` frames; for the other frames only those of words."""
        item = ContentWindows.around(self.frames, rows[: self.batch])
        clips = item.clips
        joints, root = self.sequences(item.start, item.plan)
        target = torch.cat([joints.flatten(-2), root], -1)
        motion, text = self.module.motion(joints, root), self.text(clips)
        z_motion, z_text = motion.sample(), text.sample()
        whole, parts = self._contrasts(motion, text, clips)
        decoder = self.module.decoder
        result = {
            "recon": terms.reconstruction(target, decoder(z_motion), decoder(z_text)),
            "contrast": whole,
            "part_contrast": parts,
            "kl": terms.kullback_leibler(text, motion),
            "embedding": terms.embedding_similarity(z_motion, z_text),
        }
        contrast, weights = 0.5 * whole + parts, (CONTRAST_WEIGHT, KL_WEIGHT, EMBEDDING_WEIGHT)
        result["total"] = terms.stage1(result["recon"], contrast, result["kl"], result["embedding"], weights)
        if self.module.statistics is not None:
            others = ContentWindows.around(self.frames, rows[self.batch :])
            result |= self._statistics(self.module.statistics, motion, joints, others)
            both = result["statistics"] + result["text_statistics"]
            result["total"] = result["total"] + STATISTICS_WEIGHT * both
        if self.module.measures is not None and self.measured is not None:
            result["measures"] = self._measures(self.module.measures, self.measured, motion, clips)
            result["total"] = result["total"] + MEASURES_WEIGHT * result["measures"]
        return result

    def text(self, clips: Tensor, noise: tuple[float, float] = WORD_NOISE) -> Gaussian:
        """Return codes of random paraphrases of clips."""
        sentence = pick_paraphrases(self.index, clips)
        words = torch.stack([e[sentence[:, k]] for k, e in enumerate(self.embeddings)], 1)
        return self.module.text(words + _word_noise(words, self.config.text_size, noise))

    def _contrasts(self, motion: Gaussian, text: Gaussian, clips: Tensor) -> tuple[Tensor, Tensor]:
        """Return Eq. 2 for whole bodies, and its mean over the parts."""
        keys = self.keys[clips, torch.arange(clips.shape[1], device=clips.device)]
        same = keys[:, None] == keys[None, :]  # (B, B, 6)
        m, t = motion.parameters_flat().float(), text.parameters_flat().float()
        whole = terms.contrastive(m.flatten(1), t.flatten(1), same.all(-1))
        if not self.config.part_contrast:
            return whole, whole
        each = [terms.contrastive(m[:, k], t[:, k], same[:, :, k]) for k in range(m.shape[1])]
        return whole, torch.stack(each).mean()

    def _measures(
        self, reader: MeasuresReader, measured: Measured, motion: Gaussian, clips: Tensor
    ) -> Tensor:
        """Return the loss of measures predicted from the windows' codes, and from the words of many clips."""
        own = terms.statistics(measured.of(clips), reader(motion.mean))
        drawn = weighted(measured.cumulative, (MEASURED_CLIPS,))
        return own + terms.statistics(measured.of(drawn), reader(self.text(drawn, MEASURED_NOISE).mean))

    def _statistics(
        self, reader: StatisticsReader, motion: Gaussian, joints: Tensor, others: ContentWindows
    ) -> Losses:
        """Return losses of pose statistics from motion, and from words on many extra windows, which need no encoding."""
        own = terms.statistics(reader.standardised(joints), reader(motion.mean))
        targets = reader.standardised(self.sequences(others.start, others.plan)[0])
        read = reader(self.text(others.clips).mean)
        return {"statistics": own, "text_statistics": terms.statistics(targets, read)}


@dataclass(frozen=True)
class ContentData:
    """Training data of stage 1: frames and their sampling weights, descriptions and measures of the clips."""

    table: FrameTable
    frames: FrameTensors
    weights: np.ndarray
    texts: StyleTexts
    measured: Measured | None = None  # None if the model does not predict them


def run(session: Session, config: ModelConfig, data: ContentData, length: StageLength) -> ContentEncoder:
    """Train the content encoder; returns its moving average and writes it to `content_final.pt`."""
    device, steps, batch = session.device, length.steps, length.batch
    torch.manual_seed(session.seed + 1)
    sequences = Sequences(data.table, device, data.frames.composer)
    frames = data.frames
    weights = data.weights * ((frames.last - frames.first).cpu().numpy() >= SPAN)
    module = ContentEncoder(config).to(device)
    if module.statistics is not None:
        drawn = next(RandomRows(weights, STATISTICS_WINDOWS, 0, frames.last, session.batch_generator(10)))
        windows = ContentWindows.around(frames, drawn)
        module.statistics.measure(sequences(windows.start, windows.plan)[0])
    count = batch * (1 + TEXT_BATCHES if config.pose_statistics else 1)
    rows = RandomRows(weights, count, 0, frames.last, session.batch_generator(2))
    optimizer = torch.optim.AdamW(module.parameters(), lr=5e-4, weight_decay=1e-4, fused=True)
    state = TrainingState(module, optimizer, MovingAverage(module, 0.995), {"rows": rows})
    losses = ContentLosses(module, config, sequences, batch, data)

    def rate(step: float) -> float:
        return 5e-4 * min(1.0, (step + 1) / 100, (steps - step) / (0.3 * steps) + 0.02)

    train(session, "content", state, rows, losses, rate, length)
    module.load_state_dict(state.average.values)
    save_checkpoint(
        session.out / "content_final.pt",
        {"module": module.state_dict(), "config": asdict(config), "scales": sequences.scales},
    )
    return module.eval()


def _word_noise(words: Tensor, size: int, strengths: tuple[float, float]) -> Tensor:
    """Draw noise for the first `size` components of `words` `(B, 6, D)`, the embeddings, not for direction words."""
    least, most = strengths
    strength = least + (most - least) * torch.rand_like(words[..., :1])
    noise = strength * torch.randn_like(words)
    noise[..., size:].zero_()
    return noise


@torch.no_grad()
def _text_means(module: ContentEncoder | None, texts: StyleTexts) -> list[Tensor]:
    """Return the mean Z^t of every sentence of each part, `(U_k, 64)`; without a content encoder the embedding."""
    if module is None:
        return [torch.as_tensor(e) for e in texts.embeddings]
    device = next(module.parameters()).device
    means = []
    for k, embeddings in enumerate(texts.embeddings):
        words = torch.as_tensor(embeddings).to(device)[:, None].expand(-1, len(texts.embeddings), -1)
        means.append(module.text(words).mean[:, k])
    return means


def style_scale(module: ContentEncoder | None, texts: StyleTexts) -> tuple[Tensor, Tensor]:
    """Return mean and deviation `(384,)` (six parts of 64) of Z^t over the sentences of all clips."""
    means, centre, deviation = _text_means(module, texts), [], []
    for k, z in enumerate(means):
        used = z[torch.as_tensor(texts.index[:, :, k]).to(z.device).flatten()]
        centre.append(used.mean(0))
        deviation.append(used.std(0))
    spread = torch.cat(deviation)
    return torch.cat(centre), spread.clamp_min(0.2 * spread.mean().item() + 1e-4)


def style_table(
    module: ContentEncoder | None, texts: StyleTexts, centre: Tensor, deviation: Tensor
) -> StyleTable:
    """Return standardised Z^t of every sentence."""
    means = _text_means(module, texts)
    size = means[0].shape[1]
    parts = [
        (z - centre[k * size : (k + 1) * size]) / deviation[k * size : (k + 1) * size]
        for k, z in enumerate(means)
    ]
    return StyleTable(parts, torch.as_tensor(texts.index).to(parts[0].device))
