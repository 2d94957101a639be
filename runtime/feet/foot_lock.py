"""Foot lock: toes and heels are held on the terrain while they are in contact, and lifted over it in swing.

Per foot: contact with hysteresis, held point (the toe rather than the heel), rotation, position and clearance. Then the
pelvis sinks as far as a held foot needs, closed-form IK bends the legs as fast as knees can follow, and the toes
bend on the ground. The difference between outgoing and incoming foot is an offset: it is kept while the foot is held,
and damped to zero once the foot is free, so that nothing jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.feet.ik import EASE_REACH_FRACTION, MAX_REACH
from runtime.feet.leg import Knee, LegPose, bent, leg_forward, leg_inverse, toes_raised, turned_out
from runtime.feet.narrow_support import Balance, SidewaysLead, may_be_narrow, pull_of_beam, side_of_beam
from runtime.feet.next_step import SteppedOver, has_edges
from runtime.feet.planted_foot import LEGS, PlantedFoot
from runtime.feet.reach import SpannedFoot, ankle_target, span, spanned_foot
from runtime.feet.settings import SETTINGS
from runtime.scalar_math import Vector, damp, smoothstep
from runtime.terrain.height_map import PointHeights, Terrain

UNLOADED_FOOT_WEIGHT = 0.05  # weight of a foot without contact in the pelvis offset
BENT_LEG_FRACTION = 0.93  # of a leg's length: a leg that spans less does not lift the hips
# the network raises the toes at heel strike 13 % less than captures do (`python -m training.evaluation gait`, "toes up")
ADDED_TOES_UP_FRACTION = 0.16


@dataclass
class PelvisOffset:
    """Vertical offset of the hips from the incoming pose, carried from frame to frame.

    A planted foot is some millimetres off its incoming position. A bent knee absorbs that invisibly; a straight one would
    bend by ten degrees for three millimetres. So the hips preserve the hip-ankle distance of straight standing legs, each
    leg with a smooth weight. A leg too short for its held foot lowers the hips further.
    """

    offset: float = 0.0  # m, upwards
    carried: float = 0.0  # `offset` before a leg that is too short lowers the hips
    speed: float = 0.0
    short: float = 0.0  # m that a leg is too short
    short_velocity: float = 0.0
    risen: float = 0.0  # m that the hips rise over a bar
    rising: float = 0.0  # m/s
    room: float = 0.0  # m that the hips still rise for a knee that cannot bend fast enough

    def carry(
        self,
        legs: Sequence[LegPose],
        feet: Sequence[PlantedFoot],
        dt: float,
        airborne: bool = False,
        rise: float = 0.0,
    ) -> None:
        """Update `offset` for this frame from the incoming legs and the outgoing feet; it does not change in the air.

        `rise` (metres) is how far the hips should rise over a bar, within the reach of held feet.
        """
        s = SETTINGS
        total, carried, least = s.free_weight, 0.0, s.max_rise
        for leg, foot in zip(legs, feet, strict=True):
            spans = span(leg)
            bent = (spans / foot.bones.length - s.bent_span) / (s.straight_span - s.bent_span)
            weight = 0.0 if airborne else smoothstep(bent)
            up, down = (s.max_rise, s.max_drop) if foot.anchor else (s.max_free_rise, s.max_free_rise)
            carried += weight * min(max(rise_for(leg.hip, foot.ankle, spans), -down), up)
            total += weight
            if foot.anchor:
                # the reach that needs no easing, or the hip-ankle distance of the incoming leg
                reach = foot.bones.length * max(MAX_REACH - EASE_REACH_FRACTION, spans / foot.bones.length)
                least = min(least, rise_for(leg.hip, foot.ankle, reach))
        self.carried, self.speed = damp(self.carried, self.speed, carried / total, s.carry_half_life, dt)
        carried = self.carried
        short = max(0.0, carried - max(least, -s.max_drop))
        self.short, self.short_velocity = damp(self.short, self.short_velocity, short, s.hips_half_life, dt)
        self.offset = carried - self.short
        if rise > 0.0 or self.risen != 0.0:
            rise = max(min(rise, self._room_to_rise(legs, feet)), 0.0)
            self.risen, self.rising = damp(self.risen, self.rising, rise, s.rise_over_half_life, dt)
            self.offset += self.risen
            if rise == 0.0 and self.risen < s.least_room:
                self.risen = self.rising = 0.0

    def _room_to_rise(self, legs: Sequence[LegPose], feet: Sequence[PlantedFoot]) -> float:
        """Metres that the hips can rise above `offset` until the first held leg is straight."""
        spans = [
            rise_for(leg.hip, foot.ankle, (MAX_REACH - EASE_REACH_FRACTION) * foot.bones.length)
            for leg, foot in zip(legs, feet, strict=True)
            if foot.anchor
        ]
        return min(spans, default=1.0) - self.offset

    def make_room(self, depths: Sequence[float], dt: float) -> float:
        """Return how far (metres) the hips rise above `offset` to keep the feet out of the ground while the knees cannot bend faster.

        `depths` are how deep (metres) the feet are in the ground.
        """
        s = SETTINGS
        needed = min(max(depths), s.max_room, self.room + s.room_speed * dt)
        room = max(self.room * 0.5 ** (dt / s.room_half_life), needed)
        self.room = room if room > s.least_room else 0.0
        return self.room


def rise_for(hip: Vector, ankle: Vector, spans: float) -> float:
    """Return how far (metres) `hip` must rise to be `spans` away from `ankle`, or as close to that distance as possible."""
    across = (ankle[0] - hip[0]) ** 2 + (ankle[2] - hip[2]) ** 2
    return ankle[1] + sqrt(max(spans * spans - across, 0.0)) - hip[1]


def carrying_rise(
    legs: Sequence[tuple[Vector, Vector]], spans: Sequence[float], bears: Sequence[float]
) -> float:
    """Return how far (metres) the hips rise so that nearly straight legs with weight on them get the lengths `spans`.

    `legs` are the positions of hip joint and ankle, `bears` is the contact probability of each foot.
    """
    total = rise = 0.0
    for (hip, ankle), reach, weight, bones in zip(legs, spans, bears, LEGS, strict=True):
        straight = smoothstep((reach / bones.length - BENT_LEG_FRACTION) / (1.0 - BENT_LEG_FRACTION))
        carries = UNLOADED_FOOT_WEIGHT + straight * weight
        rise += carries * rise_for(hip, ankle, reach)
        total += carries
    return rise / total


def _with_toes_up(leg: LegPose, ground: PointHeights) -> LegPose:
    rise = ground.height(leg.toe[0], leg.toe[2]) - ground.height(leg.ankle[0], leg.ankle[2])
    return toes_raised(leg, ADDED_TOES_UP_FRACTION, rise)


class Support(NamedTuple):
    """Inputs of the foot lock that depend on the character's state."""

    airborne: bool = False  # in free flight: no leg carries the body
    patience: float = 1.0  # factor on the allowed distance between a held foot and the incoming one
    # where the feet should stand, if not at their incoming positions
    legs: tuple[LegPose, LegPose] | None = None
    over: SteppedOver | None = None  # the obstacle that the gait itself steps over
    walks: bool = False  # at least one foot is on the ground
    least_bend: float = 0.0  # minimum knee flexion, radians


