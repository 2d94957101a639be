"""Steps the controller at a fixed 60 Hz under any display rate, and handles failures of the model."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from runtime import rotations
from runtime.controls import Controls
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.pose import Pose
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON
from runtime.terrain.height_map import Terrain

STEP_SECONDS = 1.0 / FPS
# per displayed frame: frames are dropped and the motion keeps its time, down to one frame a second; with a model
# slower than that the character slows down instead of lagging more and more
MIN_STEPS, MAX_STEPS = 6, 60
MODEL_TIME_FRACTION = 0.85  # of a frame's time that its steps may take
TRAVERSALS = {  # by the kinds of `runtime.traversal`
    "bar": "leap over a bar",
    "gap": "leap over a gap",
    "up": "step up",
    "down": "step down",
    "climb": "climb",
    "descend": "climb down",
}
_STANDS = "The character stands until you reset it (Home)."
MAX_FAILURES = 3  # in a row; then the character stands still until it is reset
COST_HALF_LIFE_STEPS = 20.0
_LOG = logging.getLogger("sport.viewer")


def rest_pose(terrain: Terrain, x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Pose:
    """Return the skeleton standing with lowered arms at x, z, facing `yaw`, shown until a model is loaded."""
    local = rotations.identity((len(SPORT_SKELETON),))
    forward = np.array([0.0, 0.0, 1.0])
    for name, angle in (("LeftArm", -1.25), ("RightArm", 1.25)):
        local[SPORT_SKELETON.index(name)] = rotations.from_axis_angle(forward, np.array(angle))
    local[0] = rotations.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(yaw))
    ground = float(terrain.height(x, z))
    return make_pose(
        np.array([x, ground + REST_HIPS_HEIGHT, z], np.float32), local, np.ones(4, np.float32), ground, yaw
    )


def make_pose(hips: Any, local: Any, contacts: Any, ground: float, yaw: float) -> Pose:
    """Return a pose by forward kinematics; `ground` is the height under the hips in metres, `yaw` in radians."""
    hips, local = np.asarray(hips, np.float32), np.asarray(local, np.float32)
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    root = np.array([hips[0], ground, hips[2]], np.float32)
    return Pose(hips, local, positions, world, np.asarray(contacts, np.float32), root, yaw)


def interpolate(a: Pose, b: Pose, t: float) -> Pose:
    """Return the pose at t in 0..1 between two poses: rotations along the shorter arc, bones keep their length."""
    if t <= 0.0 or a is b:
        return a
    if t >= 1.0:
        return b
    local = rotations.slerp(a.local_rotations, b.local_rotations, t)
    hips = a.hips_position + (b.hips_position - a.hips_position) * t
    ground = float(a.root_position[1] + (b.root_position[1] - a.root_position[1]) * t)
    yaw = a.root_yaw + math.remainder(b.root_yaw - a.root_yaw, math.tau) * t
    return make_pose(hips, local, a.contacts + (b.contacts - a.contacts) * t, ground, yaw)


def steps_of(due_s: float, frame_s: float, step_ms: float) -> tuple[int, float]:
    """Return how many steps of the due time to simulate in this frame, and how much of that time (seconds) is left.

    `step_ms` is the cost of a step; a frame takes no more of them than it can afford.
    """
    steps = int(due_s / STEP_SECONDS + 1e-6)
    left_s = min(max(due_s - steps * STEP_SECONDS, 0.0), STEP_SECONDS)
    affordable = int(MODEL_TIME_FRACTION * frame_s * 1e3 / max(step_ms, 1e-3))
    return min(steps, max(affordable, MIN_STEPS), MAX_STEPS), left_s


@dataclass
class Simulation:
    """Steps a controller and keeps the last two valid poses."""

    previous: Pose
    current: Pose
    controller: Controller | None = None
    model_ms: float = 0.0  # smoothed cost of one step
    problem: str = ""  # the failure of the last advance, or ""
    _left_s: float = 0.0
    _failures: int = 0

    @staticmethod
    def standing(terrain: Terrain, yaw: float = 0.0) -> Simulation:
        """Return a simulation without a controller, with a standing character."""
        pose = rest_pose(terrain, yaw=yaw)
        return Simulation(pose, pose)

    @property
    def halted(self) -> bool:
        """Whether the model has failed too often to be called again."""
        return self._failures >= MAX_FAILURES

    @property
    def blocked(self) -> str | None:
        """The reason why the character is blocked, for the status line, or None."""
        return None if self.controller is None else self.controller.blocked

    @property
    def keyed(self) -> str:
        """Status text of the keyframed traversal in progress, or ""."""
        return "" if self.controller is None else TRAVERSALS.get(self.controller.traversal, "")

    def use(self, controller: Controller) -> None:
        """Use another controller, starting where the character stands."""
        self.controller = controller
        x, _, z = map(float, self.current.root_position)
        self.reset(x, z, self.current.root_yaw)

    def go_on_from(self, pose: Pose) -> None:
        """Continue from the pose of a state restored into the controller; failures are forgotten."""
        self._failures, self._left_s, self.problem = 0, 0.0, ""
        self.previous = self.current = pose

    def reset(self, x: float, z: float, yaw: float) -> None:
        """Place the character standing and forget failures."""
        self._failures, self._left_s, self.problem = 0, 0.0, ""
        if self.controller is not None:
            self.controller.reset(x, z, yaw)
            self._step(Controls())
            self.previous = self.current

    def advance(self, seconds: float, controls: Controls) -> list[Pose]:
        """Simulate this much time and return the new poses; at most `MAX_STEPS`, dropping the rest."""
        self.problem = ""
        if self.controller is None or self.halted:
            self.previous = self.current
            return []
        steps, self._left_s = steps_of(self._left_s + seconds, seconds, self.model_ms)
        return [pose for _ in range(steps) if (pose := self._step(controls)) is not None]

    def shown(self) -> Pose:
        """Return the pose for the display, interpolated between the last two steps."""
        return interpolate(self.previous, self.current, self._left_s / STEP_SECONDS)

    def _step(self, controls: Controls) -> Pose | None:
        """Step the model once; a failure leaves the last good pose and sets `problem`."""
        controller = self.controller
        if controller is None:
            return None
        begin = time.perf_counter()
        try:
            pose = controller.step(controls)
            if not (np.isfinite(pose.hips_position).all() and np.isfinite(pose.positions).all()):
                raise ValueError("its output was not finite")
        except Exception as error:  # an arbitrary network may fail in any way; the window must survive
            _LOG.exception("the model failed")
            self._fail(str(error) or type(error).__name__)
            return None
        self.add_cost((time.perf_counter() - begin) * 1e3)
        fault = controller.message  # it has reset itself: an error only if that happens every time
        self._failures = self._failures + 1 if fault else 0
        self.problem = (f"{fault} {_STANDS}" if self.halted else fault) or self.problem
        self.previous, self.current = self.current, pose
        return pose

    def add_cost(self, ms: float) -> None:
        """Update the average cost of a model step, in milliseconds."""
        before_ms, fraction = self.model_ms or ms, 1.0 - 0.5 ** (1.0 / COST_HALF_LIFE_STEPS)
        self.model_ms = before_ms + (ms - before_ms) * fraction

    def _fail(self, failure: str) -> None:
        self._failures += 1
        after = _STANDS if self.halted else "It was reset to its last valid pose."
        self.problem = f"The motion model failed: {failure}. {after}"
        self.previous = self.current
        if self.controller is None or self.halted:
            return
        root = self.current.root_position
        try:
            self.controller.reset(float(root[0]), float(root[2]), self.current.root_yaw)
        except Exception:  # the same arbitrary network
            _LOG.exception("the model cannot be reset")
            self._failures = MAX_FAILURES
