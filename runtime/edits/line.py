"""Narrow track: every step lands on one line with the standing foot as it is shown, and swings around it.

The network's own feet do not tell where that is: they slide under a swaying body, while the foot lock holds the shown
foot; and the body drifts sideways from the requested direction. So a step is measured from the foot as last shown,
perpendicular to the hips' direction of travel.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, sin

from runtime.edits.request import OUTWARD, EditRequest, limited, narrow, range_of
from runtime.pose import FPS
from runtime.scalar_math import Vector, add, decay, dot, scale, subtract

STEP_HALF_LIFE_S = 0.04  # of a swinging foot's approach to the line
FOLLOWED_FRACTION = 0.55  # of the correction that is applied: with the rest the network keeps its balance
MAX_STEP_CHANGE_M = 0.15  # limit of the shift of a step
CLEAR_M, PASSING_M = 0.1, 0.27  # lateral distance at which feet pass, while this near along the path
MIN_WALKING_SPEED_M_PER_S = 0.3  # above which it is active
DRIFT_HALF_LIFE_S, MAX_DRIFT_M_PER_S = 1.0, 0.3  # of the measured sideways drift; its limit
OFFSET_HALF_LIFE_S = 0.5  # of the measured offset of the line from the hips
CENTRING_FRACTION, MAX_CENTRING_M = 0.5, 0.05  # of that offset a step takes back; limit


@dataclass
class FootLine:
    """State of narrow steps: the line of the feet, and the shifts of the last steps."""

    x: float = 0.0  # m, position of the hips in the last frame
    z: float = 0.0
    drift: float = 0.0  # m/s, of the hips to the left of the requested direction
    off: float = 0.0  # m, of the line to the left of the hips
    left: float = 0.0  # m to the left, shift of the left foot's last step
    right: float = 0.0
    known: float = 0.0  # 1 once `x` and `z` are set

    def apply(
        self, hips: Vector, ankles: list[Vector], bears: tuple[float, float], request: EditRequest
    ) -> list[Vector]:
        """Return the ankles moved onto a line, if a narrow walk is requested.

        `hips` is the centre of the hips, `bears` the load on each foot (0 to 1).
        """
        by = narrow(request.targets)
        if not by:
            vars(self).update(vars(FootLine()))
            return ankles
        side = self._across(hips, request)
        stand = request.feet or (ankles[0], ankles[1])
        off = dot(subtract(scale(add(*stand), 0.5), hips), side)
        self.off += (1.0 - decay(OFFSET_HALF_LIFE_S)) * (off - self.off)
        centring = limited(CENTRING_FRACTION * self.off, MAX_CENTRING_M)
        wanted = sum(range_of(leg[OUTWARD])[1] for leg in request.targets[:2])
        steps, moved = [self.left, self.right], []
        for k, (sign, ankle, other) in enumerate(zip((1.0, -1.0), ankles, stand[::-1], strict=True)):
            apart, free = subtract(ankle, other), max(1.0 - bears[k], 0.0)
            gap = sign * dot(apart, side)
            goal = FOLLOWED_FRACTION * by * limited(sign * (wanted - gap) - centring, MAX_STEP_CHANGE_M)
            steps[k] += (1.0 - decay(STEP_HALF_LIFE_S)) * free * (goal - steps[k])
            ahead = apart[2] * side[0] - apart[0] * side[2]
            near = max(1.0 - (ahead / PASSING_M) ** 2, 0.0)
            push = by * near * free * max(CLEAR_M - gap - sign * steps[k], 0.0)
            moved.append(add(ankle, scale(side, steps[k] + sign * push)))
        self.left, self.right = steps
        return moved

    def _across(self, hips: Vector, request: EditRequest) -> Vector:
        """Unit vector to the left of the hips' direction of travel."""
        x, z = request.velocity
        speed = hypot(x, z)
        if speed < MIN_WALKING_SPEED_M_PER_S:
            x, z, self.known = sin(request.yaw), cos(request.yaw), 0.0
        else:
            if self.known:
                drift = (z * (hips[0] - self.x) - x * (hips[2] - self.z)) / speed * FPS
                self.drift += (1.0 - decay(DRIFT_HALF_LIFE_S)) * (
                    limited(drift, MAX_DRIFT_M_PER_S) - self.drift
                )
            turn = self.drift / speed
            x, z, self.known = x + turn * z, z - turn * x, 1.0
        self.x, self.z = hips[0], hips[2]
        size = hypot(x, z)
        return z / size, 0.0, -x / size
