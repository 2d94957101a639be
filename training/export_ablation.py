"""The network of stage 2 as the step graph: the row `w/o-Diffusion` of Table I, loaded like any other model."""

from __future__ import annotations

from torch import Tensor, nn

from training.batches import Normalisation
from training.networks.generator import Generator

DECODERS = ("diffusion", "mixture")


class MixtureStepGraph(nn.Module):
    """One frame by the one-layer MoE decoder E_d: the interface of `StepGraph`, but the noise changes nothing."""

    def __init__(self, generator: Generator, normal: Normalisation) -> None:
        super().__init__()
        self.generator = generator
        for name, value in normal.tensors().items():
            self.register_buffer(name, value)

    def forward(
        self, x: Tensor, noise: Tensor, front_bias: Tensor, content_weight: Tensor, content_bias: Tensor
    ) -> tuple[Tensor, Tensor]:
        w, alpha = self.generator.encoder((x - self.x_mean) / self.x_deviation)
        folded = (front_bias, content_weight, content_bias)
        e = self.generator.modulator.forward_folded(w, alpha, folded)
        return self.generator.mixture_decoder(e, alpha) * self.y_deviation + self.y_mean, alpha
