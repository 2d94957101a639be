"""A motion given by tracks of keys for pelvis, trunk, feet and hands, played over an incoming pose."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from runtime.arrays import Array
from runtime.crossing.keyed_pose import (
    LEGS,
    CrossingPose,
    Track,
    bend_trunk,
    beyond,
    place_foot,
    place_hand,
    quaternions,
    shoulder_frame,
    slerp,
)
from runtime.easing import smooth
from runtime.feet.leg_scalar import (
    LegPose,
    Quaternion,
    Vector,
    add,
    from_vector,
    inverse,
    leg_forward,
    length,
    multiply,
    scale,
    subtract,
)

Rows = list[tuple[float, ...]]

LEAD, TRAIL = 1, 0  # the right foot goes first
STANDING_HIPS_M = 0.97  # height of the pelvis in the middle of a crossing before its keys move it
EASY_REACH_M, SLACK_M = 0.44, 0.03  # of an arm of 0.478 m
KNEE_CLEAR_M = 0.06  # of a knee from a wall
KNEE_TURN, FARTHEST_KNEE_OUT = 6.0, 1.25  # radians outwards: for each metre inside, at most
FARTHEST_PULL_M = 0.12  # of the pelvis to a hand
FADE_S = 0.25  # at both ends: inverse kinematics takes over the incoming legs


@dataclass(frozen=True)
class KeyedMotion:
    """Tracks over the seconds at tempo 1; metres and radians in the crossing's frame, left before right.

    A foot stands where the incoming pose has it when the root is at the start or at the end: its place is a share of
    each of both plus a place of its own, so that it lands in the stance of the style.
    """

    seconds: float
    start_z: float
    end_z: float
    rise: float
    root: Track  # z of the pelvis
    body: Track  # x, height over the incoming one, pitch, yaw, roll of the pelvis; lean, twist of the spine; look down
    level: Track  # share of `STANDING_HIPS_M` in place of the incoming height of the pelvis
    feet: tuple[
        Track, Track
    ]  # share of the start, of the end; toe joint x, y, z; heel over toe, knee outwards
    stands: tuple[Track, Track]  # contact of heel, of toe
    hands: tuple[Track, Track]  # weight, wrist x, y, z, hand turned inwards, fingers down
    elbows: tuple[Vector, Vector]  # where they point

    def pose(self, t: float, hips: Array, local: Array) -> CrossingPose:
        """The pose at `t` seconds (tempo 1) over the incoming `hips` `(3,)` and `local` `(31, 4)`."""
        incoming = quaternions(local)
        x, y, z = (float(c) for c in hips)
        mine = list(incoming)
        dx, dy, pitch, yaw, roll, lean, twist, look = self.body.at(t)
        level = self.level.at(t)[0]
        mine[0] = multiply(from_vector((pitch, yaw, roll)), mine[0])
        bend_trunk(mine, lean, twist, look)
        hands = [track.at(t) for track in self.hands]
        place = self._within_reach((x + dx, y + level * (STANDING_HIPS_M - y) + dy, z), mine, hands)
        share = smooth(min(t, self.seconds - t) / FADE_S)
        for side in (0, 1):
            leg = leg_forward(LEGS[side], (x, y, z), incoming)
            self._foot(t, side, leg, z, place, mine)
            if share < 1.0:
                self._keep_angles(side, leg, (x, y, z), incoming, mine, 1.0 - share)
            if hands[side][0] > 0.0:
                weight, *wrist, inward, down = hands[side]
                turn = flat_hand(side, inward, down)
                at = (wrist[0], wrist[1], wrist[2])
                place_hand(mine, side, place, at, self.elbows[side], turn, weight)
        contacts = [c for stand in self.stands for c in stand.at(t)]
        return CrossingPose(np.array(place), np.array(mine), np.array(contacts))

    def _foot(
        self, t: float, side: int, leg: LegPose, root: float, place: Vector, mine: list[Quaternion]
    ) -> None:
        start, end, x, y, z, heel, out = self.feet[side].at(t)
        both = start + end
        toe = (
            both * leg.toe[0] + x,
            both * leg.toe[1] + end * self.rise + y,
            start * (leg.toe[2] - root + self.start_z) + end * (leg.toe[2] - root + self.end_z) + z,
        )
        bend = from_vector((heel, 0.0, 0.0))
        foot = multiply(leg.foot, bend)
        free = 1.0 - self.stands[side].at(t)[1]
        before = list(mine)
        knee = place_foot(mine, side, place, toe, foot, out, free)
        under = smooth((self.rise + 2.0 * KNEE_CLEAR_M - knee[1]) / (2.0 * KNEE_CLEAR_M))
        inside = (knee[2] + KNEE_CLEAR_M) * under
        if inside > 0.0:
            mine[:] = before
            out = max(out, min(out + KNEE_TURN * inside, FARTHEST_KNEE_OUT))
            place_foot(mine, side, place, toe, foot, out, free)
        toes = LEGS[side].joints[4]  # stay flat under a raised heel
        mine[toes] = multiply(from_vector((-0.7 * max(heel, 0.0), 0.0, 0.0)), mine[toes])

    def _keep_angles(
        self,
        side: int,
        leg: LegPose,
        hips: Vector,
        incoming: list[Quaternion],
        mine: list[Quaternion],
        share: float,
    ) -> None:
        """Take a share of what inverse kinematics alone changes at the incoming pose off a leg again, in place."""
        solved = list(incoming)
        place_foot(solved, side, hips, leg.toe, leg.foot, 0.0, 0.0)
        for joint in LEGS[side].joints[1:4]:
            change = multiply(inverse(solved[joint]), incoming[joint])
            mine[joint] = multiply(mine[joint], slerp((1.0, 0.0, 0.0, 0.0), change, share))

    def _within_reach(self, place: Vector, mine: list[Quaternion], hands: list[list[float]]) -> Vector:
        """The pelvis, drawn to where the arms reach the places of the hands; further for hands of more weight."""
        for side in (0, 1):
            weight, x, y, z = hands[side][:4]
            if weight > 0.0:
                way = subtract((x, y, z), shoulder_frame(mine, side, place)[1])
                asked = length(way)
                over = min(beyond(asked, EASY_REACH_M, SLACK_M), FARTHEST_PULL_M)
                place = add(place, scale(way, weight * over / max(asked, 1e-6)))
        return place


def flat_hand(side: int, inward: float, down: float) -> Quaternion:
    """World rotation of a hand (0 left, 1 right) with its palm down: fingers ahead, turned inwards and down (radians)."""
    half = 0.5 * ((-1.5708 - inward) if side == 0 else (1.5708 + inward))
    turn = (cos(half), 0.0, sin(half), 0.0)
    return multiply(from_vector((down, 0.0, 0.0)), turn)


def timed(rows: Rows, seconds: float) -> Track:
    """A track of rows whose times are shares of the whole."""
    return Track([(row[0] * seconds, *row[1:]) for row in rows])


def both_sides(lead: Rows, trail: Rows, seconds: float) -> tuple[Track, Track]:
    """Tracks, left before right, of the foot that goes first and of the other."""
    tracks = {LEAD: timed(lead, seconds), TRAIL: timed(trail, seconds)}
    return tracks[0], tracks[1]


def stands(
    begin: float,
    heel_off: float,
    toe_off: float | None = None,
    whole: float = 1.0,
    heel_on: float | None = None,
) -> Rows:
    """Rows of the contacts of heel and toe of a foot that stands; its heel may come later and leave first."""
    toe_off = heel_off if toe_off is None else toe_off
    soon = 0.012 * whole
    rows: Rows = [] if begin == 0 else [(begin - soon, 0, 0)]
    if heel_on is not None:
        rows += [(begin, 0, 1), (heel_on, 0, 1), (heel_on + soon, 1, 1), (heel_off, 1, 1)]
    elif heel_off > begin:
        rows += [(begin, 1, 1), (heel_off, 1, 1)]
    if toe_off > heel_off:
        rows += [(heel_off + soon, 0, 1), (toe_off, 0, 1)]
    return rows if toe_off >= whole else [*rows, (toe_off + soon, 0, 0)]
