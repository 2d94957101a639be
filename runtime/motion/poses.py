"""Poses of N characters: out of the network's y, and as they are shown."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.motion import features
from runtime.motion.features import OutputParts
from runtime.motion.trajectory import PRESENT, Trajectory
from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON, J
from runtime.terrain.height_map import PointHeights, Terrain

_FLOAT32 = {"dtype": np.float32}


@dataclass
class Poses:
    """What is shown of N characters, float32: see `runtime.pose.Pose`."""

    hips: Array = field(metadata={"shape": (3,), **_FLOAT32})
    local: Array = field(metadata={"shape": (J, 4), **_FLOAT32})
    positions: Array = field(metadata={"shape": (J, 3), **_FLOAT32})
    world: Array = field(metadata={"shape": (J, 4), **_FLOAT32})
    contacts: Array = field(metadata={"shape": (4,), **_FLOAT32})
    root: Array = field(metadata={"shape": (3,), **_FLOAT32})
    yaw: Array = field(metadata={"shape": ()})

    def pose(self, index: int = 0) -> Pose:
        """That of one character."""
        return Pose(
            self.hips[index],
            self.local[index],
            self.positions[index],
            self.world[index],
            self.contacts[index],
            self.root[index],
            float(self.yaw[index]),
        )


def network_pose(y: OutputParts, trajectory: Trajectory, ground: Array) -> tuple[Array, Array, Array]:
    """Hips `(N, 3)`, local rotations `(N, 31, 4)` and joints `(N, 31, 3)` in world space, on the fixed skeleton; `ground` `(N,)` in metres."""
    yaw, root = trajectory.yaw[:, PRESENT], trajectory.here
    hips = features.to_world(y.joint_positions[:, 0], yaw)
    hips[:, 0] += root[:, 0]
    hips[:, 1] += ground
    hips[:, 2] += root[:, 1]
    world = rotations.yaw_matrix(yaw)[:, None] @ rotations.matrix_from_6d(y.joint_rotations)
    local = SPORT_SKELETON.local_rotations(rotations.from_matrix(world))
    return hips, local, SPORT_SKELETON.oriented(hips, world)


def shown_poses(
    hips: Array, local: Array, contacts: Array, trajectory: Trajectory, terrain: Terrain
) -> Poses:
    """Forward kinematics of hips `(N, 3)` and local rotations `(N, 31, 4)`, with the roots on the ground."""
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    xz, yaw = trajectory.here, trajectory.yaw[:, PRESENT]
    point = PointHeights(terrain).height
    root = np.array([(x, point(x, z), z) for x, z in xz.tolist()])
    arrays = (hips, local, positions, world, contacts, root)
    hips, local, positions, world, contacts, root = (array.astype(np.float32) for array in arrays)
    return Poses(hips, local, positions, world, contacts, root, yaw.copy())
