"""The rivals' networks, from normalised x `(B, 472)` and style labels `(B, S)` to normalised y `(B, 473)`."""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from runtime.motion.features import INPUT, INPUT_SIZE, MOTION_INPUT_SIZE, OUTPUT, OUTPUT_SIZE, C, L
from training.baselines.phases import FOOTSTEP
from training.networks.generator import Generator
from training.presets import ModelConfig

KNOTS = 4
HALF = L // 2


def catmull_rom(knots: Tensor, phase: Tensor) -> Tensor:
    """Phase function of PFNN (Holden et al. 2017, Eq. 7): control points `(4, ...)` at phases `(B,)` in radians, `(B, ...)`.

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
    """Layer of blended experts: `(K, out, in)`, `(K, out)`, weights `(B, K)` and inputs `(B, in)` to `(B, out)`."""
    every = torch.einsum("koi,bi->bko", weights, x) + biases
    return (blend[..., None] * every).sum(1)


class Baseline(nn.Module):
    """What all rivals have: the scales of x and y. `forward` takes and gives physical units."""

    def __init__(self, styles: int) -> None:
        super().__init__()
        self.styles = styles
        for name, size in (("x", INPUT_SIZE), ("y", OUTPUT_SIZE)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_deviation", torch.ones(size))
        self.x_mean: Tensor
        self.x_deviation: Tensor
        self.y_mean: Tensor
        self.y_deviation: Tensor

    def forward(self, x: Tensor, label: Tensor) -> Tensor:
        """y of one frame."""
        y = self.normalised((x - self.x_mean) / self.x_deviation, x, label)
        return y * self.y_deviation + self.y_mean

    def normalised(self, scaled: Tensor, x: Tensor, label: Tensor) -> Tensor:
        """Normalised y of normalised x; the phases are read off x itself."""
        raise NotImplementedError


def present_phase(x: Tensor) -> Tensor:
    """Phase vectors `(B, 5, 2)` of the frame before, out of x `(B, 472)`."""
    return x[:, INPUT["phase"]].reshape(-1, L + 1, C, 2)[:, HALF]


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
        """The label changes nothing: PFNN has one style."""
        now = present_phase(x)[:, FOOTSTEP]
        phase = torch.atan2(now[:, 0], now[:, 1])
        h = scaled[:, :MOTION_INPUT_SIZE]
        for number, (w, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            blend = catmull_rom(
                torch.eye(KNOTS, device=x.device), phase
            )  # the knots' weights: it is linear in them
            h = blended(w, b, blend, self.dropout(h))
            if number < len(self.weights) - 1:
                h = functional.elu(h)
        start = OUTPUT["phase"].start
        change = h[:, start] * 0.05 + 2.0 * math.pi / 60.0  # radians a frame; about one cycle a second
        vectors = footstep_window(phase, change)
        scaled_phase = (vectors - self.y_mean[OUTPUT["phase"]]) / self.y_deviation[OUTPUT["phase"]]
        rest = 0.0 * label.sum(1, keepdim=True)
        return torch.cat([h[:, :start], scaled_phase, h[:, start + 1 :]], 1) + rest


def footstep_window(phase: Tensor, change: Tensor) -> Tensor:
    """Vectors `(B, 70)` of the present and the coming second, all channels still but the footstep phase."""
    ahead = 1.0 + 10.0 * torch.arange(HALF + 1, device=phase.device, dtype=phase.dtype)
    angle = phase[:, None] + change[:, None] * ahead
    footstep = torch.stack([torch.sin(angle), torch.cos(angle)], -1)[:, :, None]
    still = torch.zeros_like(footstep).expand(
        -1, -1, C - 1, -1
    )  # `len` would fix the batch of an exported graph
    return torch.cat([still, footstep], 2).flatten(1)


class FilmModulated(Baseline):
    """Mason et al. (2022), reduced: experts blended by local phases, each hidden layer modulated by the style's gamma and beta (FiLM)."""

    def __init__(self, styles: int, hidden: int = 512, experts: int = 8, dropout: float = 0.1) -> None:
        super().__init__(styles)
        phases = INPUT["phase"].stop - INPUT["phase"].start
        self.gating = nn.Sequential(
            nn.Linear(phases, 64), nn.ELU(), nn.Linear(64, 64), nn.ELU(), nn.Linear(64, experts)
        )
        sizes = (MOTION_INPUT_SIZE, hidden, hidden, OUTPUT_SIZE)
        self.weights = nn.ParameterList(
            nn.Parameter(torch.randn(experts, o, i) * math.sqrt(2.0 / (i + o)))
            for i, o in itertools.pairwise(sizes)
        )
        self.biases = nn.ParameterList(nn.Parameter(torch.zeros(experts, o)) for o in sizes[1:])
        # of each hidden layer and style: gamma - 1 and beta, at first neutral
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
    """Our generator with the one-layer decoder, and a learnt vector for each style in the place of Z^t: no text."""

    def __init__(self, styles: int, config: ModelConfig) -> None:
        super().__init__(styles)
        self.generator = Generator(config)
        for unused in self.generator.denoiser.parameters():
            unused.requires_grad_(False)
        self.codes = nn.Parameter(torch.randn(styles, config.style_size) / math.sqrt(config.style_size))

    def normalised(self, scaled: Tensor, x: Tensor, label: Tensor) -> Tensor:
        """y by E_d."""
        return self.generator.decode_mixture(scaled, label @ self.codes)[0]
