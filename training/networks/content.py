"""Content encoder (Sec. III-C, Fig. 4): body-part motion VAE, text VAE, and the sequence decoder between them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from runtime.skeleton import PART_JOINTS, PART_NAMES, J
from training.presets import ModelConfig

SEQUENCE_LENGTH = 40  # T
PART_SIZE = 64
PARTS = len(PART_NAMES)
JOINT_FEATURES = 9  # position, 6D rotation, relative to the root


@dataclass
class Gaussian:
    """Diagonal normal distribution of six part tokens: mean and log-variance `(B, 6, 64)`."""

    mean: Tensor
    log_variance: Tensor

    def sample(self) -> Tensor:
        """Reparametrised sample Z `(B, 6, 64)`."""
        return self.mean + torch.randn_like(self.mean) * (0.5 * self.log_variance).exp()

    def parameters_flat(self) -> Tensor:
        """mu + Sigma of Eq. 2 as one vector per part `(B, 6, 128)`."""
        return torch.cat([self.mean, (0.5 * self.log_variance).exp()], dim=-1)


class PartAttention(nn.Module):
    """E_J: one attention layer in which each part's learnable token sees its own joints and the global motion."""

    def __init__(self, feedforward: int = 256, dropout: float = 0.1) -> None:
        super().__init__()
        self.project = nn.Linear(JOINT_FEATURES, PART_SIZE)
        self.project_global = nn.Linear(3, PART_SIZE)
        self.joint_embedding = nn.Parameter(0.1 * torch.randn(J + 1, PART_SIZE))
        self.part_token = nn.Parameter(0.1 * torch.randn(PARTS, PART_SIZE))
        self.attention = nn.MultiheadAttention(PART_SIZE, 1, dropout=dropout, batch_first=True)
        self.norm_1, self.norm_2 = nn.LayerNorm(PART_SIZE), nn.LayerNorm(PART_SIZE)
        self.feedforward = nn.Sequential(
            nn.Linear(PART_SIZE, feedforward), nn.GELU(), nn.Linear(feedforward, PART_SIZE)
        )
        blocked = torch.ones(PARTS, J + 1, dtype=torch.bool)
        for number, name in enumerate(PART_NAMES):
            blocked[number, list(PART_JOINTS[name])] = False
        blocked[:, J] = False  # the global token: root displacement
        self.register_buffer("blocked", blocked)

    def forward(self, joints: Tensor, root: Tensor) -> Tensor:
        """Joints `(B, T, 31, 9)`, root velocity `(B, T, 3)` to Z^J `(B, T, 6, 64)`."""
        batch, length = joints.shape[:2]
        tokens = torch.cat([self.project(joints), self.project_global(root)[:, :, None]], dim=2)
        tokens = (tokens + self.joint_embedding).flatten(0, 1)
        query = self.part_token.expand(batch * length, -1, -1)
        attended, _ = self.attention(query, tokens, tokens, attn_mask=self.blocked, need_weights=False)
        x = self.norm_1(query + attended)
        return self.norm_2(x + self.feedforward(x)).unflatten(0, (batch, length))


def _position_table(length: int, size: int) -> Tensor:
    position = torch.arange(length)[:, None]
    frequency = torch.exp(-torch.log(torch.tensor(10000.0)) * torch.arange(0, size, 2) / size)
    table = torch.zeros(length, size)
    table[:, 0::2], table[:, 1::2] = torch.sin(position * frequency), torch.cos(position * frequency)
    return table


def _transformer(config: ModelConfig) -> nn.TransformerEncoder:
    layer = nn.TransformerEncoderLayer(
        PART_SIZE,
        config.content_heads,
        config.content_feedforward,
        dropout=0.1,
        activation="gelu",
        batch_first=True,
    )
    return nn.TransformerEncoder(layer, config.content_layers, enable_nested_tensor=False)


class MotionSequenceEncoder(nn.Module):
    """E_J then E_T: a sequence `(B, 40, 31, 9)` to six independent VAE tokens."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.joints = PartAttention()
        self.tokens = nn.Parameter(0.1 * torch.randn(PARTS, 2, PART_SIZE))  # mean and variance
        self.temporal = _transformer(config)
        self.register_buffer("position", _position_table(SEQUENCE_LENGTH + 2, PART_SIZE))

    def forward(self, joints: Tensor, root: Tensor) -> Gaussian:
        batch = joints.shape[0]  # len() would fix the exported batch
        sequence = self.joints(joints, root).transpose(1, 2)  # (B, 6, T, 64)
        tokens = self.tokens.expand(batch, -1, -1, -1)
        x = torch.cat([tokens, sequence], dim=2).flatten(0, 1) + self.position
        out = self.temporal(x)[:, :2].unflatten(0, (batch, PARTS))
        return Gaussian(out[:, :, 0], out[:, :, 1].clamp(-10.0, 4.0))


class PartTextEncoder(nn.Module):
    """Body-part MLP: six sentences `(B, 6, D)`, embedded, to six VAE tokens; parts never mix."""

    def __init__(self, text_size: int, hidden: int = 256) -> None:
        super().__init__()
        self.scale = text_size**0.5
        self.part = nn.Parameter(0.1 * torch.randn(PARTS, hidden))
        self.first = nn.Linear(text_size, hidden)
        self.second = nn.Linear(hidden, hidden)
        self.mean = nn.Linear(hidden, PART_SIZE)
        self.variance = nn.Linear(hidden, PART_SIZE)

    def forward(self, embeddings: Tensor) -> Gaussian:
        # unit sentence embeddings have components of about 0.05: brought to unit scale
        hidden = nn.functional.gelu(self.first(embeddings * self.scale) + self.part)
        hidden = nn.functional.gelu(self.second(hidden))
        return Gaussian(self.mean(hidden), self.variance(hidden).clamp(-10.0, 4.0))


class SequenceDecoder(nn.Module):
    """D_s: six latent tokens `(B, 6, 64)` back to the sequence of joints `(B, 40, 31, 9)` and root `(B, 40, 3)`."""

    def __init__(self, config: ModelConfig, size: int = 128) -> None:
        super().__init__()
        self.project = nn.Linear(PART_SIZE, size)
        self.part = nn.Parameter(0.1 * torch.randn(PARTS, size))
        self.register_buffer("position", _position_table(SEQUENCE_LENGTH, size))
        layer = nn.TransformerDecoderLayer(
            size,
            config.content_heads,
            config.content_feedforward,
            dropout=0.1,
            activation="gelu",
            batch_first=True,
        )
        self.decoder = nn.TransformerDecoder(layer, config.content_layers)
        self.head = nn.Linear(size, J * JOINT_FEATURES + 3)

    def forward(self, z: Tensor) -> Tensor:
        memory = self.project(z) + self.part
        query = self.position.expand(len(z), -1, -1)
        return self.head(self.decoder(query, memory))


class ContentEncoder(nn.Module):
    """The three networks that stage 1 trains together."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.motion = MotionSequenceEncoder(config)
        self.text = PartTextEncoder(config.sentence_size)
        self.decoder = SequenceDecoder(config)
