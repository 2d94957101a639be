"""Knees that do not snap: a leg follows its foot's demand no faster than a knee can speed up.

Near straight, a millimetre of distance between hip and ankle is ten degrees of the knee, so that a foot that is put down,
held or let go would throw it. What a knee cannot follow for some frames, the foot takes up: it rolls over its toe.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, copysign, cos, radians, sqrt

from runtime.feet.leg_scalar import LegBones, LegPose, Vector, length, soft_reach, subtract

FASTEST = (
    radians(4.5) * 3600
)  # rad/s2, of the flexion; 6 degrees a frame squared are seen as a snap, captures stay below
STRAIGHT = radians(2.3)  # a straight knee: as far as it goes
BRAKING = radians(2.5) * 3600  # rad/s2, with which it comes to what is asked for


@dataclass
class Knee:
    """What one knee remembers: its flexion as it was shown, radians, its speed, and the incoming pose's flexion."""

    flexion: float | None = None
    speed: float = 0.0
    incoming: float = 0.0

    def follow(self, leg: LegPose, hip: Vector, target: Vector, bones: LegBones, dt: float) -> float:
        """Metres from `hip` to the ankle in this frame, where `target` is requested; `leg` is the incoming leg."""
        thigh, shin = length(subtract(leg.knee, leg.hip)), length(subtract(leg.ankle, leg.knee))
        far, spans = length(subtract(target, hip)), length(subtract(leg.ankle, leg.hip))
        wanted = _flexion(soft_reach(far, bones.length, spans), thigh, shin)
        incoming = _flexion(spans, thigh, shin)
        if self.flexion is None:
            self.flexion, self.speed, self.incoming = wanted, 0.0, incoming
            return far
        natural = (incoming - self.incoming) / dt
        missing = wanted - (self.flexion + natural * dt)
        speed = natural + copysign(min(abs(missing) / dt, sqrt(2.0 * BRAKING * abs(missing))), missing)
        speed = max(speed, -sqrt(2.0 * BRAKING * max(self.flexion - STRAIGHT, 0.0)))
        change = min(max(speed - self.speed, -FASTEST * dt), FASTEST * dt)
        self.incoming, self.speed = incoming, self.speed + change
        self.flexion = max(self.flexion + self.speed * dt, 0.0)
        return sqrt(max(thigh * thigh + shin * shin + 2.0 * thigh * shin * cos(self.flexion), 1e-9))

    def bend_to(self, leg: LegPose, hip: Vector, ankle: Vector, bones: LegBones, dt: float) -> None:
        """Go on from a leg that the ground made shorter than it was to be."""
        thigh, shin = length(subtract(leg.knee, leg.hip)), length(subtract(leg.ankle, leg.knee))
        flexion = _flexion(min(length(subtract(ankle, hip)), bones.length), thigh, shin)
        if flexion > (self.flexion or 0.0):
            self.speed += (flexion - (self.flexion or 0.0)) / dt
            self.flexion = flexion


def _flexion(reach: float, thigh: float, shin: float) -> float:
    """Angle between the bones (0 straight) that spans `reach`."""
    cosine = (reach * reach - thigh * thigh - shin * shin) / (2.0 * thigh * shin)
    return acos(min(max(cosine, -1.0), 1.0))
