"""Restyles a foreign clip: its path, speed, facing and gaits become stick input for the character in another style.

The character follows the clip's path frame by frame, as a player would: the stick requests the clip's velocity a
moment ahead and steers back to the clip's position. The result is a take with an input of its own, which can be edited
like a recorded one.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.controls import STAND_SPEED_M_PER_S, Controls, Gait
from runtime.errors import SportError
from runtime.motion.controller import Controller
from runtime.motion.trajectory import MAX_RESPONSE
from runtime.pose import FPS, Pose
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON
from runtime.takes.clip import Clip, stacked
from runtime.takes.footplants import stretches
from runtime.takes.input_recording import InputRecorder, InputRecording, StyleChange
from runtime.takes.metadata import gait_seconds, origin_of
from runtime.takes.root import smooth

LEAD_IN_FRAMES = 2 * FPS  # walked before the clip begins, to reach its speed
PATH_DEVIATION_FRAMES = 12.0  # of the Gaussian that removes the sway of single steps from the path,
YAW_DEVIATION_FRAMES = 10.0  # and from the facing
LOOK_AHEAD_S = 0.28  # the stick requests the velocity this much later: about the body's response time
CORRECTION_PER_S = 2.2  # velocity towards the clip's position, per metre of distance
MAX_CORRECTION_M_PER_S = 0.8
MIN_FACING_RAD = 0.6  # radians between facing and path above which the facing is requested: a side step
CROUCH_HEIGHT_M = 0.77  # of the hips above the ground: below it, a body of our size crouches (walking: 0.955)
JOG_M_PER_S = 1.95  # above it, a body of our size jogs
JOG_AIR_FRACTION = 0.08  # of a second without a foot on the ground, above which it also jogs
AIR_M = 0.05  # of both ankles above their resting height
JUMP_RISE_M, JUMP_AIR_S = 0.16, 0.25  # rise of the hips and minimum time in the air of a jump
JUMP_LEAD_S = 0.25  # from the button to the take-off
EQUALLY_NEAR_M = 0.002  # tolerance within which positions of a path are equally near to a point
FACING_SPEED_M_PER_S = 0.4  # below it, a body faces where the clip does


@dataclass(frozen=True)
class ClipRequests:
    """What a clip requests of a character per frame, at `FPS`, after a straight lead-in of `LEAD_IN_FRAMES`."""

    path: Array  # (T, 2) metres, XZ
    velocity: Array  # (T, 2) m/s
    yaw: Array  # (T,) radians, facing
    gaits: NDArray[np.int8]  # (T,) `Gait`
    facing: NDArray[np.bool_]  # (T,) whether the body faces away from its direction of travel


def requests_of(clip: Clip) -> ClipRequests:
    """Return what a clip at `FPS` requests of a character: path, velocity, yaw, gaits and facing."""
    hips = clip.hips_positions.astype(np.float64)
    path = smooth(hips[:, [0, 2]], PATH_DEVIATION_FRAMES)
    velocity = np.gradient(path, axis=0) * FPS if len(path) > 1 else np.zeros_like(path)
    headings = np.unwrap(rotations.yaw_of(clip.local_rotations[:, 0].astype(np.float64)))
    yaw = smooth(headings[:, None], YAW_DEVIATION_FRAMES)[:, 0]
    speed = np.linalg.norm(velocity, axis=-1)
    off = np.abs((np.arctan2(velocity[:, 0], velocity[:, 1]) - yaw + np.pi) % (2.0 * np.pi) - np.pi)
    facing = (smooth(off[:, None], YAW_DEVIATION_FRAMES)[:, 0] > MIN_FACING_RAD) | (
        speed < FACING_SPEED_M_PER_S
    )
    gaits = _gaits(clip, speed) if clip.gaits is None else clip.gaits
    start = velocity[0] if gaits[0] != Gait.STAND else np.zeros(2)
    back = np.arange(LEAD_IN_FRAMES, 0, -1)[:, None] / FPS
    before = LEAD_IN_FRAMES
    return ClipRequests(
        np.concatenate([path[0] - back * start, path]),
        np.concatenate([np.tile(start, (before, 1)), velocity]),
        np.concatenate([np.full(before, yaw[0]), yaw]),
        np.concatenate([np.full(before, gaits[0], np.int8), gaits]),
        np.concatenate([np.full(before, facing[0]), facing]),
    )


def _gaits(clip: Clip, speed: Array) -> NDArray[np.int8]:
    """Return the gait of each frame `(T,)`, from hip height, speed and time in the air."""
    hips = clip.hips_positions[:, 1].astype(np.float64)
    positions = clip.world()[0]
    ankles = positions[:, [SPORT_SKELETON.index("LeftFoot"), SPORT_SKELETON.index("RightFoot")], 1]
    ground = float(np.percentile(ankles.min(1), 5)) - ANKLE_HEIGHT
    air = (ankles.min(1) - ground - ANKLE_HEIGHT > AIR_M).astype(np.float64)
    second = np.ones(FPS) / FPS
    flies = np.convolve(np.pad(air, FPS // 2, "edge"), second, "valid")[: len(air)]
    low = smooth(hips[:, None] - ground, PATH_DEVIATION_FRAMES)[:, 0] < CROUCH_HEIGHT_M
    result = np.full(len(hips), int(Gait.WALK), np.int8)
    result[(speed > JOG_M_PER_S) | ((flies > JOG_AIR_FRACTION) & (speed > 1.2))] = Gait.JOG
    result[low] = Gait.CROUCH
    result[(speed < STAND_SPEED_M_PER_S) & ~low] = Gait.STAND
    for first, end in stretches(air > 0.0):
        rises = hips[first:end].max() - np.median(hips[max(first - FPS, 0) : first + 1])
        if end - first > JUMP_AIR_S * FPS and rises > JUMP_RISE_M:
            result[max(first - round(JUMP_LEAD_S * FPS), 0) : end] = Gait.JUMP
    return result


def stick_of(requests: ClipRequests, frame: int, pose: Pose, full_speed: Callable[[Gait], float]) -> Controls:
    """Return the controls of a frame (0 begins the lead-in) for a character whose last pose was `pose`."""
    ahead = min(frame + round(LOOK_AHEAD_S * FPS), len(requests.path) - 1)
    gait = Gait(int(requests.gaits[min(frame + round(0.5 * LOOK_AHEAD_S * FPS), len(requests.gaits) - 1)]))
    facing = None
    if requests.facing[ahead]:
        facing = (float(np.sin(requests.yaw[ahead])), float(np.cos(requests.yaw[ahead])))
    if gait is Gait.STAND and requests.gaits[ahead] == Gait.STAND:
        return Controls((0.0, 0.0), facing)
    walks = Gait.WALK if gait in (Gait.STAND, Gait.JUMP, Gait.OTHER) else gait
    root = np.array([pose.root_position[0], pose.root_position[2]], np.float64)
    away = CORRECTION_PER_S * (requests.path[frame] - root)
    away *= min(1.0, MAX_CORRECTION_M_PER_S / max(float(np.linalg.norm(away)), 1e-9))
    move = (requests.velocity[ahead] + away) / full_speed(walks)
    return Controls((float(move[0]), float(move[1])), facing, Gait.JUMP if gait is Gait.JUMP else walks)


def restyled(
    clip: Clip,
    controller: Controller,
    style: StyleChange,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Clip, InputRecording]:
    """Return the clip resimulated by `controller` in a style on its terrain, and the input used.

    It is as long as the clip. Raises SportError if the network fails.
    """
    source = clip.resampled(float(FPS))
    requests, recorder, terrain = requests_of(source), InputRecorder(), controller.terrain
    controller.response = MAX_RESPONSE  # a captured velocity already has a body's momentum
    controller.set_style(style.z, 0.0)
    pose = controller.reset(float(requests.path[0, 0]), float(requests.path[0, 1]), float(requests.yaw[0]))
    recorder.mark_ground(terrain.name, terrain)
    recorder.mark_style(replace(style, frame=0), holds=False)
    poses: list[Pose] = []
    for frame in range(len(requests.path)):
        recorder.before_steps(controller)
        controls = stick_of(requests, frame, pose, controller.full_speed)
        pose = controller.step(controls)
        poses.append(pose)
        recorder.add(controls, controller)
        if controller.message:
            raise SportError(f"frame {frame}: {controller.message}", "Try another seed or model.")
        progress(frame / len(requests.path))
    inputs = recorder.cut(LEAD_IN_FRAMES)
    assert inputs is not None  # the recorder has every frame
    gaits = inputs.gaits()
    made = Clip(
        f"{clip.name} restyled",
        float(FPS),
        *stacked(poses[LEAD_IN_FRAMES:]),
        prompts=(replace(style.event, seconds=0.0, transition_seconds=0.0),),
        terrain=terrain.name,
        origin=origin_of(controller, terrain.name),
        gaits=gaits,
        gait_seconds=gait_seconds(gaits, float(FPS)),
        size=clip.size,
    )
    return made, inputs


@dataclass(frozen=True)
class PathError:
    """Deviation of a restyled clip from its source, in path (metres) and time (seconds)."""

    path_m: float  # median distance of the hips to the path, both smoothed
    time_s: float  # median time by which the hips are early or late on it


def path_error(made: Clip, led_by: Clip) -> PathError:
    """Return how far a restyled clip deviates from its source in path and time."""
    path = requests_of(led_by.resampled(float(FPS))).path[LEAD_IN_FRAMES:]
    own = smooth(made.hips_positions[:, [0, 2]].astype(np.float64), PATH_DEVIATION_FRAMES)
    reach, away, late = round(1.5 * FPS), [], []
    for frame, place in enumerate(own[: len(path)]):
        first = max(frame - reach, 0)
        near = np.linalg.norm(path[first : frame + reach + 1] - place, axis=-1)
        away.append(float(near.min()))
        # all frames of a standing path are equally near: the simultaneous one counts
        equal = np.flatnonzero(near < near.min() + EQUALLY_NEAR_M) + first
        late.append(float(np.abs(equal - frame).min()) / FPS)
    return PathError(float(np.median(away)), float(np.median(late)))
