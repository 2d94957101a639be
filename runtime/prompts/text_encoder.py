"""Sentences to unit vectors: all-MiniLM-L6-v2 as int8 ONNX, behind a protocol so that CLIP can take its place."""

from __future__ import annotations

import json
import threading
from collections import OrderedDict
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.assets import asset_path
from runtime.errors import ModelError

if TYPE_CHECKING:
    import onnxruntime
    from tokenizers import Tokenizer

CACHE_TEXTS = 2048  # 3 MB of vectors


class _Metadata(NamedTuple):
    name: str
    dimensions: int
    max_tokens: int


class TextEncoderLike(Protocol):
    """What the prompt modules need of a text encoder."""

    @property
    def name(self) -> str:
        """Name of the network; stored embeddings of another name do not fit."""
        ...

    @property
    def dimensions(self) -> int:
        """Length D of the vectors."""
        ...

    def encode(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """Unit vectors `(N, D)` of N texts."""
        ...


class TextEncoder:
    """all-MiniLM-L6-v2; network and tokenizer are loaded at the first `encode`.

    `directory` holds minilm_int8.onnx, tokenizer.json and text_encoder.json; the shipped ones by default.
    Any thread may call it; texts are encoded one after another.
    """

    def __init__(self, directory: Path | None = None) -> None:
        self._directory = directory
        self._cache: OrderedDict[str, NDArray[np.float32]] = OrderedDict()
        self._lock = threading.Lock()

    def encode(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """Unit vectors `(N, 384)` of N texts, each cut after 128 tokens; ModelError when a file is damaged."""
        if not texts:
            return np.zeros((0, self.dimensions), np.float32)
        # One text a run: the dynamic quantisation scales its activations over the whole batch, so in a batch a
        # text's vector would depend on its neighbours, and the same prompt would not give the same motion.
        with self._lock:
            found = {t: self._cache[t] if t in self._cache else self._run(t) for t in texts}
            for text, vector in found.items():
                self._cache[text] = vector
                self._cache.move_to_end(text)
            while len(self._cache) > CACHE_TEXTS:
                self._cache.popitem(last=False)
        return np.stack([found[t] for t in texts])

    @property
    def name(self) -> str:
        """Name of the network, from its metadata."""
        return self._metadata.name

    @property
    def dimensions(self) -> int:
        """Length of the vectors, 384."""
        return self._metadata.dimensions

    def _run(self, text: str) -> NDArray[np.float32]:
        ids = np.array([self._tokenizer.encode(text).ids], np.int64)
        inputs = {"input_ids": ids, "attention_mask": np.ones_like(ids)}
        vector = np.asarray(self._session.run(["embeddings"], inputs)[0], np.float32)
        if vector.shape != (1, self.dimensions) or not np.isfinite(vector).all():
            raise ModelError(
                f"{self._path('minilm_int8.onnx')}: gave an embedding of shape {vector.shape}, "
                f"expected {(1, self.dimensions)} finite numbers.",
                "Install the program again.",
            )
        return vector[0]

    @cached_property
    def _metadata(self) -> _Metadata:
        path = self._path("text_encoder.json")
        try:
            values = json.loads(path.read_text("utf-8"))
            return _Metadata(str(values["name"]), int(values["dimensions"]), int(values["max_tokens"]))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise _damaged(path, "the text encoder's metadata", error) from error

    @cached_property
    def _tokenizer(self) -> Tokenizer:
        from tokenizers import Tokenizer

        path = self._path("tokenizer.json")
        try:
            tokenizer = Tokenizer.from_str(path.read_text("utf-8"))
        except Exception as error:  # tokenizers raises bare Exception for every malformed file
            raise _damaged(path, "a tokenizer", error) from error
        tokenizer.enable_truncation(self._metadata.max_tokens)
        tokenizer.no_padding()
        return tokenizer

    @cached_property
    def _session(self) -> onnxruntime.InferenceSession:
        path = self._path("minilm_int8.onnx")
        session = open_session(path)
        inputs = {i.name for i in session.get_inputs()}
        if inputs != {"input_ids", "attention_mask"} or session.get_outputs()[0].name != "embeddings":
            raise ModelError(
                f"{path}: inputs {sorted(inputs)}, expected input_ids and attention_mask.",
                "Install the program again.",
            )
        return session

    def _path(self, name: str) -> Path:
        return asset_path(f"text/{name}") if self._directory is None else self._directory / name


def open_session(path: Path) -> onnxruntime.InferenceSession:
    """A CPU session of one thread that does not spin while idle; ModelError when the file is no network."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(path.read_bytes(), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions share no base class but Exception
        raise _damaged(path, "an ONNX network", error) from error


def _damaged(path: Path, expected: str, error: Exception) -> ModelError:
    reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
    return ModelError(f"{path}: cannot be read as {expected} ({reason}).", "Install the program again.")
