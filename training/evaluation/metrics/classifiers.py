"""Classifiers over windows: which style a window shows, and whether generated windows are told from captured ones."""

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
BAR = 0.8  # of the held-out score


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
    """Shares of windows that are taken for their own style, by style."""

    windows: dict[str, int]
    score: dict[str, float]
    merged_score: dict[str, float]
    taken_for: dict[str, str]  # the most frequent answer of each style

    @property
    def mean(self) -> float:
        """Over styles."""
        return float(np.mean(list(self.score.values()))) if self.score else float("nan")

    @property
    def merged_mean(self) -> float:
        """Over styles, look-alikes counted as one."""
        return float(np.mean(list(self.merged_score.values()))) if self.merged_score else float("nan")


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


FOLDS = 5
ROUNDS = 150  # of boosting
TREES = 200  # of a forest
DRAWS = 4  # of the halves that captured takes are divided into


def area_under_curve(
    features: Array,
    labels: NDArray[np.integer],
    takes: NDArray[np.integer],
    seed: int = 0,
    forest: bool = False,
) -> float:
    """AUC of gradient-boosted trees that tell windows with label 1 from those with 0, over folds that hold whole takes.

    `features` `(N, n)`, `labels` and `takes` `(N,)`. 0.5 is chance; all held-out scores are ranked together. `forest`: a
    random forest, which a few dozen features of one part of the body do not overfit.
    """
    from sklearn.ensemble import HistGradientBoostingClassifier, RandomForestClassifier
    from sklearn.metrics import roc_auc_score
    from sklearn.model_selection import StratifiedGroupKFold

    folds = StratifiedGroupKFold(min(FOLDS, len(np.unique(takes))), shuffle=True, random_state=seed)
    scores = np.zeros(len(labels))
    for train, test in folds.split(features, labels, takes):
        trees = (
            RandomForestClassifier(TREES, min_samples_leaf=3, random_state=seed)
            if forest
            else HistGradientBoostingClassifier(max_iter=ROUNDS, early_stopping=False, random_state=seed)
        )
        scores[test] = trees.fit(features[train], labels[train]).predict_proba(features[test])[:, 1]
    return float(roc_auc_score(labels, scores))


def halves_auc(features: Array, takes: NDArray[np.integer], seed: int = 0, forest: bool = False) -> float:
    """The same of one half of the takes against the other, mean over random halves: what cannot be told."""
    rng = np.random.default_rng(seed)
    names = np.unique(takes)
    found = []
    for _ in range(DRAWS):
        half = rng.permutation(names)[: len(names) // 2]
        found.append(area_under_curve(features, np.isin(takes, half).astype(int), takes, seed, forest))
    return float(np.mean(found))
