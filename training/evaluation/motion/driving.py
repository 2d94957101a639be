"""Generated motion: a character led along captured root paths, round a standard course, or by captured controls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.controls import Controls, Gait
from runtime.errors import SportError
from runtime.motion import features
from runtime.motion.control_scripts import LOOK_AHEAD_M, ControlScript, PlanarPose
from runtime.motion.controller import TEMPERATURE, Controller, Crowd
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel
from runtime.motion.trajectory import LENGTH, MAX_RESPONSE, PRESENT, Plan, Trajectory
from runtime.pose import Pose
from runtime.records import copied
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from training.data.labels import STAND_SPEED
from training.evaluation.metrics.motion import Motion
from training.frames import PAD, extrapolate, repeat_ends, root_motion, smooth

# simulated before the scored part, so that standing still and the start pose are over
LEAD_IN_FRAMES = 2 * FPS
STEADY_FRAMES = 3 * FPS  # on either side of a change of prompt
REQUEST_SIGMA = 15.0  # frames; a thumb does not follow the sway of every step
CORRECTION_PER_S = 1.0  # a player also steers back to where the clip went
MAX_CORRECTION = 0.5  # m/s
TOGETHER = 32  # characters of a crowd that are walked at once
_ORIGIN = PlanarPose(0.0, 0.0, 0.0)


def walk_together(members: Sequence[Controller], script: ControlScript, frames: int) -> list[list[Pose]]:
    """Poses of characters of one model and ground by one stick that looks at no place, in half of the time of each alone.

    SportError when the network fails.
    """
    made: list[list[Pose]] = []
    for first in range(0, len(members), TOGETHER):
        few = members[first : first + TOGETHER]
        crowd, poses = Crowd(few), []
        for frame in range(frames):
            poses.append(crowd.step(script(frame / FPS, _ORIGIN)))
            faults = [member.message for member in few if member.message]
            if faults:
                raise SportError(f"frame {frame}: {faults[0]}", "Try another seed or model.")
        crowd.close()
        made += map(list, zip(*poses, strict=True))
    return made


class Recorder:
    """Collects the poses of a controller, shown and before foot lock."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._poses: list[Pose] = []
        self._unlocked: list[tuple[Array, Array]] = []

    def step(self, controls: Controls) -> Pose:
        """One frame; SportError when the network fails."""
        return self.add(self._controller.step(controls))

    def add(self, pose: Pose) -> Pose:
        """A frame that the controller was moved by; SportError when the network failed."""
        if self._controller.message or not np.isfinite(pose.positions).all():
            problem = self._controller.message or "The pose is not finite."
            raise SportError(f"{self._controller.model.name}: {problem}", "Evaluate another model.")
        self._poses.append(pose)
        self._unlocked.append(self._controller.unlocked)
        return pose

    @property
    def frames(self) -> int:
        """How many were recorded."""
        return len(self._poses)

    def motion(self, name: str, style: str, gait: NDArray[np.integer], skip: int) -> Motion:
        """What was recorded after the first `skip` frames; `gait` `(frames - skip,)` are the requested labels."""
        poses = self._poses[skip:]
        hips, local = (np.stack(values) for values in zip(*self._unlocked[skip:], strict=True))
        return Motion(
            name,
            style,
            np.stack([p.hips_position for p in poses]),
            np.stack([p.local_rotations for p in poses]),
            np.stack([p.contacts for p in poses]),
            gait,
            self._controller.terrain,
            source="generated",
            unlocked=SPORT_SKELETON.forward_kinematics(hips, local)[0].astype(np.float32),
        )


@dataclass(frozen=True)
class Requests:
    """What a stick requests at every frame of a captured clip, the lead-in first."""

    xz: Array  # (N, 2) root path
    velocity: Array  # (N, 2) m/s
    yaw: Array  # (N,)
    gait: NDArray[np.integer]  # (N,)


def requests_of(clip: Motion, lead_in: int) -> Requests:
    """Smoothed root velocity, facing and gait of a clip; the lead-in goes on backwards at the first velocity."""
    xz, yaw = root_motion(clip.positions.astype(np.float64))
    velocity = smooth(np.gradient(xz, axis=0) * FPS, REQUEST_SIGMA)
    start = velocity[0] if clip.gait[0] != Gait.STAND else np.zeros(2)
    back = np.arange(lead_in, 0, -1)[:, None] / FPS

    return Requests(
        np.concatenate([xz[0] - back * start, xz]),
        np.concatenate([np.tile(start, (lead_in, 1)), velocity]),
        np.concatenate([np.full(lead_in, yaw[0]), yaw]),
        np.concatenate([np.full(lead_in, clip.gait[0]), clip.gait]),
    )


