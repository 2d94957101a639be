"""Recursive content modulator (Sec. III-D): content experts inside each outer expert, AdaIN on W."""

import torch
from torch import Tensor, nn
from torch.nn.functional import elu

from training.networks.mixture import ExpertLinear, Gating
from training.presets import ModelConfig


def instance_norm(w: Tensor) -> Tensor:
    """Return W `(B, n)` normalised by its own mean and deviation, as in AdaIN."""
    centred = w - w.mean(-1, keepdim=True)
    return centred * torch.rsqrt(centred.square().mean(-1, keepdim=True) + 1e-5)


class ContentModulator(nn.Module):
    """Maps W `(B, n)`, Z^t `(B, 384)` and alpha `(B, K)` to E `(B, n)`.

    Inner step: s^k = Σ_j beta_j s_j^k, with beta = E_g^s(Z^t). Outer step: E_k = AdaIN(W; s^k), E = Σ_k alpha_k E_k.
    s^k contains the new deviation (as an offset from one) and the new mean.
    """

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        experts, inner, (wide, narrow) = config.experts, config.content_experts, config.front
        self.gating = Gating(config.style_size, config.gating_hidden, inner)
        self.front_motion = ExpertLinear(experts, config.embedding, wide)
        self.front_style = nn.Linear(config.style_size, experts * wide, bias=False)
        self.front_narrow = ExpertLinear(experts, wide, narrow)
        # the inner experts of all outer experts: (K, J, narrow, 2 n)
        scale = 1.0 / (narrow**0.5)
        size = (experts, inner, narrow, 2 * config.embedding)
        self.content_weight = nn.Parameter(torch.empty(size).uniform_(-scale, scale))
        self.content_bias = nn.Parameter(torch.zeros(experts, inner, 2 * config.embedding))

    def features(self, w: Tensor, z: Tensor) -> Tensor:
        """Return fused motion and content features `(B, K, narrow)`, the input of the content experts."""
        front = self.front_motion.shared(w)
        front = elu(front + self.front_style(z).view(front.shape))
        return elu(self.front_narrow.separate(front))

    def forward(self, w: Tensor, z: Tensor, alpha: Tensor) -> Tensor:
        beta = self.gating(z)
        fused = self.features(w, z)
        # Σ_k Σ_j alpha_k beta_j (u_k A_kj + b_kj) as one product; AdaIN is linear in s, so blending s^k by alpha
        # first gives the same E as blending the E_k.
        blend = alpha[:, :, None] * beta[:, None, :]
        scaled = (blend[..., None] * fused[:, :, None, :]).flatten(1)
        weight = self.content_weight.flatten(0, 2)
        s = scaled @ weight + blend.flatten(1) @ self.content_bias.flatten(0, 1)
        deviation, mean = s.chunk(2, dim=-1)
        return (1.0 + deviation) * instance_norm(w) + mean

    def fold(self, z: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Precompute everything that depends only on the prompt, once per prompt change (exact).

        Maps Z^t `(1, 384)` to front bias `(K, wide)`, folded content weight `(K * narrow, 2 n)` and bias `(K, 2 n)`.
        """
        beta = self.gating(z)[0]
        experts = self.content_weight.shape[0]
        bias = self.front_style(z).view(experts, -1) + self.front_motion.bias
        weight = torch.einsum("j,kjio->kio", beta, self.content_weight).flatten(0, 1)
        return bias, weight, torch.einsum("j,kjo->ko", beta, self.content_bias)
