"""Up a wall and down a drop, by keys: hands on the edge, a foot on top, stand; squat, step off, land.

The spine, head and arms of the network's standing pose are kept beneath the keys, so that a style climbs in its own way.
Frame: see `CrossingPose`; z = 0 is the upright face.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sport.runtime import rotations
from sport.runtime.crossing.keyed_pose import CrossingPose, Curve, leaned, reaching, smooth
from sport.runtime.feet.ik import LEG_FEET, LEG_THIGHS, solve_legs
from sport.runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT

Array = NDArray[np.floating]

TOE = np.asarray(SPORT_SKELETON.offsets[LEG_FEET[0] + 1], np.float64)  # from the ankle, on a flat foot
DEEPEST_M = 0.05  # that a sole is lifted out of the ground: what is deeper passes before a face
HIPS = 0.93  # height of the hips that the keys are written for
TRAIL, LEAD = 0, 1  # the left foot pushes, the right one is the first on top
GRAVITY = 9.81
WRIST_X, WRIST_Y, WRIST_Z = 0.21, 0.035, 0.03  # of hands on an edge
FORWARD_HANDS = rotations.from_yaw(np.array([-0.5 * np.pi, 0.5 * np.pi]))  # fingers ahead
ELBOWS = np.array([[0.6, -0.3, -0.8], [-0.6, -0.3, -0.8]])
KNEES_OUT = 1.1  # radians, so that no knee is in the wall
LOW_M = 0.8  # a lower wall is one high step


class _Keyed:
    """Feet and lean by curves of the share 0..1 of the time; both ends are the incoming pose."""

    seconds: float
    end_z: float
    _start_z: float
    _rise: float
    _root: Curve
    _height: Curve  # of the hips over the incoming ones
    _lean: Curve
    _feet: tuple[Curve, Curve]  # y, z of the ankle over a standing one, pitch
    _stands: tuple[tuple[tuple[float, float], ...], ...]  # shares of the time in which each foot stands
    _knees_out: Curve

    def root_z(self, t: float) -> float:
        """The root's place along the way at `t` seconds."""
        return float(self._root.at(t / self.seconds)[0])

    def _sunk(self, points: Array, rest: float) -> Array:
        """Depth in the ground of points of the feet `(2, 3)` that lie `rest` over it on a standing foot."""
        ground: Array = np.where(points[:, 2] > 0.0, self._rise, 0.0)
        return ground - (points[:, 1] - rest)

    def _lower_body(self, t: float, hips: Array, local: Array) -> CrossingPose:
        """Hips, lean, legs and contacts at `t` seconds, for the incoming pose."""
        share = t / self.seconds
        positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
        incoming = positions[LEG_FEET].astype(np.float64)
        raised = hips + np.array([0.0, float(self._height.at(share)[0]), 0.0])
        bent = leaned(local, float(self._lean.at(share)[0]))
        out = float(self._knees_out.at(share)[0])
        turn = rotations.from_yaw(np.array([out, -out]))
        bent[LEG_THIGHS] = rotations.multiply(turn, bent[LEG_THIGHS])
        own = 1.0 - float(smooth(share / 0.25)) + float(smooth((share - 0.8) / 0.2))
        root = self.root_z(t)
        ankles, feet = np.empty((2, 3)), rotations.identity((2,))
        for foot, curve in enumerate(self._feet):
            y, z, pitch = curve.at(share)
            side = incoming[foot] - np.array([0.0, ANKLE_HEIGHT, root])
            ankles[foot] = side * np.array([1.0, own, own]) + np.array([0.0, y + ANKLE_HEIGHT, z])
            feet[foot] = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(pitch))
        feet = rotations.slerp(feet, world[LEG_FEET].astype(np.float64), np.array([own, own]))
        toes = ankles + rotations.rotate(feet, np.tile(TOE, (2, 1)))
        lack = np.maximum(self._sunk(ankles, ANKLE_HEIGHT), self._sunk(toes, TOE_HEIGHT))
        ankles[:, 1] += np.where(lack < DEEPEST_M, np.maximum(lack, 0.0), 0.0)
        stands = [any(a <= share <= b for a, b in spans) for spans in self._stands]
        contacts = np.repeat(np.array(stands, np.float64), 2)
        return CrossingPose(raised, solve_legs(raised, bent, ankles, feet), contacts)


