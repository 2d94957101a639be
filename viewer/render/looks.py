"""Character colours: its own, with more contrast, or by body part."""

from dataclasses import replace

import numpy as np

from runtime.arrays import Array
from runtime.character.character import Character
from runtime.skeleton import PART_JOINTS, PART_NAMES

# linear; warm on the left, cold on the right
PART_COLORS = np.array(
    [
        (0.72, 0.22, 0.06),
        (0.06, 0.30, 0.62),
        (0.62, 0.38, 0.04),
        (0.05, 0.42, 0.40),
        (0.50, 0.50, 0.48),
        (0.34, 0.16, 0.48),
    ]
)
PART_WEIGHT = 0.85  # of a part's colour; the rest is the brightness of the mesh's own
LIGHT, DARK = np.array([0.70, 0.70, 0.68]), np.array([0.012, 0.014, 0.018])


def dressed(character: Character, look: str) -> Character:
    """Return the character coloured in a look, one of `viewer.settings.LOOKS`."""
    return character if look == "own" else replace(character, colors=_colors(character, look))


def _colors(character: Character, look: str) -> Array:
    brightness = character.colors.mean(-1, keepdims=True)
    if look == "parts":
        shade = 0.5 + 0.5 * brightness / max(float(brightness.max()), 1e-6)
        tinted = PART_COLORS[part_of_vertices(character)] * shade
        return np.asarray(PART_WEIGHT * tinted + (1.0 - PART_WEIGHT) * character.colors, np.float32)
    middle = float(np.median(brightness))
    light = np.clip(0.5 + 4.0 * (brightness - 0.6 * middle), 0.0, 1.0)
    return np.asarray(DARK + light * (LIGHT - DARK), np.float32)


def part_of_vertices(character: Character) -> Array:
    """Return the body part of each vertex `(V,)` as an index of `PART_NAMES`, from its strongest joint or that joint's ancestors."""
    of_ours = np.full(len(character.joint_names), PART_NAMES.index("torso"))
    parts = {joint: k for k, name in enumerate(PART_NAMES) for joint in PART_JOINTS[name]}
    for k, (ours, parent) in enumerate(zip(character.sport_joints, character.joint_parents, strict=True)):
        of_ours[k] = parts[int(ours)] if ours >= 0 else of_ours[parent] if parent >= 0 else of_ours[k]
    strongest = np.argmax(character.joint_weights, axis=1)[:, None]
    return np.asarray(of_ours[np.take_along_axis(character.joint_indices, strongest, 1)[:, 0]])


def packed_tint(part: int) -> tuple[float, float, float, float]:
    """Return the panel colour of a body part, sRGB with full opacity."""
    r, g, b = (float(value) for value in np.clip(1.6 * PART_COLORS[part], 0.0, 1.0) ** (1 / 2.2))
    return r, g, b, 1.0
