"""Text→motion and motion→text retrieval on held-out capture, by the similarity that stage 1 trains (Eq. 2)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.errors import FileError, ModelError
from runtime.motion.model import ExportedMotionEncoder
from runtime.motion.model_files import open_graph, read_graph, read_metadata
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.sentence_inputs import sentence_inputs
from runtime.prompts.text_encoder import TextEncoderLike
from training.evaluation.metrics.classifiers import merged
from training.evaluation.metrics.features import encoded
from training.evaluation.metrics.motion import load_motion, window_starts
from training.evaluation.motion.capture import ROLLOUTS

HOP = 20  # frames between the beginnings of a clip's windows
BAR = 0.6  # R@1


@dataclass(frozen=True)
class Codes:
    """Unit vectors mu + Sigma (Eq. 2) of N things: `whole` `(N, 768)`, and of each body part `parts` `(N, 6, 128)`.

    Of a clip, or of a style's paraphrases, they are means of unit vectors, so that products are mean cosines.
    """

    whole: Array
    parts: Array

    @staticmethod
    def of(mean: Array, log_variance: Array) -> Codes:
        """From distribution parameters `(N, 6, 64)`."""
        both = np.concatenate([mean, np.exp(0.5 * log_variance)], axis=-1).astype(np.float64)
        return Codes(_unit(both.reshape(len(both), -1)), _unit(both))

    def mean(self) -> Codes:
        """One entry, the mean of all."""
        return Codes(self.whole.mean(0, keepdims=True), self.parts.mean(0, keepdims=True))

    @staticmethod
    def stack(items: Sequence[Codes]) -> Codes:
        """All entries of several."""
        return Codes(np.concatenate([c.whole for c in items]), np.concatenate([c.parts for c in items]))

    def similarity(self, other: Codes, by_part: bool = False) -> Array:
        """Cosines `(N, M)` of whole bodies as in Eq. 2, or the mean of the six parts' cosines."""
        if by_part:
            return np.einsum("npd,mpd->nm", self.parts, other.parts) / self.parts.shape[1]
        return self.whole @ other.whole.T


class TextSide:
    """The text side of the content encoder of a model folder: six descriptions to the parameters of Eq. 2."""

    def __init__(self, folder: Path, text_encoder: TextEncoderLike) -> None:
        self._text_encoder = text_encoder
        self._session = open_graph(
            folder / "prompt.onnx", read_graph(folder, "prompt", read_metadata(folder)), 1
        )
        if "log_variance" not in {o.name for o in self._session.get_outputs()}:
            raise ModelError(
                f"{folder / 'prompt.onnx'}: gives no mean and log_variance, which retrieval compares.",
                "Export the model again with `sport train export`.",
            )

    def codes(self, descriptions: Sequence[PartDescriptions]) -> Codes:
        """Codes of N descriptions."""
        size = self._session.get_inputs()[0].shape[2]
        words = np.stack([sentence_inputs(self._text_encoder, d.as_tuple(), size) for d in descriptions])
        mean, log_variance = self._session.run(["mean", "log_variance"], {"embeddings": words})
        return Codes.of(mean, log_variance)


@dataclass(frozen=True)
class Clips:
    """Held-out clips as one entry each: names, styles, and the mean code of their windows."""

    names: list[str]
    styles: list[str]
    codes: Codes


def held_out_clips(folder: Path, mirrored: bool) -> list[Path]:
    """Held-out captured clips of `folder`: no copies on made terrain, layered clips or rollouts; FileError if none."""
    found = []
    for path in sorted(folder.glob("*.npz")):
        stem = path.stem.removesuffix("_m")
        if stem.startswith("layer_") or stem.endswith("_t") or (stem != path.stem) != mirrored:
            continue
        with np.load(path, allow_pickle=False) as clip:
            if str(clip["split"]) == "held_out" and str(clip["source"]) != ROLLOUTS:
                found.append(path)
    if not found:
        raise FileError(f"{folder}: no held-out clips.", "Run `sport train import --data DIR --out DIR`.")
    return found


def encode_clips(encoder: ExportedMotionEncoder, paths: Sequence[Path], described: Collection[str]) -> Clips:
    """Codes of clips; those shorter than a window (1.3 s) and those of styles without descriptions are left out."""
    names, styles, codes = [], [], []
    for path in paths:
        motion = load_motion(path)
        starts = window_starts(len(motion), HOP)
        if len(starts) and motion.style in described:
            names.append(path.stem)
            styles.append(motion.style)
            codes.append(Codes.of(*encoded(encoder, motion.root_features(), starts)).mean())
    return Clips(names, styles, Codes.stack(codes))