def follow(
    model: MotionModel, clip: Motion, z: Array, seed: int = 0, temperature: float = TEMPERATURE
) -> Motion:
    """The character in style Z^t `(6, 64)` led along a clip's root path, frame for frame as a player would.

    The stick asks for the clip's velocity at the same time and steers back to its path; it cannot ask for more than the
    style's own walking or jogging speed. Facing and gait are the clip's.
    """
    requests = requests_of(clip, LEAD_IN_FRAMES)
    # a captured velocity has a body's momentum already
    controller = Controller(model, clip.terrain, seed, temperature, response=MAX_RESPONSE)
    controller.set_style(z, 0.0)
    controller.reset(float(requests.xz[0, 0]), float(requests.xz[0, 1]), float(requests.yaw[0]))
    recorder = Recorder(controller)
    for frame in range(len(requests.xz)):
        recorder.step(_stick(requests, frame, controller))
    return recorder.motion(clip.name, clip.style, clip.gait, LEAD_IN_FRAMES)


def _stick(requests: Requests, frame: int, controller: Controller) -> Controls:
    gait = Gait(int(requests.gait[frame]))
    speed = float(np.linalg.norm(requests.velocity[frame]))
    facing = (float(np.sin(requests.yaw[frame])), float(np.cos(requests.yaw[frame])))
    if gait == Gait.STAND and speed < STAND_SPEED:  # in a frame labelled as standing the stick is let go
        return Controls((0.0, 0.0), facing, Gait.WALK)
    if gait in (Gait.STAND, Gait.OTHER):
        gait = Gait.WALK
    root = controller.pose.root_position
    away = CORRECTION_PER_S * (requests.xz[frame] - np.array([root[0], root[2]], np.float64))
    away *= min(1.0, MAX_CORRECTION / max(float(np.linalg.norm(away)), 1e-9))
    move = (requests.velocity[frame] + away) / controller.full_speed(gait)
    move /= max(1.0, float(np.linalg.norm(move)))
    return Controls((float(move[0]), float(move[1])), facing, gait)


class ReplayTrajectory(Trajectory):
    """Control variables t^p, t^d, t^g and t^h of a clip, not a stick's (Sec. IV-B2): each frame takes the clip's next window."""

    clip_xz: Array
    clip_yaw: Array
    clip_gait: Array
    number: int

    @staticmethod
    def of(clip: Motion, began: Trajectory) -> ReplayTrajectory:
        """From the clip's first frame on, in the place of the trajectory of a character that has just begun."""
        made = ReplayTrajectory(**vars(began))
        xz, yaw = root_motion(clip.positions.astype(np.float64))
        made.clip_xz, made.clip_yaw = extrapolate(xz), repeat_ends(yaw[:, None])[:, 0]
        made.clip_gait = repeat_ends(np.eye(features.GAITS)[clip.gait])
        made.number = 0
        return made

    def steer(self, plan: Plan) -> None:
        """The clip's window; what is requested does not count."""
        first = self.number + PAD - PRESENT
        now = slice(first, first + LENGTH)
        self.xz, self.yaw = self.clip_xz[None, now].copy(), self.clip_yaw[None, now].copy()
        self.gait = self.clip_gait[None, now].copy()
        self.number += 1


def replay(model: MotionModel, clip: Motion, z: Array, seed: int, temperature: float, lead_in: int) -> Array:
    """Joints relative to the root `(T - lead_in, 31, 3)` under a clip's own controls.

    The first `lead_in` frames are run at temperature 0: two runs that differ in their seed begin in the same pose.
    """
    controller = Controller(model, clip.terrain, seed, 0.0)
    controller.set_style(z, 0.0)
    state = copied(controller.state)
    state.trajectory = ReplayTrajectory.of(clip, state.trajectory)
    controller.put(state, state.styles[0].codes)
    joints = []
    for frame in range(len(clip)):
        if frame == lead_in:
            controller.temperature = temperature
        pose = controller.step(Controls())
        if frame >= lead_in:
            root, ground = pose.root_position[[0, 2]], pose.root_position[1]
            joints.append(features.relative_joints(pose.positions, root, ground, np.array(pose.root_yaw)))
    return np.stack(joints)


def transitions(model: MotionModel, changes: Sequence[tuple[Array, Array]], seed: int) -> list[Array]:
    """World joints `(T, 31, 3)` of straight walks whose Z^t `(6, 64)` changes at frame `STEADY_FRAMES`.

    The blend takes a second, as the viewer's does; three seconds of walking lie around it.
    """
    ground = flat_ground()
    members = [Controller(model, ground, seed + k) for k in range(len(changes))]
    walked: list[list[Pose]] = [[] for _ in members]
    for number, frames, blend in ((0, LEAD_IN_FRAMES + STEADY_FRAMES, 0.0), (1, STEADY_FRAMES, 1.0)):
        for member, codes in zip(members, changes, strict=True):
            member.set_style(codes[number], blend)
        for poses, more in zip(walked, walk_together(members, _straight_on, frames), strict=True):
            poses += more
    return [np.stack([pose.positions for pose in poses[LEAD_IN_FRAMES:]]) for poses in walked]


