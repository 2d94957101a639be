"""Motion generator of Fig. 2: motion encoder, content modulator and one of the two decoders."""

import torch
from torch import Tensor, nn

from runtime.motion.features import INPUT, MOTION_INPUT_SIZE
from training.networks.decoder import Denoiser, MixtureDecoder, blend_codes
from training.networks.diffusion import ReverseStep
from training.networks.mixture import ExpertLinear, Gating
from training.networks.modulator import ContentModulator
from training.presets import ModelConfig


class MotionEncoder(nn.Module):
    """Two-layer mixture of experts E_m and its phase gating E_g^p (Sec. III-B).

    Maps x `(B, 472)` to W `(B, embedding)` and alpha `(B, experts)`; W = Σ_k alpha_k W_k.
    """

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


class Generator(nn.Module):
    """Maps normalised x `(B, 472)` and Z^t `(B, 384)` to normalised y `(B, output)`.

    `code_mean` and `code_deviation` `(K, output)`, measured before stage 3, standardise the diffused variable: Z^c, or
    with `residual_diffusion` its difference from the codes of E_d.
    """

    code_mean: Tensor
    code_deviation: Tensor

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
        """Return E `(B, n)` and alpha `(B, K)`."""
        w, alpha = self.encoder(x)
        return self.modulator(w, z, alpha), alpha

    def decode_mixture(self, x: Tensor, z: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return y by E_d, E and alpha: stage 2 and the `w/o-Diffusion` variant."""
        e, alpha = self.embed(x, z)
        return self.mixture_decoder(e, alpha), e, alpha

    def target_codes(self, e: Tensor, alpha: Tensor, target: Tensor) -> Tensor:
        """Return the standardised target `(B, K, output)` of the diffusion: E_d's codes (Eq. 14), or their residual r.

        r is the captured y (`target`) minus E_d's blended y, the same for every expert: alpha sums to one, so codes plus r
        blend to `target`. The diffusion thus learns the distribution of the capture around E_d's mean. With
        `residual_shares` expert k gets r alpha_k / Σ alpha^2, which blends to the same.
        """
        codes = self.mixture_decoder.codes(e)
        if self.config.residual_diffusion:
            residual = (target - blend_codes(codes, alpha))[:, None]
            codes = residual.expand_as(codes)
            if self.config.residual_shares:
                codes = residual * (alpha / alpha.square().sum(1, keepdim=True))[..., None]
        return (codes - self.code_mean) / self.code_deviation

    def clean_codes(self, predicted: Tensor, e: Tensor) -> Tensor:
        """Return Z^c in the units of y from the denoiser's prediction."""
        codes = predicted * self.code_deviation + self.code_mean
        return codes + self.mixture_decoder.codes(e) if self.config.residual_diffusion else codes

    def sample_codes(self, e: Tensor, noise: Tensor, steps: list[ReverseStep]) -> Tensor:
        """Sample Z^c_0 `(B, K, output)` (Eq. 4) from `noise` `(B, len(steps), K, output)` by the reverse steps (Eq. 5)."""
        condition = self.denoiser.condition(e)
        codes = noise[:, 0]
        for n, step in enumerate(steps):
            embedded = self.denoiser.embed_step(torch.tensor([step.step], device=e.device))
            clean = self.denoiser.denoise(codes, condition, embedded)
            codes = step.clean * clean + step.noisy * codes
            if n + 1 < len(steps):
                codes = codes + step.deviation * noise[:, n + 1]
        return self.clean_codes(codes, e)

    def sample(self, x: Tensor, z: Tensor, noise: Tensor, steps: list[ReverseStep]) -> Tensor:
        """Return y by the diffusion decoder."""
        e, alpha = self.embed(x, z)
        return blend_codes(self.sample_codes(e, noise, steps), alpha)