@dataclass(frozen=True)
class Recall:
    """Fractions of queries whose first relevant entry is first, or among three; each with what chance would give."""

    queries: int
    gallery: int
    r1: float
    r3: float
    median_rank: float
    chance_r1: float
    chance_r3: float
    chance_rank: float
    r1_by_style: float  # mean over the queries' styles, which have unlike numbers of queries


def recall(similarity: Array, relevant: NDArray[np.bool_], styles: Sequence[str]) -> Recall:
    """Of similarities `(Q, G)` and which entries are relevant; `styles` are the queries'. Ties count against."""
    rank = first_ranks(similarity, relevant)
    size, count = relevant.shape[1], relevant.sum(1)
    own = np.array(styles)
    by_style = [float((rank[own == s] == 1).mean()) for s in sorted(set(styles))]
    return Recall(
        queries=len(rank),
        gallery=size,
        r1=float((rank == 1).mean()),
        r3=float((rank <= 3).mean()),
        median_rank=float(np.median(rank)),
        chance_r1=float(np.mean([_chance(size, int(n), 1) for n in count])),
        chance_r3=float(np.mean([_chance(size, int(n), 3) for n in count])),
        chance_rank=float(np.median([_chance_rank(size, int(n)) for n in count])),
        r1_by_style=float(np.mean(by_style)),
    )


def first_ranks(similarity: Array, relevant: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Rank `(Q,)` from 1 of each query's nearest relevant entry."""
    best = np.where(relevant, similarity, -np.inf).max(1, keepdims=True)
    return 1 + ((similarity >= best) & ~relevant).sum(1)


def _chance(size: int, relevant: int, k: int) -> float:
    """Chance that a random order has a relevant entry among the first k."""
    k = min(k, size)
    return 1.0 - comb(size - relevant, k) / comb(size, k)


def _chance_rank(size: int, relevant: int) -> int:
    """Median rank of the first relevant entry in a random order."""
    return next(k for k in range(1, size + 1) if _chance(size, relevant, k) >= 0.5)


def evaluate_retrieval(
    folder: Path, clips: Path, texts: dict[str, list[PartDescriptions]], text_encoder: TextEncoderLike
) -> dict[str, Any]:
    """All figures of a model folder on the held-out clips; `texts` are every style's paraphrases."""
    encoder, side = ExportedMotionEncoder(folder), TextSide(folder, text_encoder)
    result: dict[str, Any] = {}
    for mirrored in (False, True):
        queried = {s: [d.mirrored() for d in ds] if mirrored else ds for s, ds in texts.items()}
        codes = {style: side.codes(descriptions) for style, descriptions in queried.items()}
        found = encode_clips(encoder, held_out_clips(clips, mirrored), texts)
        result["mirrored" if mirrored else "original"] = _score(found, codes)
    return result


def _score(clips: Clips, texts: dict[str, Codes]) -> dict[str, Any]:
    gallery = np.array(clips.styles)
    queried = [s for s in texts for _ in range(len(texts[s].whole)) if s in set(clips.styles)]
    queries = Codes.stack([texts[s] for s in dict.fromkeys(queried)])
    names = list(texts)
    style_codes = Codes.stack([texts[s].mean() for s in names])
    scores: dict[str, Any] = {"clips": dict(Counter(clips.styles)), "styles": len(names)}
    for key, by_part in (("whole", False), ("parts", True)):
        to_motion = queries.similarity(clips.codes, by_part)
        to_text = clips.codes.similarity(style_codes, by_part)
        scores[key] = {
            "text_to_motion": asdict(recall(to_motion, np.array(queried)[:, None] == gallery, queried)),
            "motion_to_text": asdict(recall(to_text, gallery[:, None] == np.array(names), clips.styles)),
            "text_to_motion_alike": asdict(recall(to_motion, _alike(queried, clips.styles), queried)),
            "motion_to_text_alike": asdict(recall(to_text, _alike(clips.styles, names), clips.styles)),
        }
    return scores


def _alike(queries: Sequence[str], gallery: Sequence[str]) -> NDArray[np.bool_]:
    """Relevance where styles of nearly the same name in two data sets count as one."""
    return np.array([merged(s) for s in queries])[:, None] == np.array([merged(s) for s in gallery])


def _unit(x: Array) -> Array:
    return x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-12)
