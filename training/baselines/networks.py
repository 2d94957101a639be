"""Networks of other methods, from normalised x `(B, 472)` and style labels `(B, S)` to normalised y `(B, 473)`; their phases.

Phases are computed from foot contacts, in the five channels of our phase windows: left heel, left toe, right heel, right
toe (Mason et al. 2022 use the local phases of Starke et al. 2020; here they run from one contact onset to the next, without
fitting a sine), and the footstep phase of PFNN, 0 when the right foot lands and half a cycle when the left one does (Holden
et al. 2017, Sec. 4.1).
"""

import itertools
import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from runtime.arrays import Array
from runtime.motion import features
from runtime.motion.features import INPUT, MOTION_INPUT_SIZE, OUTPUT, C, L
from training.networks.generator import Generator
from training.presets import ModelConfig

FOOTSTEP = 4  # channel
IDLE_HZ = 0.5  # phase rate without any onset
MAX_GAP_S = 2.0  # longer intervals between onsets are standing


def onsets(contact: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Return the frames at which a contact `(T,)` begins."""
    return np.flatnonzero(contact[1:] & ~contact[:-1]) + 1


def through(frames: NDArray[np.integer], turns: Array, length: int) -> Array:
    """Interpolate `turns` at `frames` linearly to `(length,)`, extrapolating both ends."""
    if len(frames) < 2:
        start = float(turns[0]) - IDLE_HZ * frames[0] / features.FPS if len(frames) else 0.0
        return start + IDLE_HZ * np.arange(length) / features.FPS
    rate = float(np.median(np.diff(turns) / np.diff(frames)))
    at = np.arange(length)
    result = np.interp(at, frames, turns)
    before, after = at < frames[0], at > frames[-1]
    result[before] = turns[0] - rate * (frames[0] - at[before])
    result[after] = turns[-1] + rate * (at[after] - frames[-1])
    return result


def local_phase(contact: NDArray[np.bool_]) -> Array:
    """Return a phase `(T,)` in cycles, integer at every onset of a contact `(T,)`."""
    frames = onsets(contact)
    return through(frames, np.arange(len(frames), dtype=np.float64), len(contact))


def footstep_phase(left: NDArray[np.bool_], right: NDArray[np.bool_]) -> Array:
    """Return a phase `(T,)` in cycles, integer when the right foot lands, half-integer when the left one does.

    Between two consecutive onsets of the same foot the phase advances by a whole cycle.
    """
    steps = sorted([(int(f), 0.5) for f in onsets(left)] + [(int(f), 0.0) for f in onsets(right)])
    frames: list[int] = []
    turns: list[float] = []
    for frame, fraction in steps:
        if frames and frame - frames[-1] < 2:  # both feet at once: landing of a jump
            continue
        last = turns[-1] if turns else -0.5
        ahead = (fraction - last) % 1.0
        turns.append(last + (ahead if ahead > 0 else 1.0))
        frames.append(frame)
    return through(np.array(frames, int), np.array(turns), len(left))


def phase_vectors(contacts: NDArray[np.bool_]) -> Array:
    """Return phase vectors `(T, 5, 2)` (sine, cosine) of contacts `(T, 4)` left heel and toe, right heel and toe; short in standing."""
    turns = [local_phase(contacts[:, k]) for k in range(4)]
    turns.append(footstep_phase(contacts[:, 0] | contacts[:, 1], contacts[:, 2] | contacts[:, 3]))
    angle = 2.0 * np.pi * np.stack(turns, 1)
    steps = np.concatenate([onsets(contacts[:, k]) for k in range(4)])
    at = np.arange(len(contacts))
    gap = np.abs(at[:, None] - steps[None]).min(1) if len(steps) else np.full(len(at), np.inf)
    size = np.where(gap < MAX_GAP_S * features.FPS / 2, 1.0, 0.1)[:, None]
    size = np.concatenate([np.repeat(size, 4, 1), np.ones_like(size)], 1)  # the footstep phase always turns
    return size[..., None] * np.stack([np.sin(angle), np.cos(angle)], -1)


def windows(vectors: Array) -> tuple[Array, Array]:
    """Return phase windows: inputs `(T, 13, 5, 2)` around the previous frame, outputs `(T, 7, 5, 2)` from the present on."""
    at, last = np.arange(len(vectors)), len(vectors) - 1
    before = np.clip(at[:, None] - 1 + features.PHASE_OFFSETS, 0, last)
    after = np.clip(at[:, None] + features.FUTURE_PHASE_OFFSETS, 0, last)
    assert vectors.shape[1] == C
    return vectors[before], vectors[after]


# --- networks ---------------------------------------------------------------------------------------------------------


KNOTS = 4
MAX_INPUT_DEVIATIONS = 5.0  # limit of normalised inputs
HALF = L // 2


def catmull_rom(knots: Tensor, phase: Tensor) -> Tensor:
    """Phase function of PFNN (Holden et al. 2017, Eq. 7): blends control points `(4, ...)` at phases `(B,)`, radians, to `(B, ...)`.

    Theta = a1 + w (a2 - a0)/2 + w^2 (a0 - 5/2 a1 + 2 a2 - a3/2) + w^3 (3/2 a1 - 3/2 a2 + a3/2 - a0/2), with w the fraction of the way
    from knot k1 to k2, k_n = floor(4 p / 2 pi) + n - 1 mod 4.
    """
    position = torch.remainder(phase / (2.0 * math.pi), 1.0) * KNOTS
    first = torch.floor(position)
    w = (position - first).reshape(-1, *[1] * (knots.dim() - 1))
    index = first.long()
    a0, a1, a2, a3 = (knots[torch.remainder(index + n - 1, KNOTS)] for n in range(KNOTS))
    return (
        a1
        + w * (0.5 * a2 - 0.5 * a0)
        + w**2 * (a0 - 2.5 * a1 + 2.0 * a2 - 0.5 * a3)
        + w**3 * (1.5 * a1 - 1.5 * a2 + 0.5 * a3 - 0.5 * a0)
    )


def blended(weights: Tensor, biases: Tensor, blend: Tensor, x: Tensor) -> Tensor:
    """Apply a layer of blended experts: `(K, out, in)`, `(K, out)`, weights `(B, K)` and inputs `(B, in)` to `(B, out)`."""
    every = torch.einsum("koi,bi->bko", weights, x) + biases
    return (blend[..., None] * every).sum(1)


class Baseline(nn.Module):
    """Network of another method with the normalisation of x and y; `forward` uses physical units."""

    def __init__(self, styles: int) -> None:
        super().__init__()
        self.styles = styles
        for name, size in (("x", features.INPUT_SIZE), ("y", features.OUTPUT_SIZE)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_deviation", torch.ones(size))
        self.x_mean: Tensor
        self.x_deviation: Tensor
        self.y_mean: Tensor
        self.y_deviation: Tensor

    def forward(self, x: Tensor, label: Tensor) -> Tensor:
        """Return y of one frame."""
        return self.normalised(self.scaled(x), x, label) * self.y_deviation + self.y_mean

    def scaled(self, x: Tensor) -> Tensor:
        """Return normalised x, clipped to ±`MAX_INPUT_DEVIATIONS`."""
        return ((x - self.x_mean) / self.x_deviation).clamp(-MAX_INPUT_DEVIATIONS, MAX_INPUT_DEVIATIONS)

    def normalised(self, scaled: Tensor, x: Tensor, label: Tensor) -> Tensor:
        """Return normalised y of `scaled`, normalised x; phases are taken from x itself."""
        raise NotImplementedError


class PhaseFunctioned(Baseline):
    """PFNN (Holden et al. 2017): three layers whose weights are a cyclic cubic function of the footstep phase; ELU, no styles.

    It predicts the phase's change, from which the window of phases follows.
    """

    def __init__(self, styles: int, hidden: int = 512, dropout: float = 0.3) -> None:
        super().__init__(styles)
        sizes = (MOTION_INPUT_SIZE, hidden, hidden, OUTPUT["phase"].start + 1 + 186)
        self.weights = nn.ParameterList(
            nn.Parameter(torch.randn(KNOTS, o, i) * math.sqrt(2.0 / (i + o)))
            for i, o in itertools.pairwise(sizes)
        )
        self.biases = nn.ParameterList(nn.Parameter(torch.zeros(KNOTS, o)) for o in sizes[1:])
        self.dropout = nn.Dropout(dropout)

    def normalised(self, scaled: Tensor, x: Tensor, label: Tensor) -> Tensor:
        """See `Baseline`; the label has no effect, as PFNN has one style."""
        now = x[:, INPUT["phase"]].reshape(-1, L + 1, C, 2)[:, HALF][:, FOOTSTEP]
        phase = torch.atan2(now[:, 0], now[:, 1])
        h = scaled[:, :MOTION_INPUT_SIZE]
        for number, (w, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            # weights of the control points, in which the function is linear
            blend = catmull_rom(torch.eye(KNOTS, device=x.device), phase)
            h = blended(w, b, blend, self.dropout(h))
            if number < len(self.weights) - 1:
                h = functional.elu(h)
        start = OUTPUT["phase"].start
        change = h[:, start] * 0.05 + 2.0 * math.pi / 60.0  # radians per frame; about one cycle per second
        vectors = footstep_window(phase, change)
        scaled_phase = (vectors - self.y_mean[OUTPUT["phase"]]) / self.y_deviation[OUTPUT["phase"]]
        rest = 0.0 * label.sum(1, keepdim=True)
        return torch.cat([h[:, :start], scaled_phase, h[:, start + 1 :]], 1) + rest


def footstep_window(phase: Tensor, change: Tensor) -> Tensor:
    """Return phase vectors `(B, 70)` of the present and the next second; only the footstep channel is non-zero."""
    ahead = 1.0 + 10.0 * torch.arange(HALF + 1, device=phase.device, dtype=phase.dtype)
    angle = phase[:, None] + change[:, None] * ahead
    footstep = torch.stack([torch.sin(angle), torch.cos(angle)], -1)[:, :, None]
    # `len` would make the batch size of an exported graph constant
    still = torch.zeros_like(footstep).expand(-1, -1, C - 1, -1)
    return torch.cat([still, footstep], 2).flatten(1)


class FilmModulated(Baseline):
    """Mason et al. (2022), simplified: experts blended by local phases, hidden layers modulated by the style (FiLM)."""

    def __init__(self, styles: int, hidden: int = 512, experts: int = 8, dropout: float = 0.1) -> None:
        super().__init__(styles)
        phases = INPUT["phase"].stop - INPUT["phase"].start
        self.gating = nn.Sequential(
            nn.Linear(phases, 64), nn.ELU(), nn.Linear(64, 64), nn.ELU(), nn.Linear(64, experts)
        )
        sizes = (MOTION_INPUT_SIZE, hidden, hidden, features.OUTPUT_SIZE)
        self.weights = nn.ParameterList(
            nn.Parameter(torch.randn(experts, o, i) * math.sqrt(2.0 / (i + o)))
            for i, o in itertools.pairwise(sizes)
        )
        self.biases = nn.ParameterList(nn.Parameter(torch.zeros(experts, o)) for o in sizes[1:])
        # gamma - 1 and beta of each hidden layer and style, initially neutral
        self.film = nn.Parameter(torch.zeros(2, 2, styles, hidden))
        self.dropout = nn.Dropout(dropout)

    def normalised(self, scaled: Tensor, x: Tensor, label: Tensor) -> Tensor:
        """h = gamma_s * ELU(W h + b) + beta_s (their Eq. 1 on every hidden layer)."""
        blend = torch.softmax(self.gating(x[:, INPUT["phase"]]), 1)
        h = scaled[:, :MOTION_INPUT_SIZE]
        for number, (w, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            h = blended(w, b, blend, self.dropout(h))
            if number < len(self.weights) - 1:
                gamma, beta = (label @ table for table in self.film[number])
                h = (1.0 + gamma) * functional.elu(h) + beta
        return h


class StyleByLabel(Baseline):
    """Our generator with the one-layer decoder, and a learnt vector per style in place of Z^t, without text."""

    def __init__(self, styles: int, config: ModelConfig) -> None:
        super().__init__(styles)
        self.generator = Generator(config)
        for unused in self.generator.denoiser.parameters():
            unused.requires_grad_(False)
        self.codes = nn.Parameter(torch.randn(styles, config.style_size) / math.sqrt(config.style_size))

    def normalised(self, scaled: Tensor, x: Tensor, label: Tensor) -> Tensor:
        """Return normalised y by E_d."""
        return self.generator.decode_mixture(scaled, label @ self.codes)[0]
