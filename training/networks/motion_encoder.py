"""Motion encoder (Sec. III-B): a two-layer mixture of experts E_m and its phase gating E_g^p."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from runtime.motion.features import INPUT, MOTION_INPUT_SIZE
from training.networks.mixture import ExpertLinear, Gating
from training.presets import ModelConfig


class MotionEncoder(nn.Module):
    """x `(B, 472)` to W `(B, embedding)` and alpha `(B, experts)`; W = Σ_k alpha_k W_k."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        phase_size = INPUT["phase"].stop - INPUT["phase"].start
        self.gating = Gating(phase_size, config.gating_hidden, config.experts)
        self.first = ExpertLinear(config.experts, MOTION_INPUT_SIZE, config.hidden)
        self.second = ExpertLinear(config.experts, config.hidden, config.embedding)
        self.dropout = nn.Dropout(config.dropout)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        alpha = self.gating(x[:, MOTION_INPUT_SIZE:])
        hidden = torch.nn.functional.elu(self.first.shared(self.dropout(x[:, :MOTION_INPUT_SIZE])))
        return self.second.blended(self.dropout(hidden), alpha), alpha
