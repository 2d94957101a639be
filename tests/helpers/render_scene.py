"""Stand-ins for the rendering tests: a capsule body skinned to the SPORT skeleton, poses, terrains."""

from dataclasses import dataclass

import numpy as np

from runtime import rotations
from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON, J
from runtime.terrain.height_map import Terrain

RINGS, SIDES, RADIUS_M = 8, 10, 0.06


@dataclass
class CapsuleBody:
    """One capsule per bone, rigidly skinned; the same arrays as `runtime.character.character.Character`."""

    positions: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    joint_indices: np.ndarray
    joint_weights: np.ndarray
    triangles: np.ndarray

    def skin_matrices(self, pose: Pose) -> np.ndarray:
        """Return matrices from rest mesh to world `(31, 4, 4)`."""
        matrices = np.tile(np.eye(4, dtype=np.float32), (J, 1, 1))
        rotation = rotations.to_matrix(pose.world_rotations)
        matrices[:, :3, :3] = rotation
        moved = np.einsum("jab,jb->ja", rotation, SPORT_SKELETON.rest_positions)
        matrices[:, :3, 3] = pose.positions - moved
        return matrices


def capsule_body() -> CapsuleBody:
    """Return the stand-in character in the rest pose."""
    rest = SPORT_SKELETON.rest_positions
    positions, normals, colors, joints, triangles = [], [], [], [], []
    for child, parent in enumerate(SPORT_SKELETON.parents):
        if parent < 0 or np.linalg.norm(SPORT_SKELETON.offsets[child]) < 1e-3:
            continue
        along = rotations.normalize(rest[child] - rest[parent])
        side = rotations.normalize(np.cross(along, (0.3, 0.8, 0.52)))
        other = np.cross(along, side)
        start = sum(map(len, positions))
        theta = np.linspace(-np.pi / 2, np.pi / 2, RINGS)[:, None, None]
        phi = (np.arange(SIDES) * 2 * np.pi / SIDES)[None, :, None]
        normal = np.cos(theta) * (np.cos(phi) * side + np.sin(phi) * other) + np.sin(theta) * along
        ends = np.where(theta < 0, rest[parent], rest[child])
        positions.append((ends + RADIUS_M * normal).reshape(-1, 3))
        normals.append(normal.reshape(-1, 3))
        color = (0.75, 0.72, 0.66) if child % 2 else (0.80, 0.30, 0.08)
        colors.append(np.tile(color, (RINGS * SIDES, 1)))
        joints.append(np.full(RINGS * SIDES, parent))
        k, i = (a.ravel() for a in np.meshgrid(np.arange(RINGS - 1), np.arange(SIDES), indexing="ij"))
        a, b = start + k * SIDES + i, start + k * SIDES + (i + 1) % SIDES
        triangles.append(np.stack([a, b, b + SIDES, a, b + SIDES, a + SIDES], -1).reshape(-1, 3))
    indices = np.zeros((sum(map(len, joints)), 4), np.int64)
    indices[:, 0] = np.concatenate(joints)
    weights = np.tile(np.array([1.0, 0, 0, 0], np.float32), (len(indices), 1))
    arrays = (np.concatenate(a).astype(np.float32) for a in (positions, normals, colors))
    return CapsuleBody(*arrays, indices, weights, np.concatenate(triangles))


def walking_pose(terrain: Terrain, x: float = 0.0, z: float = 0.0, stride: float = 0.5) -> Pose:
    """Return a step with hanging arms, hips above the ground at x, z; left heel and toe in contact."""
    local = rotations.identity((J,))

    def turn(name: str, axis: tuple[float, float, float], angle: float) -> None:
        local[SPORT_SKELETON.index(name)] = rotations.from_axis_angle(np.array(axis), np.array(angle))

    turn("LeftUpLeg", (1, 0, 0), -stride)
    turn("RightUpLeg", (1, 0, 0), 0.6 * stride)
    turn("RightLeg", (1, 0, 0), stride)
    turn("LeftArm", (0, 0, 1), -1.3)
    turn("RightArm", (0, 0, 1), 1.3)
    ground = float(terrain.height(x, z))
    hips = np.array([x, ground + 0.94, z], np.float32)
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    contacts = np.array([1.0, 1.0, 0.0, 0.2], np.float32)
    root = np.array([x, ground, z], np.float32)
    return Pose(hips, local, positions.astype(np.float32), world, contacts, root, 0.0)


def stairs() -> Terrain:
    """Return steps of 15 cm along +z, with edges one cell wide."""
    z = np.arange(201) * 0.1 - 10.0
    heights = 0.15 * np.clip(np.floor((z - 1.0) / 0.4), 0, 8)
    return Terrain("steps", np.tile(heights.astype(np.float32), (201, 1)), 0.1, (-10.0, -10.0))


def hills(cell_m: float = 0.25, size_m: float = 30.0) -> Terrain:
    """Return smooth waves of half a metre."""
    axis = np.arange(round(size_m / cell_m) + 1) * cell_m - size_m / 2
    x, z = np.meshgrid(axis, axis, indexing="ij")
    heights = 0.4 * np.sin(0.6 * x) * np.cos(0.5 * z) + 0.1 * np.sin(1.3 * x + z)
    return Terrain("waves", heights.astype(np.float32), cell_m, (-size_m / 2, -size_m / 2))
