"""Motion decoders: the one-layer MoE decoder E_d of stage 2 and the x0-predicting denoiser of stage 3 (Sec. III-E)."""

import math

import torch
from torch import Tensor, nn
from torch.nn.functional import silu

from training.networks.mixture import ExpertLinear
from training.presets import ModelConfig


class MixtureDecoder(nn.Module):
    """E_d: maps E `(B, n)` to the codes c_k `(B, K, output)`; y = Σ_k alpha_k c_k."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.layer = ExpertLinear(config.experts, config.embedding, config.output_size)

    def codes(self, e: Tensor) -> Tensor:
        """Return Z^c, the target of stage 3 (Eq. 14)."""
        return self.layer.shared(e)

    def forward(self, e: Tensor, alpha: Tensor) -> Tensor:
        repeated = e[:, None, :].expand(-1, alpha.shape[1], -1)
        return self.layer.blended(repeated, alpha)


def blend_codes(codes: Tensor, alpha: Tensor) -> Tensor:
    """Return y = Σ_k alpha_k c_k from codes `(B, K, output)` and alpha `(B, K)`."""
    return torch.einsum("bk,bko->bo", alpha, codes)


class TokenConvolution(nn.Module):
    """Conv1d of kernel 3 over the expert tokens `(B, K, n)`, written as one wide matrix product."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.linear = nn.Linear(3 * width, width)

    def forward(self, x: Tensor) -> Tensor:
        zero = torch.zeros_like(x[:, :1])
        left = torch.cat([zero, x[:, :-1]], dim=1)
        right = torch.cat([x[:, 1:], zero], dim=1)
        return self.linear(torch.cat([left, x, right], dim=-1))


class ResidualBlock(nn.Module):
    """LN, SiLU, Conv1d over the tokens, SiLU, FC, skip (Fig. 5, right)."""

    def __init__(self, width: int, dropout: float) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.convolution = TokenConvolution(width)
        self.linear = nn.Linear(width, width)
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor) -> Tensor:
        h = self.convolution(silu(self.norm(x)))
        return x + self.linear(self.dropout(silu(h)))


class Denoiser(nn.Module):
    """mu_hat(Z^c_tau, tau, E) of Eq. 5 and 6, predicted directly.

    Maps noisy codes `(B, K, output)` to clean codes of the same shape, all standardised.
    """

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        width, half = config.denoiser_width, config.denoiser_width // 2
        self.project_code = nn.Linear(config.output_size, half)
        self.project_embedding = nn.Linear(config.embedding, half)
        self.project_step = nn.Linear(64, width)
        # identifies the expert of each token, which very noisy codes do not
        self.expert_token = nn.Parameter(0.02 * torch.randn(config.experts, width))
        self.blocks = nn.ModuleList([ResidualBlock(width, 0.0) for _ in range(config.denoiser_blocks)])
        self.norm = nn.LayerNorm(width)
        self.head = nn.Linear(width, config.output_size)

    def condition(self, e: Tensor) -> Tensor:
        """Project E to `(B, width / 2)`: constant over the denoising steps, so computed once."""
        return self.project_embedding(e)

    def embed_step(self, step: Tensor) -> Tensor:
        """Return the step embedding `(B, width)`, a constant at run time."""
        frequency = torch.exp(-math.log(10000.0) * torch.arange(32, device=step.device) / 32)
        angle = step.float()[:, None] * frequency
        return self.project_step(torch.cat([angle.sin(), angle.cos()], dim=-1))

    def denoise(self, noisy: Tensor, condition: Tensor, step: Tensor) -> Tensor:
        """Predict clean codes from noisy codes, `condition(e)` and `embed_step(step)`."""
        tokens = condition[:, None, :].expand(-1, noisy.shape[1], -1)
        x = torch.cat([self.project_code(noisy), tokens], dim=-1)
        x = x + step[:, None, :] + self.expert_token
        for block in self.blocks:
            x = block(x)
        return self.head(silu(self.norm(x)))

    def forward(self, noisy: Tensor, e: Tensor, step: Tensor) -> Tensor:
        return self.denoise(noisy, self.condition(e), self.embed_step(step))
