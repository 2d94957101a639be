"""Six descriptions to the content code Z^t: text embeddings through the body-part text network (Sec. III-C)."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from runtime.errors import ModelError
from runtime.motion.model_files import run_graph
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.phrasing import ModelPhrasing
from runtime.prompts.sentence_inputs import input_sizes, sentence_inputs
from runtime.prompts.text_encoder import TextEncoderLike, open_session
from runtime.skeleton import PART_NAMES

if TYPE_CHECKING:
    import onnxruntime

PARTS = len(PART_NAMES)


class PromptEncoder:
    """Text encoder and body-part network in one: descriptions in, Z^t out.

    `onnx_path` is a network with input `embeddings` (N, 6, D) and output `z` (N, 6, 64), loaded at the first
    `encode`; its D must be that of `text_encoder`, with or without direction words and side. `phrasing` has the
    sentences that the model reads in place of others.
    """

    def __init__(
        self, text_encoder: TextEncoderLike, onnx_path: Path, phrasing: ModelPhrasing | None = None
    ) -> None:
        self._text_encoder = text_encoder
        self._path = onnx_path
        self._phrasing = ModelPhrasing() if phrasing is None else phrasing

    def encode(self, descriptions: PartDescriptions) -> NDArray[np.float32]:
        """Z^t `(6, 64)` of six descriptions; ModelError when the network is damaged or gives no finite numbers."""
        texts = self._phrasing.followed(descriptions).as_tuple()
        session = self._session
        embeddings = sentence_inputs(self._text_encoder, texts, session.get_inputs()[0].shape[2])
        (given,) = run_graph(session, self._path, ["z"], {"embeddings": embeddings[None]})
        z = np.asarray(given, np.float32)
        if z.ndim != 3 or z.shape[:2] != (1, PARTS) or not np.isfinite(z).all():
            raise ModelError(
                f"{self._path}: gave z of shape {z.shape}, expected {(1, PARTS)} times finite numbers.",
                "Choose another model, or export this one again.",
            )
        return z[0]

    @cached_property
    def _session(self) -> onnxruntime.InferenceSession:
        session = open_session(self._path)
        shapes = {i.name: list(i.shape) for i in session.get_inputs()}
        size = self._text_encoder.dimensions
        expected = [[PARTS, length] for length in input_sizes(size)]
        known = list(shapes) == ["embeddings"] and shapes["embeddings"][1:] in expected
        if not known or "z" not in {o.name for o in session.get_outputs()}:
            raise ModelError(
                f"{self._path}: inputs {shapes}, expected embeddings (N, {PARTS}, {size}) "
                f"of {self._text_encoder.name} and an output z.",
                "Choose a model that was trained with this text encoder.",
            )
        return session
