"""Words of direction, amount and place in a sentence, as numbers beside its embedding.

A sentence embedding puts "left arm" and "right arm", "raised" and "lowered" a few hundredths apart, since they occur in
the same sentences. For a body they are opposites, so they are also given plainly.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

# One number each. A model knows these groups in this order: change them only together with the trained models.
GROUPS: tuple[tuple[str, frozenset[str]], ...] = tuple(
    (name, frozenset(words.split()))
    for name, words in (
        ("left", "left leftward leftwards"),
        ("right", "right rightward rightwards"),
        ("forward", "forward forwards ahead front"),
        ("back", "back backward backwards behind rear"),
        ("up", "up upward upwards raised lifted lifting rising high higher overhead above top sky"),
        (
            "down",
            "down downward downwards lowered low lower drooping bowed falling dropped sunken ground floor",
        ),
        ("out", "out outward outwards away apart wide widely broad broadly spread sideways"),
        ("in", "inward inwards close together narrow near tight crossed across folded tucked"),
        ("much", "far deep deeply strongly sharply very fully heavily hard big long large clearly giant"),
        ("little", "slight slightly little gently lightly softly small short moderately hardly barely"),
        ("bent", "bent bend bending crouched crouching hunched curled rounded slumped"),
        ("straight", "straight stretched upright extended level straightened reaching"),
        ("fast", "fast quick quickly brisk briskly abruptly lively energetically energetic pumping"),
        ("slow", "slow slowly weary wearily careful carefully cautious cautiously trudging tired"),
        ("still", "still stiff stiffly held rigid motionless frozen steady fixed"),
        ("moving", "swinging swaying waving bouncing bobbing flapping nodding rocking shaking swing sway"),
        ("turned", "turned turning turn rotated twisted twisting facing looking pointing"),
        ("tilted", "tilted tilting leaning lean leant tipped"),
        ("not", "not no without never"),
        ("head", "head ear ears face crown forehead brow eyes mouth"),
        ("chest", "chest heart shoulder shoulders chin breast"),
        ("hips", "hip hips waist pocket pockets belly stomach"),
        ("knee", "knee knees thigh thighs"),
        ("foot", "foot feet toe toes heel heels ankle step steps stepping"),
    )
)
PRESENT = 0.1  # twice the usual size of an embedding's components


def direction_words(texts: Sequence[str]) -> NDArray[np.float32]:
    """`(N, len(GROUPS))`: `PRESENT` where a text has a word of the group, else 0."""
    found = np.zeros((len(texts), len(GROUPS)), np.float32)
    for row, text in zip(found, texts, strict=True):
        words = frozenset(re.findall(r"[a-z]+", text.lower()))
        row[:] = [PRESENT if words & group else 0.0 for _, group in GROUPS]
    return found


def with_direction_words(texts: Sequence[str], vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Embeddings `(N, D)` of `texts` with their direction words behind: `(N, D + len(GROUPS))`."""
    return np.concatenate([vectors, direction_words(texts)], axis=1)
