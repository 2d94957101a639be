"""Can a classifier tell one set of windows from another? Boosted trees, tested on takes that they have not seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

FOLDS = 5
ROUNDS = 150  # of boosting
DRAWS = 4  # of the halves that captured takes are divided into


def area_under_curve(
    features: Array, labels: NDArray[np.integer], takes: NDArray[np.integer], seed: int = 0
) -> float:
    """AUC of gradient-boosted trees that tell windows with label 1 from those with 0, over folds that hold whole takes.

    `features` `(N, n)`, `labels` and `takes` `(N,)`. 0.5 is chance; all held-out scores are ranked together.
    """
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.metrics import roc_auc_score
    from sklearn.model_selection import StratifiedGroupKFold

    folds = StratifiedGroupKFold(min(FOLDS, len(np.unique(takes))), shuffle=True, random_state=seed)
    scores = np.zeros(len(labels))
    for train, test in folds.split(features, labels, takes):
        trees = HistGradientBoostingClassifier(max_iter=ROUNDS, early_stopping=False, random_state=seed)
        scores[test] = trees.fit(features[train], labels[train]).decision_function(features[test])
    return float(roc_auc_score(labels, scores))


def halves_told_apart(features: Array, takes: NDArray[np.integer], seed: int = 0) -> float:
    """The same of one half of the takes against the other, mean over random halves: what cannot be told."""
    rng = np.random.default_rng(seed)
    names = np.unique(takes)
    found = []
    for _ in range(DRAWS):
        half = rng.permutation(names)[: len(names) // 2]
        found.append(area_under_curve(features, np.isin(takes, half).astype(int), takes, seed))
    return float(np.mean(found))
