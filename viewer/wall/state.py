"""The wall's slice of the state: who walks on it."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from runtime.arrays import Array
from runtime.pose import Pose
from viewer.prompt.style_edit import Side, StyleEdit
from viewer.render.camera import Camera

SPACING_M = 1.5  # between neighbours
ROW_M = 2.2  # between two rows
LONGEST_ROW = 5
ABOVE_M = 2.15  # the highest point of a character and its name
MARGIN = 0.86  # of the view that they fill


def places(count: int, centre: tuple[float, float], heading: float) -> list[tuple[float, float]]:
    """X and Z (metres) of characters side by side as seen along `heading` (radians), the first on the left.

    From six on they stand in two rows, the second behind the gaps of the first.
    """
    rows = [count] if count <= LONGEST_ROW else [(count + 1) // 2, count // 2]
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


def centre_of(poses: list[Pose]) -> Array:
    """The middle `(3,)` of the box around all, at the height of their hips."""
    roots = np.array([pose.root_position for pose in poses], float)
    return np.asarray(0.5 * (roots.min(0) + roots.max(0)) + np.array([0.0, 0.5 * ABOVE_M, 0.0]))


def distance_to(poses: list[Pose], camera: Camera, aspect: float) -> float:
    """Metres from the camera's target at which a free view of this width / height of the window holds all of them."""
    feet = np.array([pose.root_position for pose in poses], float)
    points = np.concatenate([feet, feet + np.array([0.0, ABOVE_M, 0.0])]) - centre_of(poses)
    axes = camera.view_matrix()[:3, :3].astype(float)
    across, up, back = axes @ points.T
    half = camera.half_height * MARGIN
    aside = (np.abs(across) + 0.45) / (half * aspect)  # half a character's width
    return float(np.max(np.maximum(aside, np.abs(up) / half) + back))


FEWEST, MOST = 2, 9


@dataclass
class Candidate:
    """One character of the wall: what it moves by."""

    number: int  # the same as long as the wall is open
    edit: StyleEdit
    seed: int
    text: str = ""  # of its field
    asked: bool = False  # its prompt has no answer yet

    @property
    def name(self) -> str:
        """Its prompt, or both of a blend."""
        a, b = (self.edit.prompt(side) or "own words" for side in Side)
        return f"{self.edit.master_weight:.0%} {b}, else {a}" if self.edit.blended else a


@dataclass
class WallState:
    """The wall is open while there are candidates."""

    candidates: list[Candidate] = field(default_factory=list)
    hovered: int = -1  # index of the candidate under the mouse
    focus_requested: bool = False

    @property
    def open(self) -> bool:
        """Whether the wall is shown in place of the walker."""
        return bool(self.candidates)

    @property
    def titles(self) -> list[str]:
        """What stands over each: its prompt, with the seed where others have the same."""
        return [name + seed for name, seed in self.names]

    @property
    def names(self) -> list[tuple[str, str]]:
        """The titles in two: the prompt, which may be cut, and what tells it from others of the same prompt."""
        names = Counter(candidate.name for candidate in self.candidates)
        return [(c.name, f", seed {c.seed}" if names[c.name] > 1 else "") for c in self.candidates]
