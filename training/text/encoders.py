"""Text encoders in plain torch, all-MiniLM-L6-v2 and CLIP's text tower, with weights in the format of Hugging Face."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from runtime.errors import FileError

Network = TypeVar("Network", bound=nn.Module)
_REMEDY = "Give a folder in Hugging Face's format: config.json, model.safetensors, tokenizer.json."
_BERT_NAMES = (  # patterns of a checkpoint's names and their replacements here, applied in this order
    (r"^embeddings\.LayerNorm", "embedding_norm"),
    (r"^embeddings\.", ""),
    (r"^encoder\.layer\.", "layers."),
    (r"attention\.output\.LayerNorm", "attention_norm"),
    (r"attention\.output\.dense", "attention_output"),
    (r"attention\.self\.", ""),
    (r"intermediate\.dense", "intermediate"),
    (r"output\.LayerNorm", "output_norm"),
    (r"output\.dense", "output"),
)
_CLIP_NAMES = (
    (r"^text_model\.", ""),
    (r"^embeddings\.", ""),
    (r"^encoder\.", ""),
    (r"self_attn\.out_proj", "attention_output"),
    (r"self_attn\.q_proj", "query"),
    (r"self_attn\.k_proj", "key"),
    (r"self_attn\.v_proj", "value"),
    (r"mlp\.fc1", "intermediate"),
    (r"mlp\.fc2", "output"),
    (r"layer_norm1", "attention_norm"),
    (r"layer_norm2", "output_norm"),
)


@dataclass(frozen=True)
class BertConfig:
    """Layer sizes of MiniLM, named as in the checkpoint's config.json."""

    vocab_size: int = 30522
    hidden_size: int = 384
    num_hidden_layers: int = 6
    num_attention_heads: int = 12
    intermediate_size: int = 1536
    max_position_embeddings: int = 512
    type_vocab_size: int = 2
    layer_norm_eps: float = 1e-12
    hidden_act: str = "gelu"

    @classmethod
    def read(cls, path: Path) -> BertConfig:
        """Read a checkpoint's config.json; FileError if a field is missing."""
        try:
            values = json.loads(path.read_text("utf-8"))
            return cls(**{name: values[name] for name in cls.__dataclass_fields__})
        except (OSError, json.JSONDecodeError, KeyError) as error:
            raise FileError(f"{path}: not a BERT config.json ({error}).", _REMEDY) from error


@dataclass(frozen=True)
class ClipTextConfig:
    """Layer sizes of CLIP's text tower; defaults are those of ViT-B/32, which a config.json may omit."""

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
        """Read the config.json of a complete CLIP model or of its text tower; FileError for other files."""
        try:
            values: dict[str, Any] = json.loads(path.read_text("utf-8"))
            if values["model_type"] not in ("clip", "clip_text_model"):
                raise ValueError(f"model_type is {values['model_type']!r}")
            own = {**values, **values.get("text_config", {})}
            if "projection_dim" in values:  # of the complete CLIP; its text_config may differ
                own["projection_dim"] = values["projection_dim"]
            config = cls(**{name: own[name] for name in cls.__dataclass_fields__ if name in own})
            if config.hidden_act not in _ACTIVATIONS:
                raise ValueError(f"hidden_act is {config.hidden_act!r}")
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise FileError(f"{path}: not the config.json of a CLIP model ({error}).", _REMEDY) from error
        return config


def _quick_gelu(x: Tensor) -> Tensor:
    return x * torch.sigmoid(1.702 * x)


_ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {"gelu": functional.gelu, "quick_gelu": _quick_gelu}


class TransformerLayer(nn.Module):
    """Self-attention and feed-forward with residuals; layer norm before each (CLIP), or after (BERT)."""

    def __init__(self, config: BertConfig | ClipTextConfig, norm_first: bool) -> None:
        super().__init__()
        width, inner = config.hidden_size, config.intermediate_size
        self.heads, self.norm_first = config.num_attention_heads, norm_first
        self.activation = _ACTIVATIONS[config.hidden_act]
        self.query, self.key, self.value, self.attention_output = (nn.Linear(width, width) for _ in range(4))
        self.attention_norm = nn.LayerNorm(width, config.layer_norm_eps)
        self.intermediate, self.output = nn.Linear(width, inner), nn.Linear(inner, width)
        self.output_norm = nn.LayerNorm(width, config.layer_norm_eps)

    def forward(self, x: Tensor, bias: Tensor) -> Tensor:
        """Transform x `(N, L, W)`; bias is added to the attention scores `(N, heads, L, L)`."""
        if self.norm_first:
            x = x + self._attend(self.attention_norm(x), bias)
            return x + self._feed(self.output_norm(x))
        x = self.attention_norm(x + self._attend(x, bias))
        return self.output_norm(x + self._feed(x))

    def _attend(self, x: Tensor, bias: Tensor) -> Tensor:
        n, length, width = x.shape
        head = width // self.heads
        # no scaled_dot_product_attention: its exported graph would have fixed lengths
        q, k, v = (
            layer(x).reshape(n, length, self.heads, head).transpose(1, 2)
            for layer in (self.query, self.key, self.value)
        )
        weights = torch.softmax(q @ k.transpose(2, 3) / head**0.5 + bias, dim=-1)
        return self.attention_output((weights @ v).transpose(1, 2).reshape(n, length, width))

    def _feed(self, x: Tensor) -> Tensor:
        return self.output(self.activation(self.intermediate(x)))