class Climb(_Keyed):
    """Up onto a wall of `rise` m that is `depth` m thick, from a root at `start_z`; `tempo` over 1 is faster."""

    def __init__(self, rise: float, start_z: float, depth: float, tempo: float = 1.0) -> None:
        self.seconds = (1.75 + 1.35 * max(rise - 0.6, 0.0)) / tempo
        self.end_z = min(0.33, 0.5 * depth)
        self._rise, self._start_z = rise, start_z
        self._feet = self._trail(), self._lead()
        self._body()

    def _body(self) -> None:
        """The ways of hips, spine and knees."""
        rise, start_z, end = self._rise, self._start_z, self.end_z
        near = max(start_z, -0.4)
        self._root = Curve(
            [
                (0, start_z),
                (0.18, near),
                (0.28, -0.38),
                (0.48, -0.36),
                (0.62, -0.2),
                (0.74, -0.05),
                (0.86, 0.75 * end),
                (0.94, end),
                (1, end),
            ]
        )
        up = rise - HIPS
        dip = float(np.interp(rise, [0.6, 1.0], [0.16, 0.04]))
        self._height = Curve(
            [
                (0, 0),
                (0.16, -dip),
                (0.27, -0.1 - dip),
                (0.44, max(up + 0.12, -0.1 - 0.5 * dip)),
                (0.55, up + 0.3),
                (0.72, up + 0.42),
                (0.84, up + 0.66),
                (1, rise),
            ]
        )
        grip = float(np.interp(rise, [0.6, 1.0, 1.5], [1.2, 0.45, 0.12]))
        self._lean = Curve([(0, 0), (0.18, grip), (0.3, grip), (0.48, 0.7), (0.66, 1.0), (0.8, 0.7), (1, 0)])
        self._knees_out = Curve([(0, 0), (0.2, 0), (0.4, KNEES_OUT), (0.66, 0.8), (0.85, 0.3), (1, 0)])

    def _lead(self) -> Curve:
        """The foot that is the first on top."""
        rise, start, end = self._rise, self._start_z, self.end_z
        keys = [(0.0, 0.0, start, 0.0), (0.3, 0.015, start, 0.1)]
        if rise > LOW_M:
            keys.append((0.46, rise - 0.66, -0.46, 0.6))
        keys += [(0.56, rise + 0.08, -0.24, 0.3), (0.66, rise, end, 0.0), (1.0, rise, end, 0.0)]
        self._stands = (self._stands_of_trail(), ((0.0, 0.3), (0.66, 1.0)))
        return Curve(keys)

    def _stands_of_trail(self) -> tuple[tuple[float, float], ...]:
        low = self._rise <= LOW_M
        return ((0.0, 0.62), (0.88, 1.0)) if low else ((0.0, 0.32), (0.44, 0.58), (0.88, 1.0))

    def _trail(self) -> Curve:
        """The foot that pushes: from the ground at a low wall, from the wall's face at a high one."""
        rise, start, end = self._rise, self._start_z, self.end_z
        keys = [(0.0, 0.0, start, 0.0)]
        if rise > LOW_M:
            face = (rise - 0.85, -0.19, -0.7)
            keys += [(0.32, 0.02, start, 0.15), (0.44, *face), (0.58, *face)]
        else:
            keys += [(0.5, 0.0, start, 0.0), (0.62, 0.07, start + 0.03, 0.5)]
        keys += [
            (0.74, rise + 0.12, -0.3, 0.7),
            (0.8, rise + 0.14, -0.08, 0.5),
            (0.88, rise, end, 0.0),
            (1.0, rise, end, 0.0),
        ]
        return Curve(keys)

    def pose(self, t: float, hips: Array, local: Array) -> CrossingPose:
        """At `t` seconds, for the incoming pose: `hips` `(3,)` over ground 0, root at `root_z(t)`; `local` `(31, 4)`."""
        shown = self._lower_body(t, hips, local)
        share = t / self.seconds
        weight = float(smooth((share - 0.05) / 0.13) * (1.0 - smooth((share - 0.66) / 0.16)))
        lifted = 0.12 * float(smooth((share - 0.66) / 0.1))
        wrists = np.array([[side * WRIST_X, self._rise + WRIST_Y + lifted, WRIST_Z] for side in (1.0, -1.0)])
        reached = reaching(shown.hips, shown.local, wrists, FORWARD_HANDS, weight, ELBOWS)
        return CrossingPose(shown.hips, reached, shown.contacts)


