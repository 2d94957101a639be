"""Feet on a narrow line: every step comes down before the foot that is shown to stand, and goes round it.

The network's own feet do not say where that is: they slide under a body that sways, while the foot lock holds what is shown;
and the body drifts to one side of the way that is asked for. So a step is measured against the foot that was shown last, across
the way that the hips go.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, sin

from runtime.edits.request import OUTWARD, EditRequest, limited, narrow, range_of
from runtime.pose import FPS
from runtime.scalar_math import Vector, add, decay, dot, scale, subtract

STEP_HALF_LIFE = 0.04  # seconds in which a swinging foot comes before the one that stands
FOLLOWED_FRACTION = 0.55  # of the way there that it goes: by the rest the network keeps its balance
MAX_STEP_CHANGE_M = 0.15  # metres that a step goes elsewhere
CLEAR_M, PASSING_M = 0.1, 0.27  # a foot passes the other at this distance, while it is so near along the way
MIN_WALKING_SPEED_M_PER_S = 0.3  # m/s, from which on it is
DRIFT_HALF_LIFE, MAX_DRIFT_M_PER_S = 1.0, 0.3  # seconds in which a drift to one side is seen, m/s
OFF_HALF_LIFE = 0.5  # seconds in which it is seen that the line runs beside the hips
CENTRING_FRACTION, MAX_CENTRING_M = 0.5, 0.05  # of that, and metres, that a step comes back under them


@dataclass
class FootLine:
    """State of narrow steps: where the line of the feet runs, and where the last steps landed."""

    x: float = 0.0  # m, where the hips were in the last frame
    z: float = 0.0
    drift: float = 0.0  # m/s of them to the left of the way that is asked for
    off: float = 0.0  # m that the line runs to the left of them
    left: float = 0.0  # m to the left that the last step of the left foot went elsewhere
    right: float = 0.0
    known: float = 0.0  # 1 once `x` and `z` are

    def apply(
        self, hips: Vector, ankles: list[Vector], bears: tuple[float, float], request: EditRequest
    ) -> list[Vector]:
        """Return the ankles moved onto a line, if a narrow walk is asked for.

        `hips` is the middle of the hips, `bears` the load on each foot (0 to 1).
        """
        by = narrow(request.targets)
        if not by:
            vars(self).update(vars(FootLine()))
            return ankles
        side = self._across(hips, request)
        stand = request.feet or (ankles[0], ankles[1])
        off = dot(subtract(scale(add(*stand), 0.5), hips), side)
        self.off += (1.0 - decay(OFF_HALF_LIFE)) * (off - self.off)
        centring = limited(CENTRING_FRACTION * self.off, MAX_CENTRING_M)
        wanted = sum(range_of(leg[OUTWARD])[1] for leg in request.targets[:2])
        steps, moved = [self.left, self.right], []
        for k, (sign, ankle, other) in enumerate(zip((1.0, -1.0), ankles, stand[::-1], strict=True)):
            apart, free = subtract(ankle, other), max(1.0 - bears[k], 0.0)
            gap = sign * dot(apart, side)
            goal = FOLLOWED_FRACTION * by * limited(sign * (wanted - gap) - centring, MAX_STEP_CHANGE_M)
            steps[k] += (1.0 - decay(STEP_HALF_LIFE)) * free * (goal - steps[k])
            ahead = apart[2] * side[0] - apart[0] * side[2]
            near = max(1.0 - (ahead / PASSING_M) ** 2, 0.0)
            push = by * near * free * max(CLEAR_M - gap - sign * steps[k], 0.0)
            moved.append(add(ankle, scale(side, steps[k] + sign * push)))
        self.left, self.right = steps
        return moved

    def _across(self, hips: Vector, request: EditRequest) -> Vector:
        """To the left across the way that the hips go."""
        x, z = request.velocity
        speed = hypot(x, z)
        if speed < MIN_WALKING_SPEED_M_PER_S:
            x, z, self.known = sin(request.yaw), cos(request.yaw), 0.0
        else:
            if self.known:
                drift = (z * (hips[0] - self.x) - x * (hips[2] - self.z)) / speed * FPS
                self.drift += (1.0 - decay(DRIFT_HALF_LIFE)) * (
                    limited(drift, MAX_DRIFT_M_PER_S) - self.drift
                )
            turn = self.drift / speed
            x, z, self.known = x + turn * z, z - turn * x, 1.0
        self.x, self.z = hips[0], hips[2]
        size = hypot(x, z)
        return z / size, 0.0, -x / size
