"""The complete state of N characters that changes from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.edits.body import BodyEdits
from runtime.feet.foot_lock import FootLock
from runtime.motion.balance import StrideBalance
from runtime.motion.elbows import Elbows
from runtime.motion.features import DT, PHASE_OFFSETS, C, OutputParts, split_output
from runtime.motion.hands import HandSpeed
from runtime.motion.model import MotionModel
from runtime.motion.pace import SpeedRegulator, Stall, StrideState
from runtime.motion.phase import RestRhythm
from runtime.motion.pose_smoothing import Inertialization, Settling
from runtime.motion.style import StyleBlend
from runtime.motion.swing import Swings
from runtime.motion.trajectory import LENGTH, PRESENT, Trajectory
from runtime.motion.walkable import WalkableShare
from runtime.pose import Pose
from runtime.scalar_math import add, multiply, rotate
from runtime.skeleton import SPORT_SKELETON, J
from runtime.terrain.height_map import PointHeights, Terrain
from runtime.traversal.jump import Jump
from runtime.traversal.traversal import Traversal

_FLOAT32 = {"dtype": np.float32}


@dataclass
class Poses:
    """Shown poses of N characters, float32; see `runtime.pose.Pose`."""

    hips: Array = field(metadata={"shape": (3,), **_FLOAT32})
    local: Array = field(metadata={"shape": (J, 4), **_FLOAT32})
    positions: Array = field(metadata={"shape": (J, 3), **_FLOAT32})
    world: Array = field(metadata={"shape": (J, 4), **_FLOAT32})
    contacts: Array = field(metadata={"shape": (4,), **_FLOAT32})
    root: Array = field(metadata={"shape": (3,), **_FLOAT32})
    yaw: Array = field(metadata={"shape": ()})

    def pose(self, index: int = 0) -> Pose:
        """Return the pose of one character."""
        return Pose(
            self.hips[index],
            self.local[index],
            self.positions[index],
            self.world[index],
            self.contacts[index],
            self.root[index],
            float(self.yaw[index]),
        )

    def raised(self, rise: Array) -> Poses:
        """Return the poses raised by `rise` `(N,)` metres."""
        up = np.stack([0.0 * rise, rise, 0.0 * rise], axis=-1).astype(np.float32)
        return replace(self, hips=self.hips + up, positions=self.positions + up[:, None], root=self.root + up)


def network_pose(y: OutputParts) -> tuple[Array, Array]:
    """Return local rotations `(N, 31, 4)` and joints `(N, 31, 3)` of the network's output on the fixed skeleton, relative to the root."""
    turned = rotations.matrix_from_6d(y.joint_rotations)
    local, joints = SPORT_SKELETON.oriented(y.joint_positions[:, 0], turned)
    return rotations.from_matrix(local), joints


def placed(hips: Array, local: Array, trajectory: Trajectory, ground: Array) -> tuple[Array, Array]:
    """Return world hips `(N, 3)` and local rotations `(N, 31, 4)` of poses relative to the root, above `ground` `(N,)` (m)."""
    hips, local = hips.copy(), local.copy()
    for i, (root, yaw) in enumerate(
        zip(trajectory.here.tolist(), trajectory.yaw[:, PRESENT].tolist(), strict=True)
    ):
        turn = (cos(0.5 * yaw), 0.0, sin(0.5 * yaw), 0.0)
        hips[i] = add((root[0], float(ground[i]), root[1]), rotate(turn, hips[i].tolist()))
        local[i, 0] = multiply(turn, local[i, 0].tolist())
    return hips, local


def shown_poses(
    hips: Array, local: Array, contacts: Array, trajectory: Trajectory, terrain: Terrain
) -> Poses:
    """Return poses by forward kinematics of hips `(N, 3)` and local rotations `(N, 31, 4)`, with the roots on the ground."""
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    point = PointHeights(terrain).height
    root = np.array([(x, point(x, z), z) for x, z in trajectory.here.tolist()])
    arrays = (hips, local, positions, world, contacts, root)
    hips, local, positions, world, contacts, root = (array.astype(np.float32) for array in arrays)
    return Poses(hips, local, positions, world, contacts, root, trajectory.yaw[:, PRESENT].copy())


# m/s: faster than a hand in a captured jog; a network far from its data reaches 100
MAX_JOINT_SPEED_M_PER_S = 24.0
SLOWING_ROUNDS = 4


def bound_speed(poses: Poses, before: Poses) -> None:
    """Move poses back towards those of the frame `before`, so that no joint is faster than `MAX_JOINT_SPEED_M_PER_S`.

    The network continues from its own pose, which the shown one reaches some frames later.
    """
    moved = poses.positions - before.positions
    if float(np.maximum.reduce(moved * moved, None)) * 3.0 < (MAX_JOINT_SPEED_M_PER_S * DT) ** 2:
        return
    fast = _fastest_joint(poses.positions, before.positions) > MAX_JOINT_SPEED_M_PER_S
    if not fast.any():
        return
    last = before.hips[fast], before.local[fast], before.positions[fast]
    hips, local, positions = poses.hips[fast], poses.local[fast], poses.positions[fast]
    fraction = np.ones((len(hips), 1))
    for _ in range(SLOWING_ROUNDS):  # a fraction of all turns is not the same fraction of the distance
        fraction *= np.minimum(1.0, MAX_JOINT_SPEED_M_PER_S / _fastest_joint(positions, last[2]))[:, None]
        placed = last[0] + fraction * (hips - last[0]), rotations.slerp(last[1], local, fraction)
        positions, world = SPORT_SKELETON.forward_kinematics(*placed)
    poses.hips[fast], poses.local[fast] = placed
    poses.positions[fast], poses.world[fast] = positions, world


