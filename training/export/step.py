"""Step graph, optimised for speed: prompt folded in, one matrix product per layer, weights in its layout.

It computes the same values as `training.networks.generator.Generator.sample` (checked at export) with other operations:
all experts of a layer are one matrix product, E's projection into the denoiser is computed once for all steps, step
embeddings are constants, and the convolution over the tokens is one wide product.
"""

from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.functional import elu, pad, silu

from runtime.motion.features import INPUT_SIZE, MOTION_INPUT_SIZE
from runtime.motion.model_files import FOLDED
from training.batches import Normalisation, normalised
from training.export.graph import export_graph
from training.networks.decoder import ResidualBlock, blend_codes
from training.networks.diffusion import ReverseStep
from training.networks.generator import Generator
from training.networks.modulator import instance_norm


class ScaledGraph(nn.Module):
    """A graph with x and y in physical units, and the normalisation of the networks."""

    x_mean: Tensor
    x_deviation: Tensor
    x_limit: Tensor
    y_mean: Tensor
    y_deviation: Tensor

    def __init__(self, normal: Normalisation) -> None:
        super().__init__()
        for name, value in vars(normal).items():
            self.keep(name, value)

    def keep(self, name: str, value: Tensor) -> None:
        """Register a constant of the graph with contiguous memory."""
        self.register_buffer(name, value.detach().clone().contiguous())


