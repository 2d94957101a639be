"""Style recognition: a classifier of motion windows."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array

# Styles with nearly the same name in two data sets (or of two performers), equal in the merged score.
MERGED: dict[str, str] = {
    "active2": "active",
    "angry_bn": "angry",
    "feminine2": "feminine",
    "masculine2": "masculine",
    "neutral_bn": "neutral",
    "neutral_bn2": "neutral",
    "neutral_cmu": "neutral",
    "elderly": "old",
    "exhausted": "tired",
}
MIN_TRAINING_WINDOWS, MIN_HELD_OUT_WINDOWS = 40, 3


def merged(label: str) -> str:
    """Return the common label of similar styles."""
    return MERGED.get(label, label)


class StyleClassifier:
    """Linear discriminant analysis with shrunk covariance on standardised kinematic and temporal features."""

    def __init__(self, features: Array, labels: Sequence[str], seed: int = 0) -> None:
        from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        chosen = balanced(labels, 1000, seed)
        styles = np.asarray(labels)[chosen]
        count = len(np.unique(styles))
        even = np.full(count, 1.0 / count)
        classifier = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto", priors=even)
        self._pipeline: Any = make_pipeline(StandardScaler(), classifier)
        self._pipeline.fit(features[chosen], styles)

    @property
    def labels(self) -> list[str]:
        """Styles that it can recognise."""
        return [str(v) for v in self._pipeline.classes_]

    def predict(self, features: Array) -> list[str]:
        """Return the most probable style of every row."""
        return [str(v) for v in self._pipeline.predict(features)] if len(features) else []


def balanced(labels: Sequence[str], most: int, seed: int) -> NDArray[np.int64]:
    """Draw rows at random, at most `most` of every label."""
    rng = np.random.default_rng(seed)
    array = np.asarray(labels)
    return np.concatenate([rng.permutation(np.flatnonzero(array == v))[:most] for v in np.unique(array)])


def recognition(answers: Mapping[str, Sequence[str]]) -> dict[str, dict[str, Any]]:
    """Score the classifier's answers for the windows of every style, by style.

    Returns the number of `windows`, the fraction recognised as their own style (`score`) or a similar one
    (`merged_score`), and the most frequent answer (`taken_for`).
    """
    given = {style: own for style, own in answers.items() if own}
    return {
        "windows": {style: len(own) for style, own in given.items()},
        "score": {style: own.count(style) / len(own) for style, own in given.items()},
        "merged_score": {
            style: float(np.mean([merged(g) == merged(style) for g in own])) for style, own in given.items()
        },
        "taken_for": {style: max(sorted(set(own)), key=own.count) for style, own in given.items()},
    }