class FootLockResult(NamedTuple):
    """The pose with planted feet: `hips_position` (3,), `local_rotations` (31, 4)."""

    hips_position: Array
    local_rotations: Array


@dataclass
class FootLock:
    """Foot lock of one character, with its state; call `apply` once per simulated frame, in order."""

    feet: tuple[PlantedFoot, PlantedFoot] = field(default_factory=lambda: (PlantedFoot(0), PlantedFoot(1)))
    knees: tuple[Knee, Knee] = field(default_factory=lambda: (Knee(), Knee()))
    pelvis: PelvisOffset = field(default_factory=PelvisOffset)
    leads: tuple[SidewaysLead, SidewaysLead] = field(
        default_factory=lambda: (SidewaysLead(1.0), SidewaysLead(-1.0))
    )
    balance: Balance = field(default_factory=Balance)
    on_beam: bool = False
    pull: tuple[float, float] = (0.0, 0.0)  # m/s, XZ: keeps the root over a beam

    @property
    def held(self) -> tuple[str, str]:
        """Which point holds the left and the right foot: "", "heel" or "toe"."""
        return self.feet[0].anchor, self.feet[1].anchor

    def apply(
        self,
        hips_position: Array,
        local_rotations: Array,
        contacts: Array,
        terrain: Terrain,
        dt: float,
        support: Support | None = None,
    ) -> FootLockResult:
        """Return the incoming pose with planted feet.

        `hips_position` `(3,)`, `local_rotations` `(31, 4)`, `contacts` `(4,)` in 0..1 (left heel, left toe, right
        heel, right toe), `dt` seconds since the previous call.
        """
        support = support or Support()
        x, y, z = (float(v) for v in hips_position)
        local = np.asarray(local_rotations, np.float64).tolist()
        ground = PointHeights(terrain, y - SETTINGS.ground_under_hips, y + SETTINGS.ground_over_hips)
        left, right = (leg_forward(foot.bones, (x, y, z), local) for foot in self.feet)
        incoming = (left, right)
        legs, shown = support.legs or incoming, local_rotations
        if may_be_narrow(ground):
            legs, shown = self._on_beam((x, y, z), legs, shown, ground, dt)
        if has_edges(ground):
            legs = self._on_edges(incoming, legs, support.over, dt)
        else:
            legs = (_with_toes_up(legs[0], ground), _with_toes_up(legs[1], ground))
        self._plant_feet(legs, np.asarray(contacts, np.float64).tolist(), support, ground, dt)
        rise = support.over.hips_rise((x, y, z)) if support.over and has_edges(ground) else 0.0
        self.pelvis.carry(legs, self.feet, dt, support.airborne, rise)
        reached, drop = self._reach_feet(incoming, legs, support.least_bend, ground, dt)
        result = np.array(shown, copy=True)
        self._bend_legs(result, incoming, reached, drop, ground, dt)
        for foot, end in zip(self.feet, reached, strict=True):
            toe = foot.bones.joints[4]
            result[toe] = bent(local[toe], end.rotation, end.lifted(end.toe), ground, SETTINGS.sink)
        position = np.array([x, y - drop, z], np.asarray(hips_position).dtype)
        return FootLockResult(position, result)

    def _plant_feet(
        self,
        legs: tuple[LegPose, LegPose],
        chances: list[float],
        support: Support,
        ground: PointHeights,
        dt: float,
    ) -> None:
        """Choose the held point of each foot and its target; `chances` are contacts (left heel, left toe, right heel, right toe)."""
        drop, edges = -self.pelvis.offset, has_edges(ground)
        for side, (foot, leg) in enumerate(zip(self.feet, legs, strict=True)):
            other = self.feet[1 - side]
            foot.observe(leg, chances[2 * side], chances[2 * side + 1], ground, dt)
            over = edges and foot.is_over(support.over, ground)
            last = support.walks and not other.anchor
            foot.choose_anchor(leg, drop, other.refractory > 0.0, support.patience, over, last)
            foot.plant(leg, drop, ground, dt, support.patience)

    def _reach_feet(
        self,
        incoming: tuple[LegPose, LegPose],
        legs: tuple[LegPose, LegPose],
        least_bend: float,
        ground: PointHeights,
        dt: float,
    ) -> tuple[list[SpannedFoot], float]:
        """Return the feet within reach of their legs and of the knees' speed, and the metres that the hips sink for it."""
        drop, level = -self.pelvis.offset, not has_edges(ground)
        ends = []
        for foot, knee, leg, came in zip(self.feet, self.knees, legs, incoming, strict=True):
            target = ankle_target(foot.bones, foot.rotation, leg, foot.ankle, drop, ground)
            hip = came.raised(-drop)
            reach = knee.follow(came, hip, target, foot.bones, dt, not foot.anchor, least_bend, level)
            ends.append((foot, hip, target, reach))
        reached = [
            spanned_foot(f.bones, f.rotation, hip, target, reach, ground) for f, hip, target, reach in ends
        ]
        room = self.pelvis.make_room([end.depth for end in reached], dt)
        if room > 0.0:
            reached = [
                spanned_foot(foot.bones, foot.rotation, (x, y + room, z), target, reach, ground)
                for foot, (x, y, z), target, reach in ends
            ]
        return reached, drop - room

    def _bend_legs(
        self,
        result: Array,
        incoming: tuple[LegPose, LegPose],
        reached: list[SpannedFoot],
        drop: float,
        ground: PointHeights,
        dt: float,
    ) -> None:
        """Write the local rotations of thighs, shins and feet that reach the targets, with the hips `drop` metres lower."""
        for foot, knee, leg, end in zip(self.feet, self.knees, incoming, reached, strict=True):
            hip = leg.raised(-drop)
            first, ankle = foot.bones.joints[1], end.lifted(end.ankle)
            knee.bend_to(leg, hip, ankle, foot.bones, dt)
            joints = slice(first, first + 3)
            result[joints] = leg_inverse(leg, ankle, end.rotation, drop)
            if has_edges(ground) and (out := foot.knee_out(leg, hip, result[joints], ground, dt)):
                result[joints] = leg_inverse(turned_out(leg, foot.side, out), ankle, end.rotation, drop)

    def _on_edges(
        self,
        incoming: tuple[LegPose, LegPose],
        legs: tuple[LegPose, LegPose],
        over: SteppedOver | None,
        dt: float,
    ) -> tuple[LegPose, LegPose]:
        """Return legs whose feet are shifted past the obstacle that is stepped over."""
        steps, held = [foot.next_step for foot in self.feet], [bool(foot.anchor) for foot in self.feet]
        for foot, step, other, leg in zip(self.feet, steps, steps[::-1], incoming, strict=True):
            down = foot.toe_down or foot.heel_down
            step.watch(leg, other, bool(foot.anchor), down, foot.velocity, dt)
        left, right = (
            step.lead(leg, over, stands, dt) for step, leg, stands in zip(steps, legs, held, strict=True)
        )
        return left, right

    def _on_beam(
        self, hips: Vector, incoming: tuple[LegPose, LegPose], local: Array, ground: PointHeights, dt: float
    ) -> tuple[tuple[LegPose, LegPose], Array]:
        """Return legs moved onto the middle of a beam and local rotations with the arms held out; elsewhere both are unchanged."""
        side_way = side_of_beam(hips, incoming, ground)
        self.on_beam, self.pull = side_way is not None, pull_of_beam(hips, side_way, ground)
        left, right = (
            lead.apply(leg, other, side_way, bool(foot.anchor), ground, dt)
            for lead, leg, other, foot in zip(self.leads, incoming, incoming[::-1], self.feet, strict=True)
        )
        return (left, right), self.balance.apply(local, self.on_beam, dt)

    def take_over(self, shown: tuple[Array, Array], incoming: tuple[Array, Array]) -> None:
        """Continue from the `shown` pose instead of the `incoming` one; the difference fades out.

        Both are hips `(3,)` and local rotations `(31, 4)`.
        """
        vars(self).update(vars(FootLock()))
        for foot in self.feet:
            now, leg = (
                leg_forward(foot.bones, (x, y, z), np.asarray(local, np.float64).tolist())
                for (x, y, z), local in (shown, incoming)
            )
            foot.adopt(now, leg)
        self.pelvis.offset = self.pelvis.carried = float(shown[0][1] - incoming[0][1])
