"""The character: turns controls and a style into one pose per 1/60 s (DESIGN of one frame: see docs/architecture.md)."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.controls import Controls, Gait
from runtime.crossing.crossing import Crossing
from runtime.errors import UsageError
from runtime.feet.foot_lock import FootLock
from runtime.motion import features
from runtime.motion.body import Body
from runtime.motion.features import FPS, GAITS, InputParts, split_output
from runtime.motion.inertialization import Inertialization
from runtime.motion.model import MotionModel, Style
from runtime.motion.noise import DriftingNoise
from runtime.motion.phase import advance_phase
from runtime.motion.rest_rhythm import RestRhythm
from runtime.motion.speed_regulator import SpeedRegulator
from runtime.motion.stall import CYCLES_PER_SECOND, Stall, advance_by_cycles
from runtime.motion.stride import Stride
from runtime.motion.style_mix import StyleFolder, StyleMix, mixed
from runtime.motion.trajectory import PRESENT, Trajectory, TrajectoryView, decay
from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacles import within_steps

Array = NDArray[np.floating]
log = logging.getLogger("sport.controller")

DT = 1.0 / FPS
TEMPERATURE = 0.7  # of the sampler: livelier than its mean, nearer to the capture than 1 (docs/model.md)
STAND_SPEED = 0.12  # m/s; slower requests mean standing
MIN_GAIT_SPEED = 0.3  # m/s; slower, feet may well rest for a while
CROUCH_SPEED = 0.8  # m/s at full stick
JUMP_SECONDS = 0.7
# what the regulator leaves of a difference in speed is taken up by longer or shorter strides, this much at most
STRIDE_WARP = (0.65, 1.25)
SETTLE_SECONDS = 2.0
FASTEST_LIFT = 3.0  # m/s of the ground that the body is placed over: jogging up a wall of 1 m takes 2.5
SPEED_HALF_LIFE = 0.25  # seconds, smoothing of the measured speed (a stride speeds up and slows down)


def _check(**numbers: float) -> None:
    """UsageError for a number that would make all later poses none."""
    for name, value in numbers.items():
        if not np.isfinite(value):
            raise UsageError(f"Controller: {name} {value}: expected a finite number.", "Give a number.")


class Controller:
    """Deterministic: the same model, seed, controls, terrain and styles give the same poses.

    UsageError for numbers that are not finite and a seed below 0.
    """

    def __init__(
        self,
        model: MotionModel,
        terrain: Terrain,
        seed: int = 0,
        temperature: float = TEMPERATURE,
        strength: float = 1.0,
    ) -> None:
        _check(temperature=temperature, strength=strength)
        if seed < 0:
            raise UsageError(f"Controller: seed {seed}: expected 0 or more.", "Choose another seed.")
        self.model = model
        self._folder = StyleFolder(model.fold_style, strength)
        self.terrain = terrain
        self.temperature = temperature
        self.seed = seed
        self.foot_lock_enabled = True
        self.message = ""  # the network's fault in this frame, for the status line
        self._foot_lock = FootLock(SPORT_SKELETON)
        self._stall = Stall()
        self._stride = Stride()
        self._rest = RestRhythm()
        self._regulator = SpeedRegulator()
        self._arms = Inertialization()
        self._crossing = Crossing()
        self._to: Array | StyleMix = model.neutral
        self._style = self._from_style = self._to_style = self._folder.fold(self._to)
        self._blend, self._blend_seconds = 1.0, 0.0
        self.requested_speed = 0.0
        self.reset()

    def reset(self, x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Pose:
        """Stand at x, z (metres) facing `yaw` (radians)."""
        _check(x=x, z=z, yaw=yaw)
        start = self.model.metadata["start"]
        y = split_output(np.array(start["output"], np.float64))
        self._body = Body.standing(y.joint_positions, np.array(start["phase"], np.float64))
        self._trajectory = Trajectory(float(x), float(z), float(yaw))
        self._noise = DriftingNoise((1, *self.model.noise_shape), self.seed)
        self._jump_left = 0.0
        self._measured_speed = 0.0  # smoothed over a stride
        self._root_speed = 0.0
        self._regulator.reset()
        self._foot_lock.reset()
        self._stall.reset()
        self._stride.reset()
        self._rest.reset()
        self._arms.reset()
        self._crossing.reset()
        self._ground = float(self.terrain.height(x, z))
        self.pose = self._pose(y, np.zeros(4))
        return self.pose

    def set_style(self, style: Array | StyleMix, transition_seconds: float = 1.0) -> None:
        """Blend to Z^t `(6, 64)` or a mix of codes over the given time, starting with the next frame.

        ModelError where a code does not fit the model; the style stays as it was.
        """
        _check(transition_seconds=transition_seconds)
        folded = self._folder.fold(style)
        self._to, self._from_style, self._to_style = style, self._style, folded
        self._blend, self._blend_seconds = 0.0, float(transition_seconds)
        if transition_seconds <= 0:
            self._style, self._blend = folded, 1.0

    def twin(self) -> Controller:
        """Another character of the same model, at the start of the same ground: to make a take again beside this one."""
        return Controller(self.model, self.terrain, self.seed, self.temperature, self.strength)

    @property
    def strength(self) -> float:
        """How far styles go from neutral walking: 0 is neutral, 1 as the model shows them, more exaggerates."""
        return self._folder.strength

    @strength.setter
    def strength(self, value: float) -> None:
        _check(strength=value)
        if value == self.strength:  # asked for in every frame: a blend under way goes on as it is
            return
        self._folder = StyleFolder(self.model.fold_style, value)
        self._to_style = self._folder.fold(self._to)
        if self._blend < 1.0:
            self._from_style = self._folder.fold(self._from_style.z)
        self._mix_styles()

    def settle(self, gait: Gait = Gait.WALK, seconds: float = SETTLE_SECONDS) -> Pose:
        """Come to rest in the present style, in place, in frames that nobody sees; returns the pose to begin from.

        A character begins in neutral standing, and the network is in a style some frames later, with hands that fly
        there. In `Gait.CROUCH` it comes to rest crouched.
        """
        root, yaw = self.pose.root_position, self.pose.root_yaw
        rest = Controls(facing=(float(np.sin(yaw)), float(np.cos(yaw))), gait=gait)
        for _ in range(round(seconds * FPS)):
            self.step(rest)
        labels = self._trajectory.gait
        self._trajectory = Trajectory(float(root[0]), float(root[2]), yaw)
        self._trajectory.gait[:] = labels
        self._foot_lock.reset()
        return self.pose

    def set_terrain(self, terrain: Terrain) -> None:
        """Stand on another ground; the character stays where it is in X and Z, and crosses nothing."""
        self.terrain = terrain
        self._ground = float(terrain.height(*self._trajectory.here))
        self._crossing.reset()
        self._foot_lock.reset()

    @property
    def style(self) -> Style:
        """The style of this frame (a blend during a transition)."""
        return self._style

    def full_speed(self, gait: Gait) -> float:
        """What a full stick asks for in the present style, m/s."""
        speeds = {Gait.JOG: self._style.jog_speed, Gait.CROUCH: CROUCH_SPEED}
        return speeds.get(gait, self._style.walk_speed)

    @property
    def unlocked(self) -> tuple[Array, Array]:
        """Hips `(3,)` and local rotations `(31, 4)` before foot lock: the network's, arms inertialised in a blend, or keyed."""
        return self._unlocked

    @property
    def blocked(self) -> str | None:
        """Why the character does not go on, for the status line."""
        return self._crossing.reason

    @property
    def crossing(self) -> str:
        """What is being crossed by keyed motion: "bar", "gap", "up", "down", "climb", "descend"; else ""."""
        return self._crossing.kind

    @property
    def trajectory(self) -> TrajectoryView:
        """The 12 samples, laid on the terrain."""
        return self._trajectory.view(self.terrain)

    def step(self, controls: Controls) -> Pose:
        """Simulate 1/60 s. A fault of the network sets the character back to standing, and `message` for this frame."""
        self.message = ""
        self._advance_style()
        self._steer(controls)
        x, ground = self._input()
        y_flat, _ = self.model.step(x[None], self._next_noise(), self._style)
        if not np.all(np.isfinite(y_flat)):
            return self._set_back()
        y = split_output(y_flat[0].astype(np.float64))
        self._ground = ground
        self.pose = self._pose(y, np.clip(y.contacts, 0.0, 1.0))
        self._cross()
        self._feed_back(y)
        return self.pose

    def _set_back(self) -> Pose:
        """Stand again after a fault of the network."""
        self.message = "The motion network gave values that are not finite; the character was reset."
        log.error(self.message)
        root = self.pose.root_position
        return self.reset(float(root[0]), float(root[2]), self.pose.root_yaw)

    def _advance_style(self) -> None:
        if self._blend < 1.0:
            self._blend = min(1.0, self._blend + DT / self._blend_seconds)
            self._mix_styles()

    def _mix_styles(self) -> None:
        t = self._blend * self._blend * (3 - 2 * self._blend)
        ends = (self._from_style, self._to_style)
        self._style = self._to_style if t >= 1.0 else mixed(ends, (1.0 - t, t))

    def _steer(self, controls: Controls) -> None:
        self._trajectory.steer(*self._asked(controls))

    def _asked(self, controls: Controls, clear: bool = False) -> tuple[Array, float | None, Array]:
        """Velocity (m/s), facing (radians or None) and one-hot gait; `clear` where no step is known to lie ahead."""
        move: Array = np.array(controls.move, np.float64)
        amount = float(np.linalg.norm(move))
        if amount > 1.0:
            move, amount = move / amount, 1.0
        speed = self.full_speed(controls.gait)
        velocity: Array = move * speed
        if self._stopped(velocity, clear):
            velocity, amount = np.zeros(2), 0.0
        self.requested_speed = amount * speed
        moving = self.requested_speed > STAND_SPEED
        if moving:
            velocity *= self._regulator.update(self.requested_speed, self._root_speed * self._stride.share)
        else:
            velocity = np.zeros(2)
            self._regulator.reset()
        gait = controls.gait
        if gait == Gait.JUMP:
            self._jump_left = JUMP_SECONDS
        if self._jump_left > 0:
            self._jump_left -= DT
            gait = Gait.JUMP
        elif not moving and gait != Gait.CROUCH:
            gait = Gait.STAND
        one_hot = np.zeros(GAITS)
        one_hot[gait] = 1.0
        facing = None
        if self._crossing.facing is not None:
            facing = self._crossing.facing
        elif controls.facing is not None:
            facing = float(np.arctan2(*controls.facing))
        elif moving:
            facing = float(np.arctan2(*velocity))
        return velocity, facing, one_hot

    def _stopped(self, velocity: Array, clear: bool) -> bool:
        """Whether the root does not follow the stick: before ground that nobody can walk on, and while it climbs."""
        level = clear or self._foot_lock.on_beam  # a glance beside a beam would see a drop
        ground = None if level else self.terrain
        return self._crossing.look(ground, self._trajectory.here, velocity, self._measured_speed)

    def _input(self) -> tuple[Array, float]:
        t = self._trajectory
        index = t.samples
        positions, directions = t.xz[index], t.directions[index]
        points = features.height_points(positions, directions)
        ground = self.terrain.height(points[..., 0], points[..., 1]).astype(np.float64)
        heights = within_steps(ground, features.L // 2)
        heights = self._crossing.seen(points, heights, features.L // 2)
        parts = InputParts(
            root_position=t.xz[PRESENT],
            root_yaw=t.yaw[PRESENT],
            trajectory_positions=positions,
            trajectory_directions=directions,
            heights=heights,
            gait=t.gait[index],
            phase=self._body.phase[features.PHASE_OFFSETS + PRESENT],
            joint_positions=self._body.joints,
            joint_velocities=self._body.velocities,
        )
        return features.build_input(parts), self._lifted(float(features.ground_height(heights)))

    def _lifted(self, ground: float) -> float:
        """Reference ground (m) of this frame: on ground that can be walked on `ground`, and never far from the last."""
        most = FASTEST_LIFT * DT
        return min(max(ground, self._ground - most), self._ground + most)

    def _next_noise(self) -> Array:
        noise = self._noise.step(DT)
        return np.float32(max(self.temperature, 0.0)) * noise

    def _pose(self, y: features.OutputParts, contacts: Array) -> Pose:
        t = self._trajectory
        yaw, xz = t.yaw[PRESENT], t.xz[PRESENT]
        turn = rotations.from_yaw(yaw)
        world = rotations.multiply(turn, rotations.from_6d(y.joint_rotations))
        local = SPORT_SKELETON.local_rotations(world)
        hips = features.to_world(y.joint_positions[0], yaw) + np.array([xz[0], self._ground, xz[1]])
        local = self._arms.apply(local, self._blend < 1.0)
        hips, local, contacts = self._planted(hips, local, contacts)
        positions, world = SPORT_SKELETON.forward_kinematics(hips, np.asarray(local))
        root = np.array([xz[0], float(self.terrain.height(xz[0], xz[1])), xz[1]], np.float32)
        return Pose(
            np.asarray(hips, np.float32),
            np.asarray(local, np.float32),
            positions.astype(np.float32),
            world.astype(np.float32),
            np.asarray(contacts, np.float32),
            root,
            float(yaw),
        )

    def _planted(self, hips: Array, local: Array, contacts: Array) -> tuple[Array, Array, Array]:
        """Hips, local rotations and contacts to show for the network's: crossing an obstacle, or with planted feet."""
        self._network_pose = self._unlocked = (hips, local)
        if self._crossing.kind:
            hips, local, contacts = self._crossing.apply(hips, local, self._ground, self.pose, self.terrain)
            self._unlocked = (hips, local)
        elif self.foot_lock_enabled:
            locked = self._foot_lock.apply(hips, local, contacts, self.terrain, DT)
            hips, local = locked.hips_position, locked.local_rotations
        return hips, local, contacts

    def _cross(self) -> None:
        """End a crossing, or begin one from the pose just shown."""
        if self._crossing.kind:
            if self._crossing.ends():
                self._foot_lock.take_over(self._unlocked, self._network_pose)
            return
        held = self._foot_lock.held if self.foot_lock_enabled else tuple(self.pose.contacts[[1, 3]] > 0.5)
        ground = float(self.pose.root_position[1])
        self._crossing.watch(self.pose, held, ground, self._measured_speed, self._style.walk_speed)

    def _feed_back(self, y: features.OutputParts) -> None:
        """Next frame's state: the network's own pose on the fixed skeleton, before foot lock.

        Poses after foot lock were tried by none of the training data; the network would drift away on them. Arms that
        are held back while styles blend are fed back as they are shown, so that it goes on from where they are.
        """
        t, body = self._trajectory, self._body
        yaw = t.yaw[PRESENT]
        positions, _ = SPORT_SKELETON.forward_kinematics(*self._network_pose)
        body.joints = features.relative_joints(
            positions, t.xz[PRESENT], np.array(self._ground), np.array(yaw)
        )
        body.velocities = y.joint_velocities
        body.phase = advance_phase(body.phase, y.phase)
        self._keep_rhythm()
        velocity = self._root_velocity(features.to_world(y.root[:2], yaw), y.contacts)
        next_yaw = yaw + y.root[2] * DT
        t.advance(
            velocity * DT,
            float(y.root[2] * DT),
            features.to_world(y.trajectory_positions, next_yaw),
            features.to_world(y.trajectory_directions, next_yaw),
        )

    def _keep_rhythm(self) -> None:
        if self._stall.update(self._body.joints, self._gait_speed()):
            self._body.phase = advance_by_cycles(self._body.phase, CYCLES_PER_SECOND * DT)
        standing = float(self._trajectory.gait[PRESENT, Gait.STAND])
        self._body.phase = self._rest.apply(self._body.phase, self._style.rest, standing)

    def _root_velocity(self, velocity: Array, contacts: Array, clear: bool = False) -> Array:
        """The velocity (m/s) that the root takes of the network's; `clear` where no step is known to lie ahead."""
        standing = float(self._trajectory.gait[PRESENT, Gait.STAND])
        velocity = (velocity + self._foot_lock.pull) * (1.0 - standing**4)  # at rest nobody creeps
        self._root_speed = float(np.linalg.norm(velocity))
        self._measured_speed += (self._root_speed - self._measured_speed) * (1 - decay(SPEED_HALF_LIFE))
        self._stride.update(self._body.joints, contacts, self._measured_speed)
        if self._crossing.kind:
            return self._crossing.root_velocity()
        velocity = velocity * self._stride_warp() * self._crossing.pace
        return velocity if clear else self._crossing.held_back(self.terrain, self._trajectory.here, velocity)

    def _gait_speed(self) -> float:
        """The speed at which feet should be stepping, m/s: 0 at rest, in a jump, and while the root has not set off."""
        travels = self._measured_speed > 0.5 * self.requested_speed and self._jump_left <= 0
        return self.requested_speed if travels and self.requested_speed > MIN_GAIT_SPEED else 0.0

    def _stride_warp(self) -> float:
        """Scale of the root's displacement towards the requested speed; the foot lock keeps the feet planted."""
        walks = self._measured_speed > 0.5 * self.requested_speed > 0.5 * STAND_SPEED
        return float(np.clip(self.requested_speed / self._measured_speed, *STRIDE_WARP)) if walks else 1.0
