"""Content encoder (Sec. III-C, Fig. 4): body-part motion VAE, text VAE, and the sequence decoder between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from runtime.skeleton import PART_JOINTS, PART_NAMES, J
from training.gpu import constant
from training.presets import ModelConfig
from training.text.clip_measures import signs_of

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
        """Return mu + Sigma of Eq. 2 as one vector per part `(B, 6, 128)`."""
        return torch.cat([self.mean, (0.5 * self.log_variance).exp()], dim=-1)


class PartAttention(nn.Module):
    """E_J: one attention layer; the learnable token of each part attends to its own joints and the global motion."""

    blocked: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.project = nn.Linear(JOINT_FEATURES, PART_SIZE)
        self.project_global = nn.Linear(3, PART_SIZE)
        self.joint_embedding = nn.Parameter(0.1 * torch.randn(J + 1, PART_SIZE))
        self.part_token = nn.Parameter(0.1 * torch.randn(PARTS, PART_SIZE))
        self.attention = nn.MultiheadAttention(PART_SIZE, 1, dropout=0.1, batch_first=True)
        self.norm_1, self.norm_2 = nn.LayerNorm(PART_SIZE), nn.LayerNorm(PART_SIZE)
        self.feedforward = nn.Sequential(nn.Linear(PART_SIZE, 256), nn.GELU(), nn.Linear(256, PART_SIZE))
        blocked = torch.ones(PARTS, J + 1, dtype=torch.bool)
        for number, name in enumerate(PART_NAMES):
            blocked[number, list(PART_JOINTS[name])] = False
        blocked[:, J] = False  # every part sees the global token, root displacement
        self.register_buffer("blocked", blocked)

    def forward(self, joints: Tensor, root: Tensor) -> Tensor:
        """Map joints `(B, T, 31, 9)` and root velocity `(B, T, 3)` to Z^J `(B, T, 6, 64)`."""
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


def _layer(config: ModelConfig) -> dict[str, Any]:
    heads, feedforward = config.content_heads, config.content_feedforward
    return {
        "nhead": heads,
        "dim_feedforward": feedforward,
        "dropout": 0.1,
        "activation": "gelu",
        "batch_first": True,
    }


class MotionSequenceEncoder(nn.Module):
    """E_J, then E_T: encodes a sequence `(B, 40, 31, 9)` as six independent VAE tokens."""

    position: Tensor

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.joints = PartAttention()
        self.tokens = nn.Parameter(0.1 * torch.randn(PARTS, 2, PART_SIZE))  # mean and variance
        layer = nn.TransformerEncoderLayer(PART_SIZE, **_layer(config))
        self.temporal = nn.TransformerEncoder(layer, config.content_layers, enable_nested_tensor=False)
        self.register_buffer("position", _position_table(SEQUENCE_LENGTH + 2, PART_SIZE))

    def forward(self, joints: Tensor, root: Tensor) -> Gaussian:
        batch = joints.shape[0]  # len() would make the exported batch size constant
        sequence = self.joints(joints, root).transpose(1, 2)  # (B, 6, T, 64)
        tokens = self.tokens.expand(batch, -1, -1, -1)
        x = torch.cat([tokens, sequence], dim=2).flatten(0, 1) + self.position
        out = self.temporal(x)[:, :2].unflatten(0, (batch, PARTS))
        return Gaussian(out[:, :, 0], out[:, :, 1].clamp(-10.0, 4.0))


class PartTextEncoder(nn.Module):
    """Body-part MLP: maps six sentence embeddings `(B, 6, D)` to six VAE tokens; parts never mix.

    If one-sided (`runtime.prompts.content`), the last number of a sentence is its side: left and right limbs share
    tokens, and the second half of the code of torso and head changes sign with the side. So mirrored words give the
    mirrored code: limbs swapped, and the second half of torso and head negated.
    """

    token: Tensor
    odd: Tensor

    def __init__(self, text_size: int, hidden: int = 256, one_sided: bool = False) -> None:
        super().__init__()
        self.one_sided = one_sided
        text_size -= one_sided
        self.scale = text_size**0.5
        self.part = nn.Parameter(0.1 * torch.randn(PARTS, hidden))
        self.first = nn.Linear(text_size, hidden)
        self.second = nn.Linear(hidden, hidden)
        self.mean = nn.Linear(hidden, PART_SIZE)
        self.variance = nn.Linear(hidden, PART_SIZE)
        self.register_buffer("token", torch.tensor(_LEFT if one_sided else range(PARTS)), persistent=False)
        self.register_buffer("odd", odd_codes(), persistent=False)

    def forward(self, embeddings: Tensor) -> Gaussian:
        words = embeddings[..., :-1] if self.one_sided else embeddings
        # components of unit sentence embeddings are about 0.05: scale them to one
        hidden = nn.functional.gelu(self.first(words * self.scale) + self.part[self.token])
        hidden = nn.functional.gelu(self.second(hidden))
        mean = self.mean(hidden)
        if self.one_sided:
            mean = mean * (1.0 + self.odd * (embeddings[..., -1:] - 1.0))
        return Gaussian(mean, self.variance(hidden).clamp(-10.0, 4.0))


# left counterpart of each part, and the parts on the midline
_LEFT = [PART_NAMES.index(name.replace("right_", "left_")) for name in PART_NAMES]
_MIDLINE = [not name.startswith(("left_", "right_")) for name in PART_NAMES]
# sign of a joint's features under mirroring: negative for x of its position, and for the entries of the first two
# columns of its rotation that couple x with another axis
_PARITY = (-1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0)


def odd_codes() -> Tensor:
    """Return `(6, 64)`: 1 where a code changes sign under mirroring."""
    odd = torch.zeros(PARTS, PART_SIZE)
    odd[_MIDLINE, PART_SIZE // 2 :] = 1.0
    return odd


class SequenceDecoder(nn.Module):
    """D_s: decodes six latent tokens `(B, 6, 64)` to the sequence of joints `(B, 40, 31, 9)` and root `(B, 40, 3)`."""

    position: Tensor

    def __init__(self, config: ModelConfig, size: int = 128) -> None:
        super().__init__()
        self.project = nn.Linear(PART_SIZE, size)
        self.part = nn.Parameter(0.1 * torch.randn(PARTS, size))
        self.register_buffer("position", _position_table(SEQUENCE_LENGTH, size))
        layer = nn.TransformerDecoderLayer(size, **_layer(config))
        self.decoder = nn.TransformerDecoder(layer, config.content_layers)
        self.head = nn.Linear(size, J * JOINT_FEATURES + 3)

    def forward(self, z: Tensor) -> Tensor:
        memory = self.project(z) + self.part
        query = self.position.expand(len(z), -1, -1)
        return self.head(self.decoder(query, memory))


def pose_statistics(joints: Tensor) -> list[Tensor]:
    """Return mean and deviation over time of each part's joints `(B, T, 31, 9)`: six tensors `(B, joints * 18)`.

    They cover the content of a part's words except timing: where it is held, and how far it swings.
    """
    mean, deviation = joints.mean(1), joints.std(1)
    both = torch.cat([mean, deviation], dim=-1)
    return [both[:, constant(PART_JOINTS[name], both.device)].flatten(1) for name in PART_NAMES]


class StatisticsReader(nn.Module):
    """Predicts standardised pose statistics from the codes by one linear map per part.

    A step moves a foot by a metre, a word turns it by some degrees: the latter hardly affects the reconstruction of
    Eq. 3, and the contrastive loss alone separates codes without ordering them. A linear map orders them: wider or higher
    lies farther along the same direction, also beyond the training data. If one-sided, right limbs use the map of the
    left ones, and odd statistics of torso and head depend only on odd codes.
    """

    centre: Tensor
    deviation: Tensor
    odd: Tensor

    def __init__(self, one_sided: bool = False) -> None:
        super().__init__()
        self.one_sided = one_sided
        sizes = [len(PART_JOINTS[name]) * 2 * JOINT_FEATURES for name in PART_NAMES]
        self.parts = nn.ModuleList([nn.Linear(PART_SIZE, size) for size in sizes])
        self.register_buffer("centre", torch.zeros(sum(sizes)))
        self.register_buffer("deviation", torch.ones(sum(sizes)))
        parity = torch.tensor([*_PARITY, *[1.0] * JOINT_FEATURES])  # deviations are even
        for k, name in enumerate(PART_NAMES):
            self.register_buffer(f"parity_{name}", parity.repeat(sizes[k] // len(parity)), persistent=False)
        self.register_buffer("odd", odd_codes(), persistent=False)

    def measure(self, joints: Tensor) -> None:
        """Set centre and deviation from windows `(B, T, 31, 9)`."""
        values = torch.cat(pose_statistics(joints), 1)
        self.centre.copy_(values.mean(0))
        self.deviation.copy_(values.std(0).clamp_min(0.02))

    def standardised(self, joints: Tensor) -> list[Tensor]:
        """Return standardised statistics of windows."""
        values = pose_statistics(joints)
        whole = (torch.cat(values, 1) - self.centre) / self.deviation
        return list(whole.split([v.shape[1] for v in values], dim=1))

    def forward(self, z: Tensor) -> list[Tensor]:
        """Predict the statistics from codes `(B, 6, 64)`."""
        return [self._read(z[:, k], k, name) for k, name in enumerate(PART_NAMES)]

    def _read(self, z: Tensor, k: int, name: str) -> Tensor:
        if not self.one_sided:
            return self.parts[k](z)
        parity, read = getattr(self, f"parity_{name}"), self.parts[_LEFT[k]]
        assert isinstance(read, nn.Linear)
        if not _MIDLINE[k]:
            values = read(z)
            return values * parity if _LEFT[k] != k else values
        odd = nn.functional.linear(z * self.odd[k], read.weight)
        return torch.where(parity < 0, odd, read(z * (1.0 - self.odd[k])))


class MeasuresReader(nn.Module):
    """Predicts a part's standardised measures (`training.text.clip_measures`), each along one direction of its code.

    Means and deviations of joints hardly distinguish swinging from still hips, and later networks cannot separate codes
    that are as close as their sentences. Directions have unit length, so one standard deviation of a measure spans
    `1 / GAIN` of the code: a small difference in the code cannot be amplified by weights.
    """

    odd: Tensor
    GAIN = 0.5

    def __init__(self, signs: Sequence[Sequence[float]], one_sided: bool = False) -> None:
        """`signs[k]` belongs to part k: -1 where a measure changes sign under mirroring, else 1."""
        super().__init__()
        self.one_sided = one_sided
        self.parts = nn.ModuleList([nn.Linear(PART_SIZE, len(own)) for own in signs])
        for k, own in enumerate(signs):
            self.register_buffer(f"odd_{k}", torch.tensor([s < 0 for s in own]), persistent=False)
        self.register_buffer("odd", odd_codes(), persistent=False)

    def forward(self, z: Tensor) -> list[Tensor]:
        """Return six tensors `(B, n)` from codes `(B, 6, 64)`."""
        return [self._read(z[:, k], k) for k in range(PARTS)]

    def _read(self, z: Tensor, k: int) -> Tensor:
        read = self.parts[_LEFT[k] if self.one_sided else k]
        assert isinstance(read, nn.Linear)
        allowed = torch.ones_like(read.weight)
        bias: Tensor = read.bias
        if self.one_sided and _MIDLINE[k]:
            odd = getattr(self, f"odd_{k}")
            allowed = torch.where(odd[:, None], self.odd[k], 1.0 - self.odd[k])
            bias = torch.where(odd, 0.0, bias)
        direction = nn.functional.normalize(read.weight * allowed, dim=1)
        return nn.functional.linear(z, self.GAIN * direction, bias)


class ContentEncoder(nn.Module):
    """The networks that stage 1 trains together."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.motion = MotionSequenceEncoder(config)
        self.text = PartTextEncoder(config.sentence_size, one_sided=config.one_sided_words)
        self.decoder = SequenceDecoder(config)
        self.statistics = StatisticsReader(config.one_sided_words) if config.pose_statistics else None
        signs = [signs_of(name) for name in PART_NAMES]
        self.measures = MeasuresReader(signs, config.one_sided_words) if config.measures else None
