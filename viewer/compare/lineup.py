"""Positions, camera distance and names of compared characters."""

import math
from collections.abc import Sequence

import numpy as np

from runtime.arrays import Array
from runtime.pose import Pose
from runtime.session.prompt_blend import PromptBlend, Side
from runtime.session.session import Variant
from viewer.render.camera import Camera

SPACING_M = 1.5  # between neighbours
ROW_M = 2.2  # between two rows
MAX_ROW_CHARACTERS = 5
ABOVE_M = 2.15  # top of a character with its name
FILLED_VIEW_FRACTION = 0.86  # of the view, filled by the characters


def places(count: int, centre: tuple[float, float], heading: float) -> list[tuple[float, float]]:
    """Return X and Z (metres) of characters lined up across `heading` (radians), the first on the left.

    Six or more stand in two rows, the second behind the gaps of the first.
    """
    rows = [count] if count <= MAX_ROW_CHARACTERS else [(count + 1) // 2, count // 2]
    ahead = np.array([math.sin(heading), math.cos(heading)])
    right = np.array([-ahead[1], ahead[0]])
    found = []
    for row, length in enumerate(rows):
        for k in range(length):
            aside = (k - (length - 1) / 2) * SPACING_M
            if len(rows) == 2 and rows[0] == rows[1]:
                aside += (row - 0.5) * SPACING_M / 2
            x, z = np.array(centre) + aside * right + (row - (len(rows) - 1) / 2) * ROW_M * ahead
            found.append((float(x), float(z)))
    return found


def centre_of(poses: Sequence[Pose]) -> Array:
    """Return the centre `(3,)` of all characters, at hip height."""
    roots = np.array([pose.root_position for pose in poses], float)
    return np.asarray(0.5 * (roots.min(0) + roots.max(0)) + np.array([0.0, 0.5 * ABOVE_M, 0.0]))


def distance_to(poses: Sequence[Pose], camera: Camera, aspect: float) -> float:
    """Return the camera distance (metres) at which a view of this aspect ratio shows all characters."""
    feet = np.array([pose.root_position for pose in poses], float)
    points = np.concatenate([feet, feet + np.array([0.0, ABOVE_M, 0.0])]) - centre_of(poses)
    axes = camera.view_matrix()[:3, :3].astype(float)
    across, up, back = axes @ points.T
    half = camera.half_height * FILLED_VIEW_FRACTION
    aside = (np.abs(across) + 0.45) / (half * aspect)  # half a character's width
    return float(np.max(np.maximum(aside, np.abs(up) / half) + back))


def names(variants: Sequence[Variant]) -> list[tuple[str, str]]:
    """Return for each variant its prompt, possibly shortened, and the weight of prompt B and the seed if they differ."""
    weights, seeds = [weight_of(v.prompt) for v in variants], [f"seed {v.seed}" for v in variants]
    rest = [texts for texts in (weights, seeds) if len(set(texts)) > 1]
    prompts = [variant.prompt.prompt(Side.A) or "own words" for variant in variants]
    return [(prompt, "".join(f", {t[i]}" for t in rest if t[i])) for i, prompt in enumerate(prompts)]


def weight_of(blend: PromptBlend) -> str:
    """Return the weight of prompt B in a blend as text; "" without prompt B."""
    return "" if blend.b is None else f"B {100 * blend.master_weight:.0f} %"