def _fastest_joint(positions: Array, before: Array) -> Array:
    """Return the speed (m/s) `(N,)` of the fastest of the joints `(N, 31, 3)`."""
    return np.asarray(np.linalg.norm(positions - before, axis=-1).max(-1) / DT)


_ONE = {"shape": ()}


@dataclass
class CharacterState:
    """State of N characters: named arrays with the character as first axis, and a record per character for feet and traversals.

    It is a value: `runtime.motion.frame.step` returns the next state and does not change this one.
    """

    seed: NDArray[np.int64] = field(metadata={"shape": (), "dtype": np.int64})  # of the noise
    # since the character was placed
    frame: NDArray[np.int64] = field(metadata={"shape": (), "dtype": np.int64})
    # the network's own pose, relative to the root, which is fed back
    joints: Array = field(metadata={"shape": (J, 3), "most": 100.0})
    velocities: Array = field(metadata={"shape": (J, 3), "most": 1000.0})  # m/s
    phase: Array = field(metadata={"shape": (LENGTH, C, 2), "most": 1000.0})
    trajectory: Trajectory
    ground: Array = field(metadata=_ONE)  # m, height of the ground under the body
    wished_speed: Array = field(metadata={"shape": (), "most": 100.0})  # m/s, requested by the stick
    requested_speed: Array = field(metadata={"shape": (), "most": 100.0})  # m/s, of the plan towards it
    smooth_request: Array = field(metadata={"shape": (), "most": 100.0})  # the same, smoothed over a stride
    root_speed: Array = field(metadata={"shape": (), "most": 1000.0})  # m/s
    measured_speed: Array = field(metadata={"shape": (), "most": 1000.0})  # the same, smoothed over a stride
    regulator: SpeedRegulator
    stride: StrideState
    stall: Stall
    rest: RestRhythm
    arms: Inertialization
    settling: Settling
    edits: tuple[BodyEdits, ...]
    swings: Swings = field(metadata={"later": True})
    balance: StrideBalance = field(metadata={"later": True})
    walkable: WalkableShare = field(metadata={"later": True})
    elbows: Elbows = field(metadata={"later": True})
    hands: HandSpeed = field(metadata={"later": True})
    feet: tuple[FootLock, ...]
    traversals: tuple[Traversal, ...]
    jumps: tuple[Jump, ...]
    styles: tuple[StyleBlend, ...]
    poses: Poses

    def __len__(self) -> int:
        return len(self.seed)


def standing(
    model: MotionModel, terrain: Terrain, style: StyleBlend, seed: int, x: float, z: float, yaw: float
) -> CharacterState:
    """Return the state of one character standing at x, z (metres), facing `yaw` (radians), in the start pose of the model's metadata."""
    start = model.metadata["start"]
    y = split_output(np.array(start["output"], np.float64)[None])
    samples = np.array(start["phase"], np.float64).reshape(len(PHASE_OFFSETS), -1)
    dense = np.arange(PHASE_OFFSETS[0], PHASE_OFFSETS[-1] + 1)
    phase = np.stack([np.interp(dense, PHASE_OFFSETS, column) for column in samples.T], -1)
    trajectory = Trajectory.standing(x, z, yaw)
    ground = terrain.height(np.array([x]), np.array([z])).astype(np.float64)
    relative, joints = network_pose(y)
    hips, local = placed(joints[:, 0], relative, trajectory, ground)
    feet, contacts = FootLock(), np.zeros((1, 4))
    locked = feet.apply(hips[0], local[0], contacts[0], terrain, DT)
    still = np.zeros(1)
    return CharacterState(
        seed=np.array([seed]),
        frame=np.zeros(1, np.int64),
        joints=y.joint_positions,
        velocities=np.zeros_like(y.joint_positions),
        phase=phase.reshape(1, -1, C, 2),
        trajectory=trajectory,
        ground=ground,
        wished_speed=still,
        requested_speed=still,
        smooth_request=still,
        root_speed=still,
        measured_speed=still,
        regulator=SpeedRegulator.at_rest(),
        stride=StrideState.at_rest(y.joint_positions),
        stall=Stall.at_rest(y.joint_positions),
        rest=RestRhythm.silent(),
        arms=Inertialization.at_rest(local),
        settling=Settling.awake(relative),
        edits=(BodyEdits(),),
        swings=Swings(),
        balance=StrideBalance(),
        walkable=WalkableShare(),
        elbows=Elbows(),
        hands=HandSpeed(),
        feet=(feet,),
        traversals=(Traversal(),),
        jumps=(Jump.standing(float(hips[0, 1]), float(ground[0])),),
        styles=(style,),
        poses=shown_poses(
            locked.hips_position[None], locked.local_rotations[None], contacts, trajectory, terrain
        ),
    )
