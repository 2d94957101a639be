"""Many characters on one stick: each moves as its own `Controller` would, bit by bit, at a fraction of the time.

Arrays of all characters go through one NumPy call in place of one each, which is most of the time of a lone step. The
network runs once for each character, on two threads: 8-bit activations are scaled by the largest of a call, so that
a batch would let every character depend on its neighbours. `tests/test_crowd.py` holds crowd and controller together.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.controls import Controls
from runtime.crossing.crossing import HALF_BODY_M, LOOK_M, STOP_SECONDS
from runtime.errors import UsageError
from runtime.motion import features
from runtime.motion.controller import DT, Controller
from runtime.motion.features import OUTPUT_SIZE, InputParts, OutputParts, split_output
from runtime.motion.phase import advance_phase
from runtime.motion.trajectory import PRESENT, advance, bend
from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacles import level_ahead, within_steps
from runtime.terrain.way_ahead import EDGE_M

Array = NDArray[np.floating]

MOST = 64  # characters


class Crowd:
    """Steps controllers of one model on one ground together; each keeps its own style, seed, strength and place.

    UsageError for none, for more than MOST, and for controllers of several models or grounds.
    """

    def __init__(self, members: Sequence[Controller]) -> None:
        if not 1 <= len(members) <= MOST:
            raise UsageError(f"Crowd: {len(members)} characters; expected 1 to {MOST}.", "Take fewer.")
        if any(m.model is not members[0].model or m.terrain is not members[0].terrain for m in members):
            raise UsageError("Crowd: characters of several models or grounds.", "Give all the same.")
        self.members = tuple(members)
        self._helper = ThreadPoolExecutor(1, "crowd")

    def close(self) -> None:
        """End the second thread."""
        self._helper.shutdown()

    @property
    def terrain(self) -> Terrain:
        """The ground of all."""
        return self.members[0].terrain

    def set_terrain(self, terrain: Terrain) -> None:
        """Let all stand on another ground, where they are."""
        for member in self.members:
            member.set_terrain(terrain)

    def step(self, controls: Controls) -> list[Pose]:
        """Simulate 1/60 s of every character; see `Controller.step`."""
        self._steer(controls)
        parts, grounds = self._input()
        y = self._network(features.build_input(parts))
        sound = np.asarray(np.isfinite(y).all(axis=-1))
        y[~sound] = 0.0  # nobody sees them
        for member, ground in zip(self.members, grounds.tolist(), strict=True):
            member._ground = member._lifted(ground)
        split = split_output(y.astype(np.float64))
        poses = self._poses(split, parts)
        for member, pose, is_sound in zip(self.members, poses, sound.tolist(), strict=True):
            if is_sound:
                member.pose = pose
                member._cross()
        self._feed_back(split, parts)
        for i in np.flatnonzero(~sound).tolist():
            poses[i] = self.members[i]._set_back()  # to where its last pose stood
        return poses

    # -- one frame, in order: as in Controller -------------------------------------------------------------------

    def _steer(self, controls: Controls) -> None:
        members = self.members
        direction: Array = np.array(controls.move, np.float64)
        direction = direction / max(float(np.linalg.norm(direction)), 1e-9)
        ways = np.array([m._crossing.way(direction) for m in members])
        reach = np.array([LOOK_M + STOP_SECONDS * m._measured_speed for m in members])
        here = np.array([m._trajectory.xz[PRESENT] for m in members])
        gaits = []
        for member, clear in zip(members, level_ahead(self.terrain, here, ways, reach, EDGE_M), strict=True):
            member.message = ""
            member._advance_style()
            velocity, facing, gait = member._asked(controls, bool(clear))
            member._trajectory.aim(velocity, facing)
            gaits.append(gait)
        windows = self._windows()
        velocities = np.array([m._trajectory.velocity for m in members])
        bend(*windows, velocities, np.array([m._trajectory.requested_yaw for m in members]), np.array(gaits))
        self._keep(windows)

    def _windows(self) -> tuple[Array, Array, Array]:
        paths = [member._trajectory for member in self.members]
        return (
            np.array([p.xz for p in paths]),
            np.array([p.yaw for p in paths]),
            np.array([p.gait for p in paths]),
        )

    def _keep(self, windows: tuple[Array, Array, Array]) -> None:
        for member, xz, yaw, gait in zip(self.members, *windows, strict=True):
            path = member._trajectory
            path.xz, path.yaw, path.gait = xz, yaw, gait

    def _input(self) -> tuple[InputParts, Array]:
        xz, yaw, gait = self._windows()
        index = self.members[0]._trajectory.samples
        directions = np.stack([np.sin(yaw), np.cos(yaw)], axis=-1)[:, index]
        points = features.height_points(xz[:, index], directions)
        heights = self.terrain.height(points[..., 0], points[..., 1]).astype(np.float64)
        present = features.L // 2
        heights = np.array(
            [
                member._crossing.seen(place, within_steps(each, present), present)
                for member, place, each in zip(self.members, points, heights, strict=True)
            ]
        )
        bodies = [member._body for member in self.members]
        parts = InputParts(
            root_position=xz[:, PRESENT],
            root_yaw=yaw[:, PRESENT],
            trajectory_positions=xz[:, index],
            trajectory_directions=directions,
            heights=heights,
            gait=gait[:, index],
            phase=np.array([body.phase[features.PHASE_OFFSETS + PRESENT] for body in bodies]),
            joint_positions=np.array([body.joints for body in bodies]),
            joint_velocities=np.array([body.velocities for body in bodies]),
        )
        return parts, features.ground_height(heights)

    def _network(self, x: Array) -> Array:
        """y `(N, 473)`: odd characters on the second thread, even ones on this."""
        y = np.empty((len(x), OUTPUT_SIZE), np.float32)

        def run(first: int) -> None:
            for i in range(first, len(x), 2):
                member = self.members[i]
                y[i] = member.model.step(x[i : i + 1], member._next_noise(), member.style)[0][0]

        beside = self._helper.submit(run, 1)
        run(0)
        beside.result()
        return y

    def _poses(self, y: OutputParts, x: InputParts) -> list[Pose]:
        members, root, yaw = self.members, x.root_position, x.root_yaw
        contacts = np.clip(y.contacts, 0.0, 1.0)
        turn = rotations.from_yaw(yaw)[:, None]
        world = rotations.multiply(turn, rotations.from_6d(y.joint_rotations))
        local = SPORT_SKELETON.local_rotations(world)
        origin = np.stack([root[:, 0], [m._ground for m in members], root[:, 1]], axis=-1)
        hips = features.to_world(y.joint_positions[:, 0], yaw) + origin
        shown_hips, shown_local = np.empty_like(hips), np.empty_like(local)
        for i, member in enumerate(members):
            local[i] = member._arms.apply(local[i], member._blend < 1.0)
            shown_hips[i], shown_local[i], contacts[i] = member._planted(hips[i], local[i], contacts[i])
        positions, world = SPORT_SKELETON.forward_kinematics(shown_hips, shown_local)
        height = self.terrain.height(root[:, 0], root[:, 1])
        arrays = (shown_hips, shown_local, positions, world, contacts, np.insert(root, 1, height, axis=1))
        rows = zip(*(a.astype(np.float32) for a in arrays), yaw.tolist(), strict=True)
        return [Pose(*row) for row in rows]

    def _feed_back(self, y: OutputParts, x: InputParts) -> None:
        members, root, yaw = self.members, x.root_position, x.root_yaw
        unlocked = [np.array(each) for each in zip(*(m._network_pose for m in members), strict=True)]
        positions, _ = SPORT_SKELETON.forward_kinematics(*unlocked)
        ground = np.array([m._ground for m in members])
        joints = features.relative_joints(positions, root, ground, yaw)
        phases = advance_phase(np.array([m._body.phase for m in members]), y.phase)
        velocity = features.to_world(y.root[:, :2], yaw)
        speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
        reach = 2.0 * speed[:, 0] * DT + HALF_BODY_M  # strides are scaled by less
        clear = level_ahead(self.terrain, root, velocity / np.maximum(speed, 1e-9), reach)
        for i, member in enumerate(members):
            body = member._body
            body.joints, body.velocities, body.phase = joints[i], y.joint_velocities[i], phases[i]
            member._keep_rhythm()
            velocity[i] = member._root_velocity(velocity[i], y.contacts[i], bool(clear[i]))
        next_yaw = (yaw + y.root[:, 2] * DT)[:, None]
        windows = self._windows()
        advance(
            *windows,
            velocity * DT,
            y.root[:, 2] * DT,
            features.to_world(y.trajectory_positions, next_yaw),
            features.to_world(y.trajectory_directions, next_yaw),
        )
        self._keep(windows)
