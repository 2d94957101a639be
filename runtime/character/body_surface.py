"""Radii of a character's trunk and head in every direction, as tables from its mesh in the rest pose."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.character.skinned_mesh import SkinnedMesh
from runtime.skeleton import SPORT_SKELETON

TRUNK = ("Hips", "LowerBack", "Spine", "Spine1")
HEAD = "Head"
ARMS = ("Shoulder", "Arm", "ForeArm", "Hand", "FingerBase", "HandIndex1")
# entries around the trunk, height of one, entries from the head's underside to its top
AROUND = 32
RISE_M = 0.02
UP = 16
CAP_M = 0.04  # height over which the ends of a trunk's table are rounded
HEAD_UP_M = 0.06
SAMPLES = 60_000  # points on the mesh
MIN_FILLED_FRACTION = 0.4  # of a table's entries; a body of loose pieces has no surface
MIN_SAMPLES = 50  # minimum per part with a table
HAND_POINTS = 14  # that represent a hand


@dataclass(frozen=True)
class Table:
    """Distances from a joint's axis (trunk) or centre (head) to the mesh surface, in the rest frame of that joint, in metres.

    `origin` `(3,)` is relative to the joint's pivot. `radii` is `(heights, AROUND)` for a trunk, one row every `RISE_M`
    of height, or `(UP, AROUND)` for a head, by elevation.
    """

    joint: int  # of the character
    source: int  # SPORT joint that drives it
    origin: AnyArray
    radii: AnyArray
    round: bool  # a head


class BodySurface:
    """Surface tables of trunk and head, and points on each hand in the aligned rest pose.

    `hands` `(S, n, 3)` are relative to the hand joints of `sides`.
    """

    def __init__(self, tables: Sequence[Table], hands: Mapping[str, AnyArray]) -> None:
        self.sides = tuple(hands)
        self.hands = np.stack([hands[side] for side in self.sides])
        self.joints = np.array([table.joint for table in tables])
        self.sources = np.array([table.source for table in tables])
        self.origins = np.stack([table.origin for table in tables])
        self.round = np.array([table.round for table in tables])
        self.rows = np.array([len(table.radii) for table in tables])
        most = int(self.rows.max())
        self.radii = np.stack(
            [np.pad(t.radii, ((0, most - len(t.radii)), (0, 0)), mode="edge") for t in tables]
        )

    def outward(self, points: AnyArray) -> AnyArray:
        """Return unit directions `(..., tables, 3)` from each table's axis or centre to the points, in the joints' rest frames."""
        away = points - self.origins
        # a hand that crosses the centre of a head leaves it at the top
        away[..., 1] = np.where(self.round, away[..., 1] + HEAD_UP_M, 0.0)
        return rotations.normalize(away)

    def depth(self, points: AnyArray) -> AnyArray:
        """Return how deep points `(..., tables, n, 3)` in rest frames lie below the surface, `(..., tables, n)` metres; 0 outside."""
        away = points - self.origins[:, None]
        x, height, z = away[..., 0], away[..., 1], away[..., 2]
        ball, rows = self.round[:, None], self.rows[:, None]
        flat = np.maximum(np.hypot(x, z), 1e-6)
        whole = np.hypot(flat, height)
        around = np.arctan2(z, x) / (2 * np.pi) * AROUND
        row = np.where(ball, np.arctan2(flat, -height) / np.pi * UP, height / RISE_M) - 0.5
        over = np.maximum(np.maximum(-height, height - rows * RISE_M), 0.0)
        share = np.where(ball, 1.0, np.sqrt(np.maximum(1.0 - (over / CAP_M) ** 2, 0.0)))
        reach = self._radius(np.clip(row, 0.0, rows - 1.0), around) * share
        return np.asarray(np.maximum(reach - np.where(ball, whole, flat), 0.0))

    def _radius(self, row: AnyArray, around: AnyArray) -> AnyArray:
        """Interpolate between the four neighbouring entries."""
        r, a = np.floor(row).astype(np.int64), np.floor(around).astype(np.int64)
        up, on = row - r, around - a
        table = np.arange(len(self.rows))[:, None]
        r2 = np.minimum(r + 1, self.rows[:, None] - 1)
        a, a2 = a % AROUND, (a + 1) % AROUND
        low = self.radii[table, r, a] * (1 - on) + self.radii[table, r, a2] * on
        high = self.radii[table, r2, a] * (1 - on) + self.radii[table, r2, a2] * on
        return np.asarray(low * (1 - up) + high * up)


def fit_surface(mesh: SkinnedMesh, rest: AnyArray, pivots: AnyArray) -> BodySurface | None:
    """Fit the surface of a character to its vertices `rest` `(V, 3)` and pivots `(K, 3)` in the aligned rest pose.

    Returns None if the mesh has no hands or too many holes.
    """
    names = np.array((*SPORT_SKELETON.names, ""))
    lead = mesh.joint_indices[np.arange(len(rest)), mesh.joint_weights.argmax(axis=1)]
    source = mesh.alignment.source[mesh.alignment.driver[lead]]
    owner = names[source]
    joints = {str(names[s]): int(k) for k, s in enumerate(mesh.alignment.source) if s >= 0}
    hands = _hands(rest, pivots, owner, joints)
    points, of = _samples(mesh, rest, owner)
    if not hands or not len(points):
        return None
    tables = [_table(points, of, name, joints[name], pivots) for name in (*TRUNK, HEAD) if name in joints]
    found = [table for table in tables if table is not None]
    return BodySurface(found, hands) if found else None


def _hands(rest: AnyArray, pivots: AnyArray, owner: AnyArray, joints: dict[str, int]) -> dict[str, AnyArray]:
    found = {}
    for side in ("Left", "Right"):
        own = np.isin(owner, [side + bone for bone in ARMS[3:]] + [side[0] + "Thumb"])
        limb = all(side + bone in joints for bone in ("Arm", "ForeArm", "Hand"))
        if limb and own.sum() >= HAND_POINTS:
            found[side] = _spread(rest[own].astype(np.float64)) - pivots[joints[side + "Hand"]]
    return found


def _spread(points: AnyArray) -> AnyArray:
    """Return a subset of the points, spread as far apart as possible."""
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    gap = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < HAND_POINTS:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.asarray(points[chosen])


def _samples(mesh: SkinnedMesh, rest: AnyArray, owner: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return evenly spread points on the mesh without its arms, and the SPORT joint that drives each."""
    arms = np.isin(owner, [side + bone for side in ("Left", "Right") for bone in ARMS] + ["LThumb", "RThumb"])
    triangles = mesh.triangles[~arms[mesh.triangles].any(axis=1)]
    corners = rest[triangles].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if not 0.0 < area.sum() < np.inf:
        return np.zeros((0, 3)), np.zeros(0, "U1")
    rng = np.random.default_rng(0)
    which = rng.choice(len(triangles), SAMPLES, p=area / area.sum())
    u, v = rng.random((2, SAMPLES, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    a, b, c = corners[which].transpose(1, 0, 2)
    return a + u * (b - a) + v * (c - a), owner[triangles[which, 0]]


def _table(points: AnyArray, of: AnyArray, name: str, joint: int, pivots: AnyArray) -> Table | None:
    own = points[of == name]
    if len(own) <= MIN_SAMPLES:
        return None
    low, high = own.min(axis=0), own.max(axis=0)
    origin = 0.5 * (low + high)
    if name != HEAD:
        origin[1] = low[1]
        near = points[(points[:, 1] >= low[1]) & (points[:, 1] <= high[1]) & ~np.char.endswith(of, "Foot")]
        away = near - origin
        rows = max(int(np.ceil((high[1] - low[1]) / RISE_M)), 1)
        row = away[:, 1] / RISE_M
        away[:, 1] = 0.0
    else:
        away = own - origin
        rows = UP
        row = np.arccos(np.clip(-away[:, 1] / np.linalg.norm(away, axis=1), -1.0, 1.0)) / np.pi * UP
    radii = np.zeros((rows, AROUND))
    column = np.round(np.arctan2(away[:, 2], away[:, 0]) / (2 * np.pi) * AROUND).astype(np.int64) % AROUND
    at = np.clip(row.astype(np.int64), 0, rows - 1), column
    np.maximum.at(radii, at, np.linalg.norm(away, axis=1))
    if (radii > 0.0).mean() < MIN_FILLED_FRACTION:
        return None
    source = SPORT_SKELETON.index(name)
    return Table(joint, source, origin - pivots[joint], _filled(radii), name == HEAD)


def _filled(radii: AnyArray) -> AnyArray:
    """Fill empty entries from their neighbours around the axis, then from neighbouring rows."""
    filled = radii.copy()
    for r, row in enumerate(radii):
        known = np.flatnonzero(row > 0.0)
        if len(known) >= AROUND // 4:
            filled[r] = np.interp(np.arange(AROUND), known, row[known], period=AROUND)
    whole = np.flatnonzero((filled > 0.0).all(axis=1))
    if len(whole):
        for column in range(AROUND):
            filled[:, column] = np.interp(np.arange(len(filled)), whole, filled[whole, column])
    return filled
