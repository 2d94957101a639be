"""Another skeleton as something to draw: a spindle for each bone, which follows the bone's two ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runtime.arrays import AnyArray, Array
from runtime.pose import Pose
from runtime.takes.own_skeleton import OwnSkeleton

MAX_BONES = 250
LONGEST_M = 1.2  # from one joint to the next: longer is the way from a scene's origin to the hips
WAIST_BONE_FRACTION, THICKNESS_BONE_FRACTION = 0.18, 0.11  # of a spindle's length
THINNEST_M, THICKEST_M = 0.006, 0.04
COLOR = (0.55, 0.33, 0.06)  # linear; amber, as no character and no ground is


@dataclass(frozen=True, eq=False)
class Bones:
    """A mesh of spindles (see `SkinnedMesh`), one a bone, all along +Y with length 1 until a pose is given."""

    ends: AnyArray  # (B, 2) points of the skeleton
    positions: AnyArray
    normals: AnyArray
    colors: AnyArray
    joint_indices: AnyArray
    joint_weights: AnyArray
    triangles: AnyArray

    def skin_matrices(self, pose: Pose) -> Array:
        """Raise NotImplementedError: the matrices of bones are made of their points."""
        raise NotImplementedError("bones follow points: `matrices`")

    def matrices(self, points: Array) -> Array:
        """Return the matrices `(B, 4, 4)` that put each spindle between its two `points` `(K, 3)`."""
        start, along = points[self.ends[:, 0]], points[self.ends[:, 1]] - points[self.ends[:, 0]]
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-6)
        up = along / length[:, None]
        helper = np.where(np.abs(up[:, :1]) < 0.9, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
        side = np.cross(up, helper)
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        thick = np.clip(length * THICKNESS_BONE_FRACTION, THINNEST_M, THICKEST_M)[:, None]
        shown = (length <= LONGEST_M)[:, None]  # else shrunk to nothing
        made = np.zeros((len(up), 4, 4), np.float32)
        made[:, :3, 0], made[:, :3, 1] = side * thick * shown, along * shown
        made[:, :3, 2], made[:, :3, 3] = np.cross(side, up) * thick * shown, start
        made[:, 3, 3] = 1.0
        return made


def bones_of(own: OwnSkeleton) -> Bones:
    """Return the spindles of a skeleton; of more than can be drawn the longest."""
    ends = np.array([(parent, k) for k, parent in enumerate(own.parents) if parent >= 0], np.int64).reshape(
        -1, 2
    )
    first = own.points[0].astype(np.float64)
    lengths = np.linalg.norm(first[ends[:, 1]] - first[ends[:, 0]], axis=1)
    longest = np.argsort(-lengths, kind="stable")[:MAX_BONES]
    ends = ends[np.sort(longest[lengths[longest] > 1e-4])]
    corners, normals = _spindle()
    count, each = len(ends), len(corners)
    return Bones(
        ends=ends,
        positions=np.tile(corners, (count, 1)),
        normals=np.tile(normals, (count, 1)),
        colors=np.tile(np.array(COLOR, np.float32), (count * each, 1)),
        joint_indices=np.repeat(np.arange(count, dtype=np.uint16), each)[:, None]
        * np.array([1, 0, 0, 0], np.uint16),
        joint_weights=np.tile(np.array([1, 0, 0, 0], np.float32), (count * each, 1)),
        triangles=np.arange(count * each, dtype=np.uint32).reshape(-1, 3),
    )


def _spindle() -> tuple[Array, Array]:
    """Return corners `(24, 3)` and normals of eight flat triangles around +Y, counter-clockwise from outside."""
    ring = np.array(
        [
            (1.0, WAIST_BONE_FRACTION, 0.0),
            (0.0, WAIST_BONE_FRACTION, -1.0),
            (-1.0, WAIST_BONE_FRACTION, 0.0),
            (0.0, WAIST_BONE_FRACTION, 1.0),
        ]
    )
    low, high = np.zeros(3), np.array([0.0, 1.0, 0.0])
    faces = []
    for i in range(4):
        a, b = ring[i], ring[(i + 1) % 4]
        faces += [(low, b, a), (high, a, b)]
    corners = np.array(faces)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals[:, 1] *= THICKNESS_BONE_FRACTION**2  # they are turned by the matrices that stretch the spindle
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return corners.reshape(-1, 3).astype(np.float32), np.repeat(normals, 3, axis=0).astype(np.float32)
