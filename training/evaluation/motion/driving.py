"""Generated motion: characters follow captured root paths, a standard course, or captured control variables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

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
from runtime.motion.style import StyleMix
from runtime.motion.trajectory import LENGTH, MAX_RESPONSE, PRESENT, Plan, Trajectory
from runtime.pose import Pose
from runtime.records import copied
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from training.data.labels import STAND_SPEED
from training.evaluation.metrics.motion import Motion
from training.frames import PAD, RootPath, repeat_ends, root_motion, smooth

# simulated before the scored part, to leave out standing and the start pose
LEAD_IN_FRAMES = 2 * FPS
STEADY_FRAMES = 3 * FPS  # on either side of a change of prompt
REQUEST_SIGMA_FRAMES = 15.0  # a thumb does not follow the sway of every step
CORRECTION_PER_S = 1.0  # a player also steers back to the clip's path
MAX_CORRECTION_M_PER_S = 0.5
TOGETHER = 32  # characters simulated in one batch
FORWARD = Controls((0.0, 1.0))
_ORIGIN = PlanarPose(0.0, 0.0, 0.0)
Stick = Callable[[Controller, int], Controls]  # controls of a character in a frame


class Track:
    """Recorded frames of a character, displayed and before foot lock, and its requested speed."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.poses: list[Pose] = []
        self._unlocked: list[tuple[Array, Array]] = []
        self.requested_speed: list[float] = []  # m/s
        self.keyed: list[bool] = []  # whether keyframed motion was active

    def __len__(self) -> int:
        return len(self.poses)

    def add(self, pose: Pose) -> None:
        """Record the controller's last frame; SportError if the network failed in it."""
        controller = self._controller
        if controller.message or not np.isfinite(pose.positions).all():
            problem = controller.message or "The pose is not finite."
            raise SportError(f"{controller.model.name}: {problem}", "Evaluate another model.")
        self.poses.append(pose)
        self._unlocked.append(controller.unlocked)
        self.requested_speed.append(controller.requested_speed)
        self.keyed.append(bool(controller.traversal))

    @property
    def root(self) -> Array:
        """Return root positions `(T, 2)`, metres."""
        return np.stack([pose.root_position[[0, 2]] for pose in self.poses])

    def shown(self, skip: int = 0) -> tuple[Array, Array, Array]:
        """Return hips `(T, 3)`, local rotations `(T, 31, 4)` and contacts `(T, 4)` after the first `skip` frames."""
        poses = self.poses[skip:]
        return (
            np.stack([pose.hips_position for pose in poses]),
            np.stack([pose.local_rotations for pose in poses]),
            np.stack([pose.contacts for pose in poses]),
        )

    def motion(self, name: str, style: str, gait: Gait | NDArray[np.integer], skip: int = 0) -> Motion:
        """Return the motion after the first `skip` frames; `gait` is the requested label, or labels `(frames - skip,)`."""
        unlocked_hips, unlocked = (np.stack(values) for values in zip(*self._unlocked[skip:], strict=True))
        return Motion(
            name,
            style,
            *self.shown(skip),
            np.full(len(self) - skip, int(gait)) if isinstance(gait, Gait) else gait,
            self._controller.terrain,
            source="generated",
            unlocked=SPORT_SKELETON.forward_kinematics(unlocked_hips, unlocked)[0].astype(np.float32),
        )


def characters(
    model: MotionModel,
    ground: Terrain,
    codes: Sequence[Array | StyleMix],
    seeds: Sequence[int] = (),
    **settings: float,
) -> list[Controller]:
    """Create characters at the start, each in a style Z^t `(6, 64)`; seeds default to 0."""
    members = [Controller(model, ground, seed, **settings) for seed in seeds or [0] * len(codes)]
    for member, code in zip(members, codes, strict=True):
        member.set_style(code, 0.0)
    return members


