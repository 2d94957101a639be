"""The whole chain of Fig. 2: motion encoder, content modulator and one of the two decoders."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from training.networks.decoder import Denoiser, MixtureDecoder, blend_codes
from training.networks.diffusion import ReverseStep
from training.networks.modulator import ContentModulator
from training.networks.motion_encoder import MotionEncoder
from training.presets import ModelConfig


class Generator(nn.Module):
    """Normalised x `(B, 472)` and Z^t `(B, 384)` to normalised y `(B, output)`.

    `code_mean`, `code_deviation` `(K, output)` standardise Z^c for the diffusion; measured before stage 3.
    """

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.config = config
        self.encoder = MotionEncoder(config)
        self.modulator = ContentModulator(config)
        self.mixture_decoder = MixtureDecoder(config)
        self.denoiser = Denoiser(config)
        size = (config.experts, config.output_size)
        self.register_buffer("code_mean", torch.zeros(size))
        self.register_buffer("code_deviation", torch.ones(size))

    def embed(self, x: Tensor, z: Tensor) -> tuple[Tensor, Tensor]:
        """E `(B, n)` and alpha `(B, K)`."""
        w, alpha = self.encoder(x)
        return self.modulator(w, z, alpha), alpha

    def decode_mixture(self, x: Tensor, z: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """y by E_d, with E and alpha: stage 2, and the `w/o-Diffusion` variant."""
        e, alpha = self.embed(x, z)
        return self.mixture_decoder(e, alpha), e, alpha

    def clean_codes(self, predicted: Tensor) -> Tensor:
        """Standardised codes back to the scale of y."""
        return predicted * self.code_deviation + self.code_mean

    def sample_codes(self, e: Tensor, noise: Tensor, steps: list[ReverseStep]) -> Tensor:
        """Eq. 4: Z^c_0 `(B, K, output)` from `noise` `(B, len(steps), K, output)` by the reverse steps (Eq. 5)."""
        condition = self.denoiser.condition(e)
        codes = noise[:, 0]
        for n, step in enumerate(steps):
            embedded = self.denoiser.embed_step(torch.tensor([step.step], device=e.device))
            clean = self.denoiser.denoise(codes, condition, embedded)
            codes = step.clean * clean + step.noisy * codes
            if n + 1 < len(steps):
                codes = codes + step.deviation * noise[:, n + 1]
        return self.clean_codes(codes)

    def sample(self, x: Tensor, z: Tensor, noise: Tensor, steps: list[ReverseStep]) -> Tensor:
        """y by the diffusion decoder."""
        e, alpha = self.embed(x, z)
        return blend_codes(self.sample_codes(e, noise, steps), alpha)
