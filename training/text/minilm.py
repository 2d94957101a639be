"""all-MiniLM-L6-v2 in plain torch: the 6-layer BERT, its pooling, and a reader for its safetensors weights."""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from runtime.errors import FileError


@dataclass(frozen=True)
class BertConfig:
    """Sizes of the encoder, by the names of the checkpoint's config.json."""

    vocab_size: int = 30522
    hidden_size: int = 384
    num_hidden_layers: int = 6
    num_attention_heads: int = 12
    intermediate_size: int = 1536
    max_position_embeddings: int = 512
    type_vocab_size: int = 2
    layer_norm_eps: float = 1e-12

    @classmethod
    def read(cls, path: Path) -> BertConfig:
        """The fields of a checkpoint's config.json; FileError when one is missing."""
        try:
            values = json.loads(path.read_text("utf-8"))
            return cls(**{name: values[name] for name in cls.__dataclass_fields__})
        except (OSError, json.JSONDecodeError, KeyError) as error:
            raise FileError(
                f"{path}: not a BERT config.json ({error}).", "Unpack the wheel again."
            ) from error


class BertLayer(nn.Module):
    """Self-attention and feed-forward, each with residual and post layer norm."""

    def __init__(self, config: BertConfig) -> None:
        super().__init__()
        width = config.hidden_size
        self.heads = config.num_attention_heads
        self.query, self.key, self.value = (nn.Linear(width, width) for _ in range(3))
        self.attention_output = nn.Linear(width, width)
        self.attention_norm = nn.LayerNorm(width, config.layer_norm_eps)
        self.intermediate = nn.Linear(width, config.intermediate_size)
        self.output = nn.Linear(config.intermediate_size, width)
        self.output_norm = nn.LayerNorm(width, config.layer_norm_eps)

    def forward(self, x: Tensor, bias: Tensor) -> Tensor:
        """x (N, L, 384), bias (N, 1, 1, L) added to the attention scores → (N, L, 384)."""
        n, length, width = x.shape
        head = width // self.heads

        def split(y: Tensor) -> Tensor:
            return y.reshape(n, length, self.heads, head).transpose(1, 2)

        q, k, v = split(self.query(x)), split(self.key(x)), split(self.value(x))
        weights = torch.softmax(q @ k.transpose(2, 3) / head**0.5 + bias, dim=-1)
        mixed = (weights @ v).transpose(1, 2).reshape(n, length, width)
        x = self.attention_norm(x + self.attention_output(mixed))
        return self.output_norm(x + self.output(functional.gelu(self.intermediate(x))))


class SentenceEncoder(nn.Module):
    """Token ids → unit sentence vectors: BERT, mean over the unmasked tokens, L2 norm."""

    def __init__(self, config: BertConfig) -> None:
        super().__init__()
        width = config.hidden_size
        self.word_embeddings = nn.Embedding(config.vocab_size, width)
        self.position_embeddings = nn.Embedding(config.max_position_embeddings, width)
        self.token_type_embeddings = nn.Embedding(config.type_vocab_size, width)
        self.embedding_norm = nn.LayerNorm(width, config.layer_norm_eps)
        self.layers = nn.ModuleList(BertLayer(config) for _ in range(config.num_hidden_layers))

    def forward(self, input_ids: Tensor, attention_mask: Tensor) -> Tensor:
        """input_ids, attention_mask (N, L) int64 → (N, 384) unit vectors."""
        positions = torch.arange(input_ids.shape[1], device=input_ids.device)
        x = self.word_embeddings(input_ids) + self.position_embeddings(positions)
        x = self.embedding_norm(x + self.token_type_embeddings.weight[0])
        mask = attention_mask.to(x.dtype)
        bias = (1.0 - mask)[:, None, None, :] * -10000.0
        for layer in self.layers:
            x = layer(x, bias)
        mean = (x * mask[..., None]).sum(1) / mask.sum(1, keepdim=True).clamp(min=1.0)
        return mean / mean.norm(dim=-1, keepdim=True).clamp(min=1e-9)


# checkpoint name (a pattern) and ours, applied in this order
_RENAMED = (
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


def load_encoder(directory: Path) -> SentenceEncoder:
    """The encoder with the weights of `directory`/model.safetensors and config.json, every tensor accounted for."""
    encoder = SentenceEncoder(BertConfig.read(directory / "config.json"))
    state = {}
    for name, array in read_safetensors(directory / "model.safetensors").items():
        if name.startswith("pooler.") or name.endswith("position_ids"):
            continue  # the next-sentence head and an index buffer: not part of sentence embedding
        for old, new in _RENAMED:
            name = re.sub(old, new, name)
        state[name] = torch.from_numpy(array)
    encoder.load_state_dict(state)
    return encoder.eval()


def read_safetensors(path: Path) -> dict[str, np.ndarray]:
    """Arrays of a safetensors file (float16, float32 and int64 only); FileError when it is damaged."""
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
        raise FileError(
            f"{path}: not a readable safetensors file ({error}).", "Unpack the wheel again."
        ) from error