def walked(
    members: Sequence[Controller],
    sticks: Stick | Sequence[Stick],
    frames: int | Sequence[int],
    until: Callable[[Controller], bool] = lambda member: False,
) -> list[Track]:
    """Simulate characters of one model in batches, with shared or individual sticks; returns their tracks.

    They end after `frames`, shared or individual, or when `until` is true for all in a batch, which are those on the same
    ground. Batches halve the time. SportError if the network fails.
    """
    own = [sticks] * len(members) if callable(sticks) else sticks
    lengths = [frames] * len(members) if isinstance(frames, int) else frames
    walkers = list(zip(members, own, map(Track, members), lengths, strict=True))
    grounds = {id(member.terrain): member.terrain for member in members}
    for ground in grounds.values():
        here = [walker for walker in walkers if walker[0].terrain is ground]
        for first in range(0, len(here), TOGETHER):
            _walk(here[first : first + TOGETHER], until)
    return [track for _, _, track, _ in walkers]


def _walk(
    walkers: Sequence[tuple[Controller, Stick, Track, int]], until: Callable[[Controller], bool]
) -> None:
    members = [member for member, *_ in walkers]
    crowd = Crowd(members) if len(members) > 1 else None
    for frame in range(max(length for *_, length in walkers)):
        asked = [stick(member, frame) for member, stick, *_ in walkers]
        poses = [members[0].step(asked[0])] if crowd is None else crowd.step(asked)
        for (_, _, track, length), pose in zip(walkers, poses, strict=True):
            if frame < length:
                track.add(pose)
        if all(map(until, members)):
            break
    if crowd is not None:
        crowd.close()


def walk_together(members: Sequence[Controller], script: ControlScript, frames: int) -> list[list[Pose]]:
    """Simulate characters with one script that ignores positions; returns their poses."""
    return [t.poses for t in walked(members, lambda _, frame: script(frame / FPS, _ORIGIN), frames)]


@dataclass(frozen=True)
class Requests:
    """Stick requests at every frame of a captured clip, after a lead-in."""

    xz: Array  # (N, 2) root path
    velocity: Array  # (N, 2) m/s
    yaw: Array  # (N,)
    gait: NDArray[np.integer]  # (N,)


def requests_of(clip: Motion, lead_in: int) -> Requests:
    """Return smoothed root velocity, facing and gait of a clip; the lead-in extrapolates backwards at the first velocity."""
    xz, yaw = root_motion(clip.positions.astype(np.float64))
    velocity = smooth(np.gradient(xz, axis=0) * FPS, REQUEST_SIGMA_FRAMES)
    start = velocity[0] if clip.gait[0] != Gait.STAND else np.zeros(2)
    back = np.arange(lead_in, 0, -1)[:, None] / FPS

    return Requests(
        np.concatenate([xz[0] - back * start, xz]),
        np.concatenate([np.tile(start, (lead_in, 1)), velocity]),
        np.concatenate([np.full(lead_in, yaw[0]), yaw]),
        np.concatenate([np.full(lead_in, clip.gait[0]), clip.gait]),
    )


@dataclass(frozen=True)
class Take:
    """A clip for a character to follow, and its style Z^t `(6, 64)`."""

    clip: Motion
    code: Array
    seed: int = 0

    def begun(self, model: MotionModel, **settings: float) -> Controller:
        """Create the character at the start, on the clip's ground; level clips share one ground."""
        ground = self.clip.terrain if self.clip.terrain.heights.any() else flat_ground()
        (member,) = characters(model, ground, [self.code], [self.seed], **settings)
        return member


def follow(model: MotionModel, takes: Sequence[Take], temperature: float = TEMPERATURE) -> list[Motion]:
    """Let characters follow their clips' root paths frame by frame, as a player would; returns their motions.

    The stick requests the clip's velocity at the same time plus a correction towards its path, limited to the style's own
    walking or jogging speed. Facing and gait are the clip's.
    """
    requests = [requests_of(take.clip, LEAD_IN_FRAMES) for take in takes]
    # captured velocities include the inertia of a body already
    settings = {"temperature": temperature, "response": MAX_RESPONSE}
    members = [take.begun(model, **settings) for take in takes]
    for member, asked in zip(members, requests, strict=True):
        member.reset(float(asked.xz[0, 0]), float(asked.xz[0, 1]), float(asked.yaw[0]))
    sticks = [partial(_stick, asked) for asked in requests]
    tracks = walked(members, sticks, [len(asked.xz) for asked in requests])
    pairs = zip(tracks, takes, strict=True)
    return [t.motion(take.clip.name, take.clip.style, take.clip.gait, LEAD_IN_FRAMES) for t, take in pairs]


