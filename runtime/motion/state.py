"""Everything of N characters that changes from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.crossing.crossing import Crossing
from runtime.crossing.jump import Jump
from runtime.feet.foot_lock import FootLock
from runtime.motion.calm import Calm
from runtime.motion.features import DT, PHASE_OFFSETS, C, split_output
from runtime.motion.inertialization import Inertialization
from runtime.motion.model import MotionModel
from runtime.motion.poses import Poses, network_pose, shown_poses
from runtime.motion.rest_rhythm import RestRhythm
from runtime.motion.speed_regulator import SpeedRegulator
from runtime.motion.stall import Stall
from runtime.motion.stride import StrideState
from runtime.motion.style_blend import StyleBlend
from runtime.motion.trajectory import LENGTH, Trajectory
from runtime.skeleton import J
from runtime.terrain.height_map import Terrain

_ONE = {"shape": ()}


@dataclass
class CharacterState:
    """Named arrays whose first axis is the character; the scalar paths of feet and crossings have a record for each.

    A state is a value: `runtime.motion.frame.step` makes the next one of it and leaves it as it is.
    """

    seed: NDArray[np.int64] = field(metadata={"shape": (), "dtype": np.int64})  # of the noise
    frame: NDArray[np.int64] = field(
        metadata={"shape": (), "dtype": np.int64}
    )  # since the character was put down
    joints: Array = field(
        metadata={"shape": (J, 3), "most": 100.0}
    )  # the network's own pose, relative to the root: what is fed back
    velocities: Array = field(metadata={"shape": (J, 3), "most": 1000.0})  # m/s
    phase: Array = field(metadata={"shape": (LENGTH, C, 2), "most": 1000.0})
    trajectory: Trajectory
    ground: Array = field(metadata=_ONE)  # m, the height that the body is placed over
    wished_speed: Array = field(metadata={"shape": (), "most": 100.0})  # m/s, the stick's
    requested_speed: Array = field(metadata={"shape": (), "most": 100.0})  # m/s, planned on the way there
    smooth_request: Array = field(metadata={"shape": (), "most": 100.0})  # the same, smoothed over a stride
    root_speed: Array = field(metadata={"shape": (), "most": 1000.0})  # m/s
    measured_speed: Array = field(metadata={"shape": (), "most": 1000.0})  # the same, smoothed over a stride
    regulator: SpeedRegulator
    stride: StrideState
    stall: Stall
    rest: RestRhythm
    arms: Inertialization
    calm: Calm
    feet: tuple[FootLock, ...]
    crossings: tuple[Crossing, ...]
    jumps: tuple[Jump, ...]
    styles: tuple[StyleBlend, ...]
    poses: Poses

    def __len__(self) -> int:
        return len(self.seed)


def standing(
    model: MotionModel, terrain: Terrain, style: StyleBlend, seed: int, x: float, z: float, yaw: float
) -> CharacterState:
    """One character that stands at x, z (metres) facing `yaw` (radians), as the model's metadata say that it begins."""
    start = model.metadata["start"]
    y = split_output(np.array(start["output"], np.float64)[None])
    samples = np.array(start["phase"], np.float64).reshape(len(PHASE_OFFSETS), -1)
    dense = np.arange(PHASE_OFFSETS[0], PHASE_OFFSETS[-1] + 1)
    phase = np.stack([np.interp(dense, PHASE_OFFSETS, column) for column in samples.T], -1)
    trajectory, ground = (
        Trajectory.standing(x, z, yaw),
        terrain.height(np.array([x]), np.array([z])).astype(np.float64),
    )
    hips, local, _ = network_pose(y, trajectory, ground)
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
        calm=Calm.awake(local, np.array([yaw])),
        feet=(feet,),
        crossings=(Crossing(),),
        jumps=(Jump.standing(float(hips[0, 1]), float(ground[0])),),
        styles=(style,),
        poses=shown_poses(
            locked.hips_position[None], locked.local_rotations[None], contacts, trajectory, terrain
        ),
    )
