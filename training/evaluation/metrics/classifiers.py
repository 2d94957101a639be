"""Which style a window of motion shows, by a classifier."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array

# Styles that two data sets (or two performers of one) give nearly the same name; counted alike in the merged score.
MERGED: dict[str, str] = {
    "active2": "active",
    "angry_bn": "angry",
    "feminine2": "feminine",
    "masculine2": "masculine",
    "neutral_bn": "neutral",
    "neutral_bn2": "neutral",
    "elderly": "old",
    "exhausted": "tired",
}
MIN_TRAINING_WINDOWS, MIN_HELD_OUT_WINDOWS = 40, 3


def merged(label: str) -> str:
    """The label under which look-alike styles count as one."""
    return MERGED.get(label, label)


class StyleClassifier:
    """Linear discriminant analysis with shrunk covariance on standardised kinematic and temporal features."""

    def __init__(self, features: Array, labels: Sequence[str], seed: int = 0) -> None:
        from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        chosen = balanced(labels, 1000, seed)
        classifier = LinearDiscriminantAnalysis(
            solver="lsqr", shrinkage="auto", priors=_even(np.asarray(labels)[chosen])
        )
        self._pipeline: Any = make_pipeline(StandardScaler(), classifier)
        self._pipeline.fit(features[chosen], np.asarray(labels)[chosen])

    @property
    def labels(self) -> list[str]:
        """Styles that it can tell."""
        return [str(v) for v in self._pipeline.classes_]

    def predict(self, features: Array) -> list[str]:
        """The most probable style of every row."""
        return [str(v) for v in self._pipeline.predict(features)] if len(features) else []


def balanced(labels: Sequence[str], most: int, seed: int) -> NDArray[np.int64]:
    """Rows with at most `most` of every label, drawn at random."""
    rng = np.random.default_rng(seed)
    array = np.asarray(labels)
    return np.concatenate([rng.permutation(np.flatnonzero(array == v))[:most] for v in np.unique(array)])


def _even(labels: NDArray[np.str_]) -> Array:
    count = len(np.unique(labels))
    return np.full(count, 1.0 / count)


@dataclass(frozen=True)
class Recognition:
    """Fractions of windows that are taken for their own style, by style."""

    windows: dict[str, int]
    score: dict[str, float]
    merged_score: dict[str, float]
    taken_for: dict[str, str]  # the most frequent answer of each style


def recognition(answers: Mapping[str, Sequence[str]]) -> Recognition:
    """Score the classifier's answers for the windows of every style."""
    windows, score, merged_score, taken_for = {}, {}, {}, {}
    for style, given in answers.items():
        if not given:
            continue
        windows[style] = len(given)
        score[style] = float(np.mean([g == style for g in given]))
        merged_score[style] = float(np.mean([merged(g) == merged(style) for g in given]))
        names, counts = np.unique(np.asarray(given), return_counts=True)
        taken_for[style] = str(names[np.argmax(counts)])
    return Recognition(windows, score, merged_score, taken_for)