class FrameGraph(ScaledGraph):
    """Maps x in physical units to E and alpha, with the tensors of `ContentModulator.fold`.

    These have a leading dimension: 1 if all characters of the batch share a prompt, or the batch.
    """

    encoder_first: Tensor
    encoder_first_bias: Tensor
    encoder_second: Tensor
    encoder_second_bias: Tensor
    front_wide: Tensor
    front_narrow: Tensor
    front_narrow_bias: Tensor

    def __init__(self, generator: Generator, normal: Normalisation) -> None:
        super().__init__(normal)
        self.config = generator.config
        encoder, modulator = generator.encoder, generator.modulator
        self.gating = encoder.gating
        self.keep("encoder_first", encoder.first.weight.permute(1, 0, 2).flatten(1))  # (inputs, K hidden)
        self.keep("encoder_first_bias", encoder.first.bias.flatten())
        self.keep("encoder_second", encoder.second.weight.flatten(0, 1))  # (K hidden, embedding)
        self.keep("encoder_second_bias", encoder.second.bias)
        self.keep("front_wide", modulator.front_motion.weight.permute(1, 0, 2).flatten(1))
        self.keep("front_narrow", modulator.front_narrow.weight)
        self.keep("front_narrow_bias", modulator.front_narrow.bias[:, None])

    def embed(
        self, x: Tensor, front_bias: Tensor, content_weight: Tensor, content_bias: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return E `(B, n)` and alpha `(B, K)` of x `(B, 472)`."""
        experts, (wide, _) = self.config.experts, self.config.front
        x = normalised(x, self.x_mean, self.x_deviation, self.x_limit)
        alpha = self.gating(x[:, MOTION_INPUT_SIZE:])
        weight = alpha[:, :, None]
        hidden = elu(x[:, :MOTION_INPUT_SIZE] @ self.encoder_first + self.encoder_first_bias)
        blended = (hidden.view(-1, experts, self.config.hidden) * weight).flatten(1)
        w = blended @ self.encoder_second + alpha @ self.encoder_second_bias
        front = elu((w @ self.front_wide).view(-1, experts, wide) + front_bias)
        fused = elu(front.transpose(0, 1) @ self.front_narrow + self.front_narrow_bias).transpose(0, 1)
        scaled = (fused * weight).flatten(1)
        s = (scaled[:, None] @ content_weight + alpha[:, None] @ content_bias)[:, 0]
        deviation, mean = s.chunk(2, dim=-1)
        return (1.0 + deviation) * instance_norm(w) + mean, alpha


class StepGraph(FrameGraph):
    """Maps x `(B, 472)` and noise to y `(B, output)` in physical units; the denoising steps are unrolled."""

    code_weight: Tensor
    condition_weight: Tensor
    head_weight: Tensor
    head_bias: Tensor
    base_weight: Tensor
    base_bias: Tensor
    code_mean: Tensor
    code_deviation: Tensor
    taps: Tensor

    def __init__(self, generator: Generator, normal: Normalisation, steps: list[ReverseStep]) -> None:
        super().__init__(generator, normal)
        self.steps = steps
        denoiser = generator.denoiser
        self.keep("code_weight", denoiser.project_code.weight.T)
        self.keep("condition_weight", denoiser.project_embedding.weight.T)
        bias = torch.cat([denoiser.project_code.bias, denoiser.project_embedding.bias])
        for number, step in enumerate(steps):
            embedded = denoiser.embed_step(torch.tensor([step.step])) + denoiser.expert_token + bias
            self.keep(f"step_{number}", embedded)
        blocks = [block for block in denoiser.blocks if isinstance(block, ResidualBlock)]
        self.norms = nn.ModuleList([block.norm for block in blocks])
        for number, block in enumerate(blocks):
            self.keep(f"convolution_{number}", block.convolution.linear.weight.T)
            self.keep(f"convolution_{number}_bias", block.convolution.linear.bias)
            self.keep(f"linear_{number}", block.linear.weight.T)
            self.keep(f"linear_{number}_bias", block.linear.bias)
        self.norm = denoiser.norm
        self.keep("head_weight", denoiser.head.weight.T)
        self.keep("head_bias", denoiser.head.bias)
        if self.config.residual_diffusion:
            base = generator.mixture_decoder.layer
            self.keep("base_weight", base.weight.permute(1, 0, 2).flatten(1))  # (embedding, K output)
            self.keep("base_bias", base.bias)
        self.keep("code_mean", generator.code_mean)
        self.keep("code_deviation", generator.code_deviation)
        # indices of the three taps of the convolution in the zero-padded row of tokens
        taps = torch.arange(self.config.experts)[:, None] + torch.arange(3)
        self.keep("taps", taps.flatten())

    def forward(
        self, x: Tensor, noise: Tensor, front_bias: Tensor, content_weight: Tensor, content_bias: Tensor
    ) -> tuple[Tensor, Tensor]:
        e, alpha = self.embed(x, front_bias, content_weight, content_bias)
        condition = (e @ self.condition_weight)[:, None].expand(-1, self.config.experts, -1)
        codes = noise[:, 0]
        for number, step in enumerate(self.steps):
            clean = self._denoise(codes, condition, number)
            codes = (
                clean if step.noisy == 0.0 and step.clean == 1.0 else step.clean * clean + step.noisy * codes
            )
            if number + 1 < len(self.steps):
                codes = codes + step.deviation * noise[:, number + 1]
        codes = codes * self.code_deviation + self.code_mean
        if self.config.residual_diffusion:
            codes = codes + (e @ self.base_weight).view(-1, *codes.shape[1:]) + self.base_bias
        y = blend_codes(codes, alpha)
        return y * self.y_deviation + self.y_mean, alpha

    def _denoise(self, codes: Tensor, condition: Tensor, number: int) -> Tensor:
        tokens = torch.cat([codes @ self.code_weight, condition], dim=-1) + getattr(self, f"step_{number}")
        for block, norm in enumerate(self.norms):
            h = silu(self._convolve(silu(norm(tokens)), block))
            h = h @ getattr(self, f"linear_{block}") + getattr(self, f"linear_{block}_bias")
            tokens = tokens + h
        return silu(self.norm(tokens)) @ self.head_weight + self.head_bias

    def _convolve(self, tokens: Tensor, block: int) -> Tensor:
        _, count, width = tokens.shape
        neighbours = pad(tokens, (0, 0, 1, 1)).index_select(1, self.taps).reshape(-1, count, 3 * width)
        return neighbours @ getattr(self, f"convolution_{block}") + getattr(self, f"convolution_{block}_bias")


def export_step(graph: FrameGraph, generator: Generator, steps: int, path: Path) -> float:
    """Write a step graph for any batch with one style or one per character; returns its largest difference from torch."""
    config = generator.config
    with torch.no_grad():
        folds = [generator.modulator.fold(torch.randn(1, config.style_size)) for _ in range(2)]
    folded = dict(zip(FOLDED, map(torch.stack, zip(*folds, strict=True)), strict=True))
    noise = torch.randn(2, steps, config.experts, config.output_size)
    inputs = {"x": torch.randn(2, INPUT_SIZE), "noise": noise, **folded}
    return export_graph(graph, inputs, ["y", "alpha"], path, leading=dict.fromkeys(FOLDED, "styles"))


class PlainGraph(ScaledGraph):
    """The networks exported without optimisation, with Z^t `(B, 384)` as an input: the reference of speed comparisons.

    The content experts are blended in every frame.
    """

    def __init__(self, generator: Generator, normal: Normalisation, steps: list[ReverseStep]) -> None:
        super().__init__(normal)
        self.generator, self.steps = generator, steps

    def forward(self, x: Tensor, z: Tensor, noise: Tensor) -> Tensor:
        x = normalised(x, self.x_mean, self.x_deviation, self.x_limit)
        y = self.generator.sample(x, z, noise, self.steps)
        return y * self.y_deviation + self.y_mean