class SentenceEncoder(nn.Module):
    """MiniLM: unit sentence vectors from token ids, by BERT and the mean over unmasked tokens."""

    def __init__(self, config: BertConfig) -> None:
        super().__init__()
        width = config.hidden_size
        self.word_embeddings = nn.Embedding(config.vocab_size, width)
        self.position_embeddings = nn.Embedding(config.max_position_embeddings, width)
        self.token_type_embeddings = nn.Embedding(config.type_vocab_size, width)
        self.embedding_norm = nn.LayerNorm(width, config.layer_norm_eps)
        layers = config.num_hidden_layers
        self.layers = nn.ModuleList(TransformerLayer(config, norm_first=False) for _ in range(layers))

    def forward(self, input_ids: Tensor, attention_mask: Tensor) -> Tensor:
        """Map input_ids, attention_mask `(N, L)` int64 to unit vectors `(N, 384)`."""
        positions = torch.arange(input_ids.shape[1], device=input_ids.device)
        x = self.word_embeddings(input_ids) + self.position_embeddings(positions)
        x = self.embedding_norm(x + self.token_type_embeddings.weight[0])
        mask = attention_mask.to(x.dtype)
        bias = (1.0 - mask)[:, None, None, :] * -10000.0
        for layer in self.layers:
            x = layer(x, bias)
        mean = (x * mask[..., None]).sum(1) / mask.sum(1, keepdim=True).clamp(min=1.0)
        return mean / mean.norm(dim=-1, keepdim=True).clamp(min=1e-9)


class ClipTextTower(nn.Module):
    """CLIP: unit vectors from token ids that end with the end-of-text token; causal attention."""

    def __init__(self, config: ClipTextConfig) -> None:
        super().__init__()
        width = config.hidden_size
        self.token_embedding = nn.Embedding(config.vocab_size, width)
        self.position_embedding = nn.Embedding(config.max_position_embeddings, width)
        layers = config.num_hidden_layers
        self.layers = nn.ModuleList(TransformerLayer(config, norm_first=True) for _ in range(layers))
        self.final_layer_norm = nn.LayerNorm(width, config.layer_norm_eps)
        self.text_projection = nn.Linear(width, config.projection_dim, bias=False)

    def forward(self, input_ids: Tensor, attention_mask: Tensor) -> Tensor:
        """Map input_ids, attention_mask `(N, L)` int64 to `(N, 512)`; the last unmasked token is the end of the text."""
        positions = torch.arange(input_ids.shape[1], device=input_ids.device)
        x = self.token_embedding(input_ids) + self.position_embedding(positions)
        bias = (positions[None, :] > positions[:, None]).to(x.dtype) * -10000.0
        for layer in self.layers:
            x = layer(x, bias)
        last = (attention_mask.sum(1, keepdim=True) - 1)[..., None].expand(-1, -1, x.shape[2])
        pooled = self.text_projection(self.final_layer_norm(x).gather(1, last)[:, 0])
        return pooled / pooled.norm(dim=-1, keepdim=True).clamp(min=1e-9)


def load_encoder(directory: Path) -> SentenceEncoder:
    """Load MiniLM from a folder with strict matching of tensors; FileError if one is missing."""
    encoder = SentenceEncoder(BertConfig.read(directory / "config.json"))
    # without the next-sentence head, which is not part of the sentence embedding
    return _loaded(encoder, directory, _BERT_NAMES, r"(?!pooler\.)")


def load_tower(directory: Path) -> ClipTextTower:
    """Load the text tower from a CLIP folder with strict matching of tensors; FileError if one is missing."""
    tower = ClipTextTower(ClipTextConfig.read(directory / "config.json"))
    return _loaded(tower, directory, _CLIP_NAMES, r"text_model\.|text_projection\.")


def _loaded(network: Network, directory: Path, names: tuple[tuple[str, str], ...], own: str) -> Network:
    """Load into the network the weights whose names match `own`, except position buffers."""
    state = {}
    for name, tensor in _weights(directory).items():
        if re.match(own, name) and not name.endswith("position_ids"):
            for old, new in names:
                name = re.sub(old, new, name)
            state[name] = tensor.float()
    try:
        network.load_state_dict(state)
    except RuntimeError as error:
        raise FileError(f"{directory}: weights of another network ({error}).", _REMEDY) from error
    return network.eval()


def _weights(directory: Path) -> dict[str, Tensor]:
    path = directory / "model.safetensors"
    if path.exists():
        return {name: torch.from_numpy(array) for name, array in read_safetensors(path).items()}
    path = directory / "pytorch_model.bin"
    try:
        return dict(torch.load(path, map_location="cpu", weights_only=True))
    except Exception as error:  # torch raises a dozen types for a missing or damaged file
        raise FileError(f"{path}: not readable weights, and no model.safetensors.", _REMEDY) from error


def read_safetensors(path: Path) -> dict[str, np.ndarray]:
    """Read the arrays of a safetensors file (float16, float32 and int64 only); FileError if it is damaged."""
    dtypes: dict[str, np.dtype[Any]] = {
        "F16": np.dtype("<f2"),
        "F32": np.dtype("<f4"),
        "I64": np.dtype("<i8"),
    }
    try:
        raw = path.read_bytes()
        (size,) = struct.unpack("<Q", raw[:8])
        header = json.loads(raw[8 : 8 + size])
        body = memoryview(raw)[8 + size :]
        return {
            name: np.frombuffer(body[slice(*entry["data_offsets"])], dtypes[entry["dtype"]])
            .reshape(entry["shape"])
            .copy()
            for name, entry in header.items()
            if name != "__metadata__"
        }
    except (OSError, struct.error, ValueError, KeyError) as error:
        raise FileError(f"{path}: not a readable safetensors file ({error}).", _REMEDY) from error