class Descend(_Keyed):
    """Down a drop of -`rise` m: squat at the edge, step off, land with bent knees. `depth` says nothing here."""

    def __init__(self, rise: float, start_z: float, depth: float, tempo: float = 1.0) -> None:
        ready, stand = 0.5 / tempo, 0.55 / tempo
        hop = 0.08
        fall = float(np.sqrt(2.0 * hop / GRAVITY) + np.sqrt(2.0 * (hop - rise) / GRAVITY))
        self.seconds = ready + fall + stand
        self.end_z = 0.5
        self._rise, self._start_z = rise, start_z
        off, land = ready / self.seconds, (ready + fall) / self.seconds
        crest = off + float(np.sqrt(2.0 * hop / GRAVITY)) / self.seconds
        low = rise - 0.34
        self._root = Curve(
            [(0, start_z), (off, max(start_z, -0.14)), (land, 0.9 * self.end_z), (1, self.end_z)]
        )
        arc = [(off + (land - off) * s, self._fallen(s * fall, hop)) for s in (0.25, 0.5, 0.75)]
        self._height = Curve(
            [
                (0, 0),
                (0.75 * off, -0.32),
                (off, -0.26),
                *((a, min(max(y - 0.26, low), 0.0)) for a, y in arc),
                (land, low + 0.06),
                (land + 0.25 * (1 - land), low),
                (1, rise),
            ]
        )
        self._lean = Curve(
            [(0, 0), (0.75 * off, 0.6), (crest, 0.35), (land, 0.35), (land + 0.25 * (1 - land), 0.7), (1, 0)]
        )
        self._knees_out = Curve([(0, 0), (off, 0.3), (land, 0.3), (1, 0)])
        self._feet = self._foot(off, land, 0.05), self._foot(off, land - 0.02, 0.12)
        self._stands = (((0.0, off), (land, 1.0)), ((0.0, off), (land, 1.0)))

    def _foot(self, off: float, land: float, ahead: float) -> Curve:
        """A foot that is `ahead` m before the edge as it passes over it."""
        over, end = off + 0.38 * (land - off), self.end_z
        keys = [(0, 0, self._start_z, 0), (off, 0.07, self._start_z, 0.45), (over, 0.16, 0.02 + ahead, 0.3)]
        return Curve([*keys, (land, self._rise, end, 0), (1, self._rise, end, 0)])

    @staticmethod
    def _fallen(seconds: float, hop: float) -> float:
        """Height over the take-off after so many seconds of a hop."""
        return float(np.sqrt(2.0 * GRAVITY * hop) * seconds - 0.5 * GRAVITY * seconds**2)

    def pose(self, t: float, hips: Array, local: Array) -> CrossingPose:
        """At `t` seconds, for the incoming pose: `hips` `(3,)` over ground 0, root at `root_z(t)`; `local` `(31, 4)`."""
        return self._lower_body(t, hips, local)
