"""Text→motion and motion→text retrieval on held-out capture, by the similarity trained in stage 1 (Eq. 2)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.errors import FileError, ModelError
from runtime.motion.model import ExportedMotionEncoder
from runtime.motion.model_files import open_graph, read_graph, read_metadata
from runtime.prompts.content import sentence_inputs
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.text_encoder import TextEncoderLike
from training.evaluation.metrics.classifiers import merged
from training.evaluation.metrics.features import encoded
from training.evaluation.metrics.motion import load_motion, window_starts
from training.evaluation.motion.capture import TERRAIN_GROUP, ClipInfo, read_capture

HOP = 20  # frames between the starts of a clip's windows
MIN_RECALL_FRACTION = 0.6  # R@1


def codes_of(mean: Array, log_variance: Array) -> Array:
    """Return unit vectors mu + Sigma `(N, 768)` (Eq. 2) of distribution parameters `(N, 6, 64)`, for cosine similarity."""
    both = np.concatenate([mean, np.exp(0.5 * log_variance)], axis=-1).reshape(len(mean), -1)
    both = both.astype(np.float64)
    return both / np.maximum(np.linalg.norm(both, axis=-1, keepdims=True), 1e-12)


class TextSide:
    """Text side of a model's content encoder: maps six descriptions to the parameters of Eq. 2."""

    def __init__(self, folder: Path, text_encoder: TextEncoderLike) -> None:
        self._text_encoder = text_encoder
        graph = read_graph(folder, "prompt", read_metadata(folder))
        self._session = open_graph(folder / "prompt.onnx", graph, 1)
        if "log_variance" not in {o.name for o in self._session.get_outputs()}:
            raise ModelError(
                f"{folder / 'prompt.onnx'}: lacks the outputs mean and log_variance, which retrieval needs.",
                "Export the model again with `sport train export`.",
            )

    def codes(self, descriptions: Sequence[PartDescriptions]) -> Array:
        """Return codes `(N, 768)` of descriptions."""
        size = self._session.get_inputs()[0].shape[2]
        words = np.stack([sentence_inputs(self._text_encoder, d.as_tuple(), size) for d in descriptions])
        mean, log_variance = self._session.run(["mean", "log_variance"], {"embeddings": words})
        return codes_of(mean, log_variance)


def recall(similarity: Array, relevant: NDArray[np.bool_], styles: Sequence[str]) -> dict[str, float]:
    """Score similarities `(Q, G)`; `relevant` `(Q, G)` are the correct entries, `styles` the queries'. Ties count against.

    Returns the fractions of queries with a relevant entry at rank 1, or up to 3, each with its chance level; `r1_by_style`
    is the mean over styles, which have different numbers of queries.
    """
    from scipy.stats import hypergeom

    rank = first_ranks(similarity, relevant)
    size, own = relevant.shape[1], np.array(styles)
    # chance that a random order has a relevant entry among the first 1, 2 ... `(Q, G)`
    chance = hypergeom.sf(0, size, relevant.sum(1)[:, None], np.arange(1, size + 1))
    return {
        "queries": len(rank),
        "gallery": size,
        "r1": float((rank == 1).mean()),
        "r3": float((rank <= 3).mean()),
        "median_rank": float(np.median(rank)),
        "chance_r1": float(chance[:, 0].mean()),
        "chance_r3": float(chance[:, min(3, size) - 1].mean()),
        "chance_rank": float(np.median((chance >= 0.5).argmax(1) + 1)),
        "r1_by_style": float(np.mean([(rank[own == s] == 1).mean() for s in np.unique(own)])),
    }


def first_ranks(similarity: Array, relevant: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Return the rank `(Q,)`, from 1, of each query's nearest relevant entry."""
    best = np.where(relevant, similarity, -np.inf).max(1, keepdims=True)
    return 1 + ((similarity >= best) & ~relevant).sum(1)


def held_out_clips(folder: Path, styles: Sequence[str]) -> list[ClipInfo]:
    """Return held-out captured clips of `styles` with at least one window (1.3 s); FileError if there are none."""
    clips = read_capture(folder).clips
    found = [c for c in clips if c.held_out and c.group != TERRAIN_GROUP and c.style in styles]
    if not found:
        raise FileError(f"{folder}: no held-out clips.", "Run `sport train import --data DIR --out DIR`.")
    return found


def evaluate_retrieval(
    folder: Path, clips: Path, texts: dict[str, list[PartDescriptions]], text_encoder: TextEncoderLike
) -> dict[str, Any]:
    """Evaluate a model folder on the held-out clips; `texts` are paraphrases by style."""
    encoder, side = ExportedMotionEncoder(folder), TextSide(folder, text_encoder)
    found = held_out_clips(clips, list(texts))
    return scores(
        [c.style for c in found],
        [_clip_code(encoder, c.path) for c in found],
        {s: side.codes(d) for s, d in texts.items()},
    )


def _clip_code(encoder: ExportedMotionEncoder, path: Path) -> Array:
    """Return the mean code `(768,)` of a clip's windows."""
    motion = load_motion(path)
    return codes_of(*encoded(encoder, motion.root_features(), window_starts(len(motion), HOP))).mean(0)


def scores(
    clip_styles: Sequence[str], clip_codes: Sequence[Array], texts: dict[str, Array]
) -> dict[str, Any]:
    """Score both directions, with separate and with merged similar styles; texts without a clip are not queries."""
    names, motions = list(texts), np.stack(clip_codes)
    queried = [style for style in names if style in clip_styles for _ in texts[style]]
    to_motion = np.concatenate([texts[s] for s in dict.fromkeys(queried)]) @ motions.T
    to_text = motions @ np.stack([texts[s].mean(0) for s in names]).T
    result: dict[str, Any] = {}
    for suffix, label in (("", str), ("_alike", merged)):
        queries, shown, named = (
            np.array([label(s) for s in styles]) for styles in (queried, clip_styles, names)
        )
        result[f"text_to_motion{suffix}"] = recall(to_motion, queries[:, None] == shown, queried)
        result[f"motion_to_text{suffix}"] = recall(to_text, shown[:, None] == named, clip_styles)
    return result