def _straight_on(seconds: float, place: PlanarPose) -> Controls:
    return Controls((0.0, 1.0))


def flat_ground() -> Terrain:
    """Level ground that no course leaves."""
    return Terrain.flat(size_m=400.0, cell_m=10.0)


RADIUS_M, WAVE_M, WAVES = 8.0, 1.2, 3  # beyond the level start of every terrain, within its 40 m
POINTS = 1200


def ring() -> Array:
    """Points `(1200, 2)` of the closed course, metres."""
    angle = np.linspace(0.0, 2.0 * np.pi, POINTS, endpoint=False)
    radius = RADIUS_M + WAVE_M * np.sin(WAVES * angle)
    return np.stack([radius * np.sin(angle), radius * np.cos(angle)], axis=-1)


@dataclass(frozen=True)
class RingRun:
    """What came of leading a character along the ring."""

    motion: Motion
    path_error: Array  # (T,) metres from the root to the nearest point of the course
    requested_speed: Array  # (T,) m/s


def path_error(xz: Array, course: Array) -> Array:
    """Distance `(T,)` in metres of root positions `(T, 2)` to the closed polygon `course` `(N, 2)`."""
    begin, along = course, np.roll(course, -1, axis=0) - course
    offset = xz[:, None] - begin
    t = (offset * along).sum(-1) / np.square(along).sum(-1)
    nearest = begin + np.clip(t, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(xz[:, None] - nearest, axis=-1).min(1)


@dataclass(frozen=True)
class RingWalk:
    """Who is led along the ring; the seed also chooses where it begins."""

    style: str
    code: Array  # Z^t
    gait: Gait
    seed: int


def run_ring(
    model: MotionModel, terrain: Terrain, walks: Sequence[RingWalk], seconds: float
) -> list[RingRun]:
    """Full stick along the ring, each pointed at the place 0.9 m ahead; they do not meet.

    The first 2 s, from standing, are not scored.
    """
    made: list[RingRun] = []
    for first in range(0, len(walks), TOGETHER):
        made += _run_together(model, terrain, walks[first : first + TOGETHER], seconds)
    return made


def _run_together(
    model: MotionModel, terrain: Terrain, walks: Sequence[RingWalk], seconds: float
) -> list[RingRun]:
    course = ring()
    places = [int(np.random.default_rng(walk.seed).integers(POINTS)) for walk in walks]
    members = [
        _placed(Controller(model, terrain, walk.seed), walk.code, course, place)
        for walk, place in zip(walks, places, strict=True)
    ]
    recorders, crowd = [Recorder(member) for member in members], Crowd(members)
    roots, speeds = [], []
    for _ in range(LEAD_IN_FRAMES + round(seconds * FPS)):
        here = [member.pose.root_position[[0, 2]].astype(np.float64) for member in members]
        places = [_nearest(course, root, place) for root, place in zip(here, places, strict=True)]
        sticks = [
            Controls(_towards(course, root, place), gait=walk.gait)
            for root, place, walk in zip(here, places, walks, strict=True)
        ]
        poses = crowd.step(sticks)
        for recorder, pose in zip(recorders, poses, strict=True):
            recorder.add(pose)
        roots.append([pose.root_position[[0, 2]] for pose in poses])
        speeds.append([member.requested_speed for member in members])
    crowd.close()
    scored = np.array(roots[LEAD_IN_FRAMES:], np.float64), np.array(speeds[LEAD_IN_FRAMES:])
    made = []
    for k, (walk, recorder) in enumerate(zip(walks, recorders, strict=True)):
        name = f"{walk.style} {walk.gait.label} {terrain.name}"
        labels = np.full(len(scored[0]), int(walk.gait))
        motion = recorder.motion(name, walk.style, labels, LEAD_IN_FRAMES)
        made.append(RingRun(motion, path_error(scored[0][:, k], course), scored[1][:, k]))
    return made


def _placed(member: Controller, code: Array, course: Array, place: int) -> Controller:
    """The controller on a point of the course, facing along it."""
    member.set_style(code, 0.0)
    heading = course[(place + 5) % POINTS] - course[place]
    x, z = (float(v) for v in course[place])
    member.reset(x, z, float(np.arctan2(*heading)))
    return member


def _nearest(course: Array, root: Array, last: int) -> int:
    """The nearest point among those ahead of the last one: the ring is never cut short."""
    ahead = (last + np.arange(-5, POINTS // 12)) % POINTS
    return int(ahead[np.argmin(np.square(course[ahead] - root).sum(-1))])


def _towards(course: Array, root: Array, place: int) -> tuple[float, float]:
    spacing = float(np.linalg.norm(course[(place + 1) % POINTS] - course[place]))
    target = course[(place + max(1, round(LOOK_AHEAD_M / spacing))) % POINTS]
    x, z = (target - root) / max(float(np.linalg.norm(target - root)), 1e-6)
    return float(x), float(z)
