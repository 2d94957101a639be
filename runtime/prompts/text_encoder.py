"""Text encoder: sentences to unit vectors, by all-MiniLM-L6-v2 as int8 ONNX or another network such as CLIP's text tower."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.assets import asset_path
from runtime.errors import FileError, ModelError
from runtime.motion.model_files import check_names, run_graph
from runtime.safe_read import is_text, open_npz, parse_json, read_bounded, reason

if TYPE_CHECKING:
    import onnxruntime
    from tokenizers import Tokenizer

CACHE_TEXTS = 2048  # 3 MB of vectors
MAX_METADATA_BYTES = 1024 * 1024
MAX_TOKENIZER_BYTES = 64 * 1024 * 1024
MAX_NAME = 200
MAX_DIMENSIONS = 65_536
MAX_TOKENS = 4096
# the encoder of models that name none
SHIPPED = {"name": "all-MiniLM-L6-v2", "dimensions": 384}
STORED = "sentences.npz"  # precomputed vectors, in a text encoder's folder
OWN_FOLDER = "text_encoder"  # in a model folder: the text encoder it was trained with
_SHIPPED_GRAPH = "minilm_int8.onnx"
_REMEDY = "Install the program again."


class _Metadata(NamedTuple):
    name: str
    dimensions: int
    max_tokens: int
    graph: str


class TextEncoderLike(Protocol):
    """Interface of a text encoder, as the prompt modules need it."""

    @property
    def name(self) -> str:
        """Name of the network; stored embeddings are only valid for this name."""
        ...

    @property
    def dimensions(self) -> int:
        """Length D of the embedding vectors."""
        ...

    def encode(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """Return unit vectors `(N, D)` of N texts."""
        ...


class TextEncoder:
    """A text encoder loaded from its folder; network and tokenizer are loaded at the first `encode`.

    `directory` (default: all-MiniLM-L6-v2, shipped) holds text_encoder.json (name, dimensions, max_tokens, graph: the
    network's file name), that network with inputs `input_ids`, `attention_mask` (N, L) and output `embeddings` (N, D),
    tokenizer.json, and optionally sentences.npz with vectors of the program's own sentences, unless `stored=False`.
    Thread-safe; two texts are encoded at a time.
    """

    def __init__(self, directory: Path | None = None, stored: bool = True) -> None:
        self._directory = directory
        self._use_stored = stored
        self._cache: OrderedDict[str, NDArray[np.float32]] = OrderedDict()
        self._lock = threading.Lock()

    def encode(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """Return unit vectors `(N, D)` of N texts, each truncated to `max_tokens` (128); ModelError if a file is damaged."""
        if not texts:
            return np.zeros((0, self.dimensions), np.float32)
        # One text per run: dynamic quantisation scales activations over the whole batch, so in a batch a
        # text's vector would depend on its neighbours, and the same prompt would not give the same motion.
        with self._lock:
            rows, stored = self._stored
            own = list(dict.fromkeys(text for text in texts if text not in rows))
            self._encode_new(own)
            vectors = np.stack([stored[rows[text]] if text in rows else self._cache[text] for text in texts])
            while len(self._cache) > CACHE_TEXTS:
                self._cache.popitem(last=False)
        return vectors

    def _encode_new(self, texts: Sequence[str]) -> None:
        """Run the network for texts that are not cached; marks all of them as most recently used."""
        new = [text for text in texts if text not in self._cache]
        if new:
            _ = self._session, self._tokenizer  # load them once
            with ThreadPoolExecutor(2, "text") as threads:
                self._cache.update(zip(new, threads.map(self._run, new), strict=True))
        for text in texts:
            self._cache.move_to_end(text)

    @property
    def name(self) -> str:
        """Name of the network, from its metadata."""
        return self._metadata.name

    @property
    def dimensions(self) -> int:
        """Length D of the vectors, 384 for the shipped encoder."""
        return self._metadata.dimensions

    def _run(self, text: str) -> NDArray[np.float32]:
        tokens = _tokens(self._tokenizer, text, self._paths[1], self._remedy)
        ids = np.array([tokens[: self._metadata.max_tokens]], np.int64)
        inputs = {"input_ids": ids, "attention_mask": np.ones_like(ids)}
        (given,) = run_graph(self._session, self._paths[0], ["embeddings"], inputs)
        vector = np.asarray(given, np.float32)
        if vector.shape != (1, self.dimensions) or not np.isfinite(vector).all():
            raise ModelError(
                f"{self._paths[0]}: gave an embedding of shape {vector.shape}, "
                f"expected {(1, self.dimensions)} finite numbers.",
                self._remedy,
            )
        length = float(np.linalg.norm(vector))
        return vector[0] if abs(length - 1.0) < 1e-3 else vector[0] / max(length, 1e-9)

    @cached_property
    def _metadata(self) -> _Metadata:
        path = self._path("text_encoder.json")
        try:
            values = parse_json(read_bounded(path, MAX_METADATA_BYTES))
            found = _Metadata(
                str(values["name"]),
                int(values["dimensions"]),
                int(values["max_tokens"]),
                str(values.get("graph", _SHIPPED_GRAPH)),
            )
            plain = found.graph == Path(found.graph).name and found.graph.isprintable()
            if not plain or not 1 <= len(found.graph) <= MAX_NAME:
                raise ValueError("'graph' is not a plain file name")
            if not is_text(found.name) or len(found.name) > MAX_NAME:
                raise ValueError("'name' is not a name")
            if not 1 <= found.dimensions <= MAX_DIMENSIONS or not 2 <= found.max_tokens <= MAX_TOKENS:
                raise ValueError("'dimensions' or 'max_tokens' is out of range")
        except (FileError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            raise _damaged(path, "the text encoder's metadata", error, self._remedy) from error
        return found

    @cached_property
    def _stored(self) -> tuple[dict[str, int], NDArray[np.float32]]:
        """Return rows of sentences, and their vectors `(N, D)`; empty if no file belongs to this network."""
        path = self._path("text_encoder.json").with_name(STORED)
        if not self._use_stored or not path.is_file():
            return {}, np.zeros((0, self.dimensions), np.float32)
        with open_npz(path, self._remedy, ModelError) as data:
            texts = str(data["texts"]).split("\n")
            vectors = data["vectors"].astype(np.float32)
            if str(data["encoder"]) != self.name or vectors.shape != (len(texts), self.dimensions):
                raise ValueError("vectors of another network")
            vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
            if not np.isfinite(vectors).all():
                raise ValueError("vectors that are not numbers")
        return {text: row for row, text in enumerate(texts)}, vectors

    @cached_property
    def _paths(self) -> tuple[Path, Path]:
        """Paths of the network and of the tokenizer."""
        return self._path(self._metadata.graph), self._path("tokenizer.json")

    @cached_property
    def _tokenizer(self) -> Tokenizer:
        from tokenizers import Tokenizer

        path = self._paths[1]
        try:
            tokenizer = Tokenizer.from_str(read_bounded(path, MAX_TOKENIZER_BYTES).decode("utf-8"))
            tokenizer.enable_truncation(self._metadata.max_tokens)
            tokenizer.no_padding()
        except BaseException as error:
            raise _not_of_tokenizers(error, path, self._remedy) from error
        return tokenizer

    @cached_property
    def _session(self) -> onnxruntime.InferenceSession:
        path = self._paths[0]
        session = open_session(path, self._remedy)
        inputs = {i.name for i in session.get_inputs()}
        outputs = {o.name for o in session.get_outputs()}
        if inputs != {"input_ids", "attention_mask"} or "embeddings" not in outputs:
            raise ModelError(
                f"{path}: inputs {sorted(inputs)}, expected input_ids and attention_mask.", self._remedy
            )
        return session

    @property
    def _remedy(self) -> str:
        return (
            _REMEDY if self._directory is None else "Export the text encoder again, or name another folder."
        )

    def _path(self, name: str) -> Path:
        return asset_path(f"text/{name}") if self._directory is None else self._directory / name


def text_encoder_of(
    metadata: Mapping[str, Any], model_folder: Path, directory: Path | None = None
) -> TextEncoder:
    """Return the text encoder that a model was trained with, according to its `metadata`.

    It is read from `directory`, or `text_encoder/` in the model folder, or is the shipped one. Raises ModelError if the
    encoder found is not the model's.
    """
    wanted = metadata.get("text_encoder", SHIPPED)
    if not (isinstance(wanted, dict) and wanted.keys() >= SHIPPED.keys()):
        raise ModelError(
            f"{model_folder / 'metadata.json'}: field 'text_encoder' is not an object with name and dimensions.",
            "Export the model again.",
        )
    own = model_folder / OWN_FOLDER
    found = TextEncoder(directory or (own if own.is_dir() else None))
    if (found.name, found.dimensions) != (wanted["name"], wanted["dimensions"]):
        raise ModelError(
            f"{model_folder}: trained with the text encoder {str(wanted['name'])[:80]!r} of {str(wanted['dimensions'])[:20]} "
            f"numbers, but given {found.name[:80]!r} of {found.dimensions}.",
            f"Name the folder of its text encoder (text_encoder), or copy it to {own}.",
        )
    return found


def library_encoder(text_encoder: TextEncoder) -> TextEncoder:
    """Return the shipped text encoder, reusing `text_encoder` if it is that one.

    Similarities of the prompt library hold for the shipped network, whatever a model was trained with.
    """
    return text_encoder if text_encoder.name == SHIPPED["name"] else TextEncoder()


def open_session(path: Path, remedy: str = "") -> onnxruntime.InferenceSession:
    """Open a CPU session of one thread that does not spin while idle; ModelError if the file is not a network."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        if not path.is_file():  # onnxruntime would block on a pipe without a writer
            raise FileNotFoundError("no such file")
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        check_names(session)
        return session
    except Exception as error:  # onnxruntime's exceptions have no common base but Exception
        raise _damaged(path, "an ONNX network", error, remedy or _REMEDY) from error


def _tokens(tokenizer: Tokenizer, text: str, path: Path, remedy: str) -> list[int]:
    """Return the token ids of a text, at least one; ModelError if a damaged tokenizer fails."""
    try:
        tokens = list(tokenizer.encode(text).ids)
    except BaseException as error:
        raise _not_of_tokenizers(error, path, remedy) from error
    if not tokens:
        raise ModelError(f"{path}: gives no tokens for a text.", remedy)
    return tokens


def _not_of_tokenizers(error: BaseException, path: Path, remedy: str) -> BaseException:
    """Return a ModelError for the bare Exception or Rust panic that tokenizers raises; other errors unchanged."""
    if isinstance(error, Exception) or type(error).__name__ == "PanicException":
        return _damaged(path, "a tokenizer", error, remedy)
    return error


def _damaged(path: Path, expected: str, error: BaseException, remedy: str) -> ModelError:
    said = error.problem if isinstance(error, FileError) else reason(error)
    return ModelError(f"{path}: cannot be read as {expected} ({said[:200]}).", remedy)
