"""The network of stage 2 as the step graph: the row `w/o-Diffusion` of Table I, loaded like any other model."""

from __future__ import annotations

from torch import Tensor

from training.batches import Normalisation
from training.export.step import FrameGraph
from training.networks.generator import Generator


class MixtureStepGraph(FrameGraph):
    """One frame by the one-layer MoE decoder E_d: the interface of `StepGraph`, but the noise changes nothing."""

    def __init__(self, generator: Generator, normal: Normalisation) -> None:
        super().__init__(generator, normal)
        self.decoder = generator.mixture_decoder

    def forward(
        self, x: Tensor, noise: Tensor, front_bias: Tensor, content_weight: Tensor, content_bias: Tensor
    ) -> tuple[Tensor, Tensor]:
        e, alpha = self.embed(x, front_bias, content_weight, content_bias)
        return self.decoder(e, alpha) * self.y_deviation + self.y_mean, alpha
