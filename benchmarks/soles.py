"""Penetration of level ground by soles of other bodies, and sliding of their standing toes, in generated walks.

python -m benchmarks.soles --seconds 4
"""

from dataclasses import replace
from typing import Any

import numpy as np

from runtime.assets import asset_path
from runtime.atomic import temporary_folder
from runtime.character.character import Character, load_character
from runtime.character.shape import BodyShape, shaped
from runtime.character.skinned_mesh import skin_vertices
from runtime.character.writer import write_character
from runtime.feet.skating import TOES
from runtime.generate import generate_clip
from runtime.takes.clip import Clip
from training.evaluation.experiment import Experiment, Setting, option, run_alone
from training.markdown import number, table

BODIES = {
    "child": BodyShape(0.62, 0.85, 0.85, 0.9, 1.35),
    "dwarf": BodyShape(0.8, 0.5, 1.25, 0.8, 1.25),
    "giant": BodyShape(2.4, 1.1, 1.3, 1.1, 0.85),
}
WALKS = (
    ("a relaxed walk", "walk"),
    ("an old man", "walk"),
    ("a proud queen", "walk"),
    ("a relaxed walk", "jog"),
)
MIN_STANDING_CONTACT = 0.7  # contact probability of a standing toe


def foot_meshes(character: Character) -> Character:
    """Return the character reduced to the vertices of both feet."""
    lead = character.joint_indices[np.arange(len(character.positions)), character.joint_weights.argmax(1)]
    own = np.isin(
        np.array(character.joint_names)[lead], ["LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase"]
    )
    arrays = {n: getattr(character, n)[own] for n in ("positions", "joint_indices", "joint_weights")}
    return replace(character, **arrays)


def measure(character: Character, clip: Clip) -> tuple[float, float, float]:
    """Return the lowest height of the soles, its first percentile, and the slide of standing toes per frame, cm."""
    positions, world = (array.astype(np.float64) for array in clip.world())
    positions, world = character.adapted(positions, world, clip.contacts.astype(np.float64))
    matrices = character.joint_matrices(positions, world) @ character.inverse_bind
    feet = foot_meshes(character)
    low = np.array([skin_vertices(feet, each)[:, 1].min() for each in matrices]) * 100.0 * character.size
    toes = [list(character.sport_joints).index(joint) for joint in TOES]
    pivots = character.joint_transforms(positions, world)[0][:, toes][..., [0, 2]]
    way = np.linalg.norm(np.diff(pivots, axis=0), axis=-1) * 100.0 * character.size
    stands = clip.contacts[:, [1, 3]] > MIN_STANDING_CONTACT
    return float(low.min()), float(np.percentile(low, 1)), float(way[stands[1:] & stands[:-1]].mean())


def sole_figures(setting: Setting) -> list[list[Any]]:
    """Measure every body and walk."""
    seconds, rows = setting.args.seconds, []
    mannequin = load_character(asset_path("character/mannequin.glb"))
    clips = [(f"{p}, {g}", generate_clip(p, gait=g, seconds=seconds, path="circle")) for p, g in WALKS]
    for name, shape in BODIES.items():
        with temporary_folder() as folder:
            path = folder / "body.glb"
            write_character(path, shaped(mannequin, shape))
            character = load_character(path)
        rows += [[f"{name}, {walk}", *measure(character, clip)] for walk, clip in clips]
    return rows


def sole_table(rows: list[list[Any]]) -> str:
    """Return a table with a row per body and walk."""
    head = [
        "body, walk",
        "deepest, cm over the ground",
        "first percentile",
        "slide of standing toes, cm a frame",
    ]
    cells = [
        [walk, number(deepest, 2), number(first, 2), number(slide, 3)] for walk, deepest, first, slide in rows
    ]
    return "\n".join(table(head, cells))


SOLES = Experiment(
    __doc__, sole_figures, sole_table, "soles", options=(option("--seconds", type=float, default=4.0),)
)

if __name__ == "__main__":
    raise SystemExit(run_alone(SOLES, "soles"))