def _stick(requests: Requests, controller: Controller, frame: int) -> Controls:
    frame = min(frame, len(requests.xz) - 1)  # the last request is kept for longer paths of the batch
    gait = Gait(int(requests.gait[frame]))
    speed = float(np.linalg.norm(requests.velocity[frame]))
    facing = (float(np.sin(requests.yaw[frame])), float(np.cos(requests.yaw[frame])))
    if gait == Gait.STAND and speed < STAND_SPEED:  # the stick is released in frames labelled as standing
        return Controls((0.0, 0.0), facing, Gait.WALK)
    if gait in (Gait.STAND, Gait.OTHER):
        gait = Gait.WALK
    root = controller.pose.root_position
    away = CORRECTION_PER_S * (requests.xz[frame] - np.array([root[0], root[2]], np.float64))
    away *= min(1.0, MAX_CORRECTION_M_PER_S / max(float(np.linalg.norm(away)), 1e-9))
    move = (requests.velocity[frame] + away) / controller.full_speed(gait)
    move /= max(1.0, float(np.linalg.norm(move)))
    return Controls((float(move[0]), float(move[1])), facing, gait)


class ReplayTrajectory(Trajectory):
    """Control variables t^p, t^d, t^g and t^h from a clip instead of a stick (Sec. IV-B2): its next window in each frame."""

    clip_xz: Array  # (B, N, 2) for B characters
    clip_yaw: Array  # (B, N)
    clip_gait: Array  # (B, N, 6)
    number: NDArray[np.intp]  # (B,) index of the next frame

    @staticmethod
    def of(clip: Motion, began: Trajectory) -> ReplayTrajectory:
        """Start at the clip's first frame, replacing the trajectory of a new character."""
        made, path = ReplayTrajectory(**vars(began)), RootPath.of(clip.positions.astype(np.float64))
        made.clip_xz, made.clip_yaw = path.padded_root[None], path.padded_yaw[None]
        made.clip_gait = repeat_ends(np.eye(features.GAITS)[clip.gait])[None]
        made.number = np.zeros(1, np.intp)
        return made

    def steer(self, plan: Plan) -> None:
        """Use the clip's window and ignore the request."""
        rows = np.arange(len(self.number))[:, None]
        now = (self.number + PAD - PRESENT)[:, None] + np.arange(LENGTH)
        self.xz, self.yaw, self.gait = (
            self.clip_xz[rows, now],
            self.clip_yaw[rows, now],
            self.clip_gait[rows, now],
        )
        self.number = self.number + 1


def replay(
    model: MotionModel, takes: Sequence[Take], temperature: float = 0.0, lead_in: int = 0
) -> list[Array]:
    """Return root-relative joints `(T - lead_in, 31, 3)` generated with each clip's controls; all clips have `T` frames.

    The first `lead_in` frames have temperature 0, so that takes that differ in their seed start in the same pose.
    """
    members = [take.begun(model, temperature=0.0) for take in takes]
    for member, take in zip(members, takes, strict=True):
        state = copied(member.state)
        state.trajectory = ReplayTrajectory.of(take.clip, state.trajectory)
        member.put(state, state.styles[0].codes)

    def stick(member: Controller, frame: int) -> Controls:
        if frame == lead_in:
            member.temperature = temperature
        return Controls()

    tracks = walked(members, stick, [len(take.clip) for take in takes])
    return [np.stack([_relative_joints(pose) for pose in track.poses[lead_in:]]) for track in tracks]


def _relative_joints(pose: Pose) -> Array:
    root, ground = pose.root_position[[0, 2]], pose.root_position[1]
    return features.relative_joints(pose.positions, root, ground, np.array(pose.root_yaw))


