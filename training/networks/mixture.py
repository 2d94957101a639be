"""Mixtures of experts written as one matrix product per layer, and the gating networks that blend them."""

import math

import torch
from torch import Tensor, nn


class Gating(nn.Module):
    """Blending coefficients of E_g: three layers, ELU, softmax; `(B, inputs)` to `(B, experts)`."""

    def __init__(self, inputs: int, hidden: int, experts: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(inputs, hidden),
            nn.ELU(),
            nn.Linear(hidden, hidden),
            nn.ELU(),
            nn.Linear(hidden, experts),
        )

    def forward(self, x: Tensor) -> Tensor:
        return torch.softmax(self.layers(x), dim=-1)


class ExpertLinear(nn.Module):
    """One linear layer per expert; weights `(experts, inputs, outputs)`, bias `(experts, outputs)`."""

    def __init__(self, experts: int, inputs: int, outputs: int) -> None:
        super().__init__()
        bound = 1.0 / math.sqrt(inputs)
        self.weight = nn.Parameter(torch.empty(experts, inputs, outputs).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(experts, outputs).uniform_(-bound, bound))

    def shared(self, x: Tensor) -> Tensor:
        """Apply every expert to the same input: `(B, inputs)` to `(B, experts, outputs)` by one product."""
        experts, inputs, outputs = self.weight.shape
        wide = self.weight.permute(1, 0, 2).reshape(inputs, experts * outputs)
        return (x @ wide).view(-1, experts, outputs) + self.bias

    def separate(self, x: Tensor) -> Tensor:
        """Apply each expert to its own input: `(B, experts, inputs)` to `(B, experts, outputs)`."""
        return torch.einsum("bki,kio->bko", x, self.weight) + self.bias

    def blended(self, x: Tensor, blend: Tensor) -> Tensor:
        """Return Σ_k blend_k (x_k A_k + b_k): `(B, experts, inputs)`, `(B, experts)` to `(B, outputs)` by one product."""
        experts, inputs, outputs = self.weight.shape
        scaled = (x * blend[..., None]).reshape(-1, experts * inputs)
        return scaled @ self.weight.view(experts * inputs, outputs) + blend @ self.bias
