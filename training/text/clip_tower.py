"""CLIP's text tower in plain torch: a causal transformer whose last token stands for the sentence, and its weights."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from runtime.errors import FileError
from training.text.minilm import read_safetensors

_REMEDY = "Name a folder as Hugging Face stores CLIP: config.json, model.safetensors, tokenizer.json."


@dataclass(frozen=True)
class ClipTextConfig:
    """Sizes, by the names of the checkpoint's config.json; the defaults are those of ViT-B/32, which it may leave out."""

    vocab_size: int = 49408
    hidden_size: int = 512
    intermediate_size: int = 2048
    projection_dim: int = 512
    num_hidden_layers: int = 12
    num_attention_heads: int = 8
    max_position_embeddings: int = 77
    layer_norm_eps: float = 1e-5
    hidden_act: str = "quick_gelu"

    @classmethod
    def read(cls, path: Path) -> ClipTextConfig:
        """From config.json of a whole CLIP or of its text tower; FileError when it is neither."""
        try:
            values: dict[str, Any] = json.loads(path.read_text("utf-8"))
            if values["model_type"] not in ("clip", "clip_text_model"):
                raise ValueError(f"model_type is {values['model_type']!r}")
            own = {**values, **values.get("text_config", {})}
            own["projection_dim"] = values.get(
                "projection_dim", own.get("projection_dim", cls.projection_dim)
            )
            config = cls(**{name: own[name] for name in cls.__dataclass_fields__ if name in own})
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise FileError(f"{path}: not the config.json of a CLIP ({error}).", _REMEDY) from error
        if config.hidden_act not in ("quick_gelu", "gelu"):
            raise FileError(
                f"{path}: hidden_act is {config.hidden_act!r}, expected quick_gelu or gelu.", _REMEDY
            )
        return config


class ClipLayer(nn.Module):
    """Causal self-attention and feed-forward, layer norm before each."""

    def __init__(self, config: ClipTextConfig) -> None:
        super().__init__()
        width = config.hidden_size
        self.heads, self.quick = config.num_attention_heads, config.hidden_act == "quick_gelu"
        self.layer_norm1 = nn.LayerNorm(width, config.layer_norm_eps)
        self.q_proj, self.k_proj, self.v_proj, self.out_proj = (nn.Linear(width, width) for _ in range(4))
        self.layer_norm2 = nn.LayerNorm(width, config.layer_norm_eps)
        self.fc1 = nn.Linear(width, config.intermediate_size)
        self.fc2 = nn.Linear(config.intermediate_size, width)

    def forward(self, x: Tensor, bias: Tensor) -> Tensor:
        """x `(N, L, W)`, bias `(L, L)` added to the attention scores."""
        n, length, width = x.shape
        head = width // self.heads

        def split(y: Tensor) -> Tensor:
            return y.reshape(n, length, self.heads, head).transpose(1, 2)

        y = self.layer_norm1(x)
        q, k, v = split(self.q_proj(y)), split(self.k_proj(y)), split(self.v_proj(y))
        weights = torch.softmax(q @ k.transpose(2, 3) / head**0.5 + bias, dim=-1)
        x = x + self.out_proj((weights @ v).transpose(1, 2).reshape(n, length, width))
        y = self.fc1(self.layer_norm2(x))
        y = y * torch.sigmoid(1.702 * y) if self.quick else nn.functional.gelu(y)
        return x + self.fc2(y)


class ClipTextTower(nn.Module):
    """Token ids that end in the end-of-text token → unit vectors."""

    def __init__(self, config: ClipTextConfig) -> None:
        super().__init__()
        width = config.hidden_size
        self.token_embedding = nn.Embedding(config.vocab_size, width)
        self.position_embedding = nn.Embedding(config.max_position_embeddings, width)
        self.layers = nn.ModuleList(ClipLayer(config) for _ in range(config.num_hidden_layers))
        self.final_layer_norm = nn.LayerNorm(width, config.layer_norm_eps)
        self.text_projection = nn.Linear(width, config.projection_dim, bias=False)

    def forward(self, input_ids: Tensor, attention_mask: Tensor) -> Tensor:
        """input_ids, attention_mask `(N, L)` int64 → `(N, 512)`; the last unmasked token is the end of the text."""
        positions = torch.arange(input_ids.shape[1], device=input_ids.device)
        x = self.token_embedding(input_ids) + self.position_embedding(positions)
        bias = (positions[None, :] > positions[:, None]).to(x.dtype) * -10000.0
        for layer in self.layers:
            x = layer(x, bias)
        last = (attention_mask.sum(1, keepdim=True) - 1)[..., None].expand(-1, -1, x.shape[2])
        pooled = self.text_projection(self.final_layer_norm(x).gather(1, last)[:, 0])
        return pooled / pooled.norm(dim=-1, keepdim=True).clamp(min=1e-9)


def load_tower(directory: Path) -> ClipTextTower:
    """The text tower with the weights of a CLIP folder, every tensor accounted for; FileError when one is missing."""
    tower = ClipTextTower(ClipTextConfig.read(directory / "config.json"))
    state = {
        _renamed(name): tensor.float()
        for name, tensor in _weights(directory).items()
        if name.startswith(("text_model.", "text_projection.")) and not name.endswith("position_ids")
    }
    try:
        tower.load_state_dict(state)
    except RuntimeError as error:
        raise FileError(f"{directory}: weights of another network ({error}).", _REMEDY) from error
    return tower.eval()


def _weights(directory: Path) -> dict[str, Tensor]:
    path = directory / "model.safetensors"
    if path.exists():
        return {name: torch.from_numpy(array) for name, array in read_safetensors(path).items()}
    path = directory / "pytorch_model.bin"
    try:
        return dict(torch.load(path, map_location="cpu", weights_only=True))
    except Exception as error:  # torch raises a dozen types for a missing or damaged file
        raise FileError(f"{path}: not readable weights, and no model.safetensors.", _REMEDY) from error


def _renamed(name: str) -> str:
    for old in ("text_model.", "embeddings.", "encoder.", "self_attn.", "mlp."):
        name = name.replace(old, "")
    return name