def transitions(model: MotionModel, changes: Sequence[tuple[Array, Array]], seed: int) -> list[Array]:
    """Generate straight walks whose Z^t `(6, 64)` changes at frame `STEADY_FRAMES`; returns world joints `(T, 31, 3)`.

    The blend lasts a second, as in the viewer, with three seconds of walking before and after.
    """
    before, after = zip(*changes, strict=True)
    members = characters(model, flat_ground(), before, range(seed, seed + len(changes)))
    shown = walk_together(members, lambda *_: FORWARD, LEAD_IN_FRAMES + STEADY_FRAMES)
    for member, code in zip(members, after, strict=True):
        member.set_style(code, 1.0)
    ends = walk_together(members, lambda *_: FORWARD, STEADY_FRAMES)
    pairs = zip(shown, ends, strict=True)
    return [np.stack([pose.positions for pose in [*a[LEAD_IN_FRAMES:], *b]]) for a, b in pairs]


@cache
def flat_ground() -> Terrain:
    """Return level ground that contains all courses."""
    return Terrain.flat(size_m=400.0, cell_m=10.0)


RADIUS_M, WAVE_M, WAVES = 8.0, 1.2, 3  # outside the level start of every terrain, within its 40 m
POINTS = 1200


def ring() -> Array:
    """Return points `(1200, 2)` of the closed course, metres."""
    angle = np.linspace(0.0, 2.0 * np.pi, POINTS, endpoint=False)
    radius = RADIUS_M + WAVE_M * np.sin(WAVES * angle)
    return np.stack([radius * np.sin(angle), radius * np.cos(angle)], axis=-1)


@dataclass(frozen=True)
class RingRun:
    """Motion of a character along the ring, with its path error."""

    motion: Motion
    path_error: Array  # (T,) distance of the root from the course, metres
    requested_speed: Array  # (T,) m/s


def path_error(xz: Array, course: Array) -> Array:
    """Return the distance `(T,)` in metres of root positions `(T, 2)` to the closed polygon `course` `(N, 2)`."""
    begin, along = course, np.roll(course, -1, axis=0) - course
    offset = xz[:, None] - begin
    t = (offset * along).sum(-1) / np.square(along).sum(-1)
    nearest = begin + np.clip(t, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(xz[:, None] - nearest, axis=-1).min(1)


@dataclass(frozen=True)
class RingWalk:
    """A character to walk along the ring; the seed also determines its start."""

    style: str
    code: Array  # Z^t
    gait: Gait
    seed: int


def run_ring(
    model: MotionModel, terrain: Terrain, walks: Sequence[RingWalk], seconds: float
) -> list[RingRun]:
    """Walk characters along the ring at full stick towards the point 0.9 m ahead; they do not collide.

    The first 2 s, from standing, are not scored.
    """
    course = ring()
    places = [int(np.random.default_rng(walk.seed).integers(POINTS)) for walk in walks]
    members = characters(model, terrain, [walk.code for walk in walks], [walk.seed for walk in walks])
    for member, place in zip(members, places, strict=True):
        heading = course[(place + 5) % POINTS] - course[place]
        x, z = map(float, course[place])
        member.reset(x, z, float(np.arctan2(*heading)))
    sticks = [_along(course, place, walk.gait) for place, walk in zip(places, walks, strict=True)]
    tracks = walked(members, sticks, LEAD_IN_FRAMES + round(seconds * FPS))
    made = []
    for walk, track in zip(walks, tracks, strict=True):
        name = f"{walk.style} {walk.gait.label} {terrain.name}"
        motion = track.motion(name, walk.style, walk.gait, LEAD_IN_FRAMES)
        error = path_error(track.root[LEAD_IN_FRAMES:].astype(np.float64), course)
        made.append(RingRun(motion, error, np.array(track.requested_speed[LEAD_IN_FRAMES:])))
    return made


def _along(course: Array, place: int, gait: Gait) -> Stick:
    """Return a stick that follows the course from one of its points."""

    def stick(member: Controller, frame: int) -> Controls:
        nonlocal place
        root = member.pose.root_position[[0, 2]].astype(np.float64)
        # search only ahead of the last point, so that the ring is never cut short
        ahead = (place + np.arange(-5, POINTS // 12)) % POINTS
        place = int(ahead[np.argmin(np.square(course[ahead] - root).sum(-1))])
        spacing = float(np.linalg.norm(course[(place + 1) % POINTS] - course[place]))
        way = course[(place + max(1, round(LOOK_AHEAD_M / spacing))) % POINTS] - root
        x, z = way / max(float(np.linalg.norm(way)), 1e-6)
        return Controls((float(x), float(z)), gait=gait)

    return stick
