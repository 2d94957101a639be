"""How far the hips go up or down with the feet that stand, so that straight legs stay straight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

from runtime.easing import smooth
from runtime.feet.leg_scalar import LegPose, Vector
from runtime.feet.planted_foot import PlantedFoot, span, straightness
from runtime.feet.settings import SETTINGS, FootLockSettings
from runtime.spring import damp


@dataclass
class CarriedHips:
    """The height of the hips over the incoming pose's, from frame to frame.

    A foot that stands is some millimetres higher, lower, behind or ahead of the incoming one. A bent knee takes that
    up unseen; a straight one would have to bend by ten degrees for three millimetres. So the hips keep the straight
    standing leg's span, each leg with a weight that grows smoothly as it takes over. A leg that
    is too short for its held foot draws them down further.
    """

    offset: float = 0.0  # m, upwards
    carried: float = 0.0  # the same before a short leg draws the hips down
    speed: float = 0.0
    short: float = 0.0  # m that a leg is too short
    short_velocity: float = 0.0
    room: float = 0.0  # m that a knee still needs which cannot bend so fast

    def carry(
        self, legs: Sequence[LegPose], feet: Sequence[PlantedFoot], dt: float, airborne: bool = False
    ) -> None:
        """Set `offset` for this frame, from the incoming legs and the outgoing feet; nothing carries a body in the air."""
        s = SETTINGS
        total, carried, least = s.free_weight, 0.0, s.max_rise
        for leg, foot in zip(legs, feet, strict=True):
            spans = span(leg)
            weight = 0.0 if airborne else _straight(spans / foot.bones.length, s)
            up, down = (s.max_rise, s.max_drop) if foot.anchor else (s.max_free_rise, s.max_free_rise)
            carried += weight * min(max(rise_for(leg.hip, foot.ankle, spans), -down), up)
            total += weight
            if foot.anchor:
                reach = foot.bones.length * straightness(leg, foot.bones)
                least = min(least, rise_for(leg.hip, foot.ankle, reach))
        self.carried, self.speed = damp(self.carried, self.speed, carried / total, s.carry_halflife, dt)
        carried = self.carried
        short = max(0.0, carried - max(least, -s.max_drop))
        self.short, self.short_velocity = damp(self.short, self.short_velocity, short, s.hips_halflife, dt)
        self.offset = carried - self.short

    def make_room(self, depths: Sequence[float], dt: float) -> float:
        """Metres that the hips rise over `offset` so that legs which bend no faster do not press their feet `depths` into the ground."""
        s = SETTINGS
        needed = min(max(depths), s.max_room, self.room + s.room_speed * dt)
        self.room = max(self.room * 0.5 ** (dt / s.room_halflife), needed)
        return self.room


def rise_for(hip: Vector, ankle: Vector, spans: float) -> float:
    """Metres that `hip` must rise to be `spans` away from `ankle`, over it; as near as possible when it never is."""
    across = (ankle[0] - hip[0]) ** 2 + (ankle[2] - hip[2]) ** 2
    return ankle[1] + sqrt(max(spans * spans - across, 0.0)) - hip[1]


def _straight(share: float, s: FootLockSettings) -> float:
    """0 for a bent to 1 for a straight leg that spans `share` of its length."""
    return smooth((share - s.bent_span) / (s.straight_span - s.bent_span))
