"""Builds the shipped mannequin: implicit surface, mesh, skin weights, colours, GLB.

python -m training.character.build --out assets/character/mannequin.glb
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from runtime.character.character import Character
from runtime.character.joints import align
from runtime.character.writer import write_character
from runtime.errors import run_command
from runtime.skeleton import SPORT_SKELETON
from training.character import mesh, paint, weights
from training.character.body import REST_POSITIONS, Body


def build() -> Character:
    """The mannequin in the rest pose of the SPORT skeleton, sole at y = 0."""
    body = Body()
    half, half_triangles = mesh.half_mesh(body)
    half, half_triangles = paint.cut_regions(half, half_triangles)
    half = body.project(half, 2)
    source, side = mesh.mirror_index(half)
    triangles = mesh.mirror_triangles(half, half_triangles)
    reflect = np.where(side[:, None] == 1, [-1.0, 1.0, 1.0], [1.0, 1.0, 1.0])
    vertices = half[source] * reflect
    normals = body.gradient(half)[source] * reflect
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    skin = weights.mirrored_weights(weights.analytic_weights(body, half), source, side, vertices[:, 0] == 0)
    skin = weights.separate_sides(weights.diffuse(skin, vertices, triangles, 0.014), vertices)
    joints, values = weights.strongest(skin)
    left = np.repeat([True, False], len(half_triangles))
    region = np.tile(paint.region_of(half[half_triangles].mean(axis=1)), 2)
    used, corner = split_by_colour(triangles, np.where(left, region, region + paint.ACCENT + 1))
    region, left = used[1] % (paint.ACCENT + 1), used[1] <= paint.ACCENT
    used = used[0]
    return character(
        vertices[used], normals[used], paint.palette(region, left), joints[used], values[used], corner
    )


def split_by_colour(triangles: np.ndarray, label: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give vertices on a border one copy for each label: `(2, V)` source vertex and label, new triangles `(F, 3)`."""
    pairs = np.stack([triangles.ravel(), np.repeat(label, 3)], axis=1)
    unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
    return unique.T, inverse.reshape(triangles.shape)


def character(
    vertices: np.ndarray,
    normals: np.ndarray,
    colors: np.ndarray,
    joints: np.ndarray,
    values: np.ndarray,
    triangles: np.ndarray,
) -> Character:
    """A `Character` on the SPORT skeleton standing on y = 0."""
    rest = np.tile(np.eye(4, dtype=np.float32), (len(SPORT_SKELETON), 1, 1))
    rest[:, :3, 3] = REST_POSITIONS
    inverse = rest.copy()
    inverse[:, :3, 3] *= -1.0
    found = {name: i for i, name in enumerate(SPORT_SKELETON.names)}
    return Character(
        positions=vertices.astype(np.float32),
        normals=normals.astype(np.float32),
        colors=colors.astype(np.float32),
        joint_indices=joints,
        joint_weights=values,
        triangles=triangles.astype(np.uint32),
        joint_names=SPORT_SKELETON.names,
        joint_parents=SPORT_SKELETON.parents,
        inverse_bind=inverse,
        rest_world=rest,
        sport_joints=np.arange(len(SPORT_SKELETON)),
        alignment=align(found, SPORT_SKELETON.parents, rest, vertices),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line: build the mannequin and write it."""
    parser = argparse.ArgumentParser(description="Build the mannequin from its implicit surface.")
    parser.add_argument(
        "--out", type=Path, default=Path("assets/character/mannequin.glb"), help="GLB to write"
    )
    options = parser.parse_args(arguments)
    mannequin = build()
    write_character(options.out, mannequin, "mannequin")
    print(
        f"{options.out}: {len(mannequin.positions)} vertices, {len(mannequin.triangles)} triangles,"
        f" {options.out.stat().st_size / 1e6:.2f} MB, {np.ptp(mannequin.positions[:, 1]):.3f} m tall"
    )


if __name__ == "__main__":
    raise SystemExit(run_command("character", main))
