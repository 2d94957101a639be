"""Motion matching in place of the networks: a database searched ten times per second, with inertialised transitions.

Clavet (2016), as described by Holden et al. (2020), "Learned Motion Matching", Sec. 3: the feature vector of a frame has the
future path (positions and directions 20, 40 and 60 frames ahead), feet positions, and velocities of feet and hips. Playback
continues from the frame nearest to the requested path and the current pose. At a transition the pose difference is kept as
an offset that decays (Bollo 2018, a critically damped spring with a half-life).

The interface is that of `MotionModel`, so that controller, foot lock, terrain and viewer are shared with the networks. A
model is stateless: the playing frame and the recent transitions are stored in the phase vectors passed from frame to frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.easing import spring
from runtime.errors import ModelError
from runtime.motion import features
from runtime.motion.features import FPS, INPUT, OutputParts, build_output
from runtime.motion.style import Style
from runtime.safe_read import open_npz
from runtime.skeleton import SPORT_SKELETON, J
from runtime.terrain.obstacle_detection import ObstacleAhead

Indices = NDArray[np.integer]

KIND = "motion matching"  # of metadata.json
DATABASE = "database.npz"
STEP = 2  # frames of 1/60 s between rows
SEARCH_FRAMES = 6  # ten searches a second
HALF_LIFE_S = 0.1  # of the offset after a transition
CHANGE_FRAMES = 42  # after seven half-lives less than a thousandth is left
CHANGES = 8  # simultaneous transitions: `CHANGE_FRAMES` contain seven searches
# A position in the database is stored as two numbers below `runtime.motion.frame.MAX_OUTPUT`, the limit of outputs.
PLACES, HIGH = 9_000, 90
MAX_ROWS = PLACES * HIGH // STEP  # of a database, 225 minutes
NEAR_ROWS = 10  # a row this close to the current one is not a transition
FORECAST = features.FUTURE_OFFSETS  # frames

_FEET = (SPORT_SKELETON.index("LeftFoot"), SPORT_SKELETON.index("RightFoot"))
# columns of a feature vector and their weights, from Holden's reference implementation; the gait label is our addition
GROUPS: dict[str, tuple[slice, float]] = {
    "positions": (slice(0, 6), 1.0),
    "directions": (slice(6, 12), 1.5),
    "feet": (slice(12, 18), 0.75),
    "foot velocities": (slice(18, 24), 1.0),
    "hip velocity": (slice(24, 27), 1.0),
    "gait": (slice(27, 33), 1.0),
}
SIZE = 33
POSE = np.r_[12:27]  # columns of the current pose


def feature_vectors(x: Array, joints: Array, velocities: Array) -> Array:
    """Return features `(..., 33)` of inputs x `(..., 342 or more)` with joints and their velocities `(..., 31, 3)`.

    The window of x ends 50 frames ahead; the position 60 frames ahead is extrapolated from 40 and 50.
    """
    lead = x.shape[:-1]
    ahead = x[..., INPUT["trajectory_positions"]].reshape(*lead, features.L, 2)
    facing = x[..., INPUT["trajectory_directions"]].reshape(*lead, features.L, 2)
    gait = x[..., INPUT["gait"]].reshape(*lead, features.L, features.GAITS)
    present = features.L // 2
    at = [present + 2, present + 4, present + 5]  # 20, 40 and 50 frames ahead
    places, directions = ahead[..., at, :], facing[..., at, :]
    places = np.concatenate([places[..., :2, :], 2.0 * places[..., 2:, :] - places[..., 1:2, :]], axis=-2)
    last = 2.0 * directions[..., 2:, :] - directions[..., 1:2, :]
    last = last / np.maximum(np.linalg.norm(last, axis=-1, keepdims=True), 1e-9)
    directions = np.concatenate([directions[..., :2, :], last], axis=-2)
    parts = [places, directions, joints[..., _FEET, :], velocities[..., _FEET, :], velocities[..., 0, :]]
    flat = [p.reshape(*lead, -1) for p in (*parts, gait[..., present, :])]
    return np.concatenate(flat, axis=-1).astype(np.float32)


def scales(rows: Array) -> tuple[Array, Array]:
    """Return mean `(33,)` and weight over deviation `(33,)`; the columns of a group share their mean deviation."""
    mean, deviation = rows.mean(0), rows.std(0)
    scale = np.zeros(SIZE, np.float32)
    for columns, weight in GROUPS.values():
        scale[columns] = weight / max(float(deviation[columns].mean()), 1e-6)
    return mean.astype(np.float32), scale


@dataclass(frozen=True)
class Database:
    """Rows of many clips, 1/30 s apart, concatenated."""

    features: Array  # (F, 33), not normalised
    world: Array  # (F, 31, 4) root-relative rotations
    hips: Array  # (F, 3) metres, above the reference ground
    root: Array  # (F, 3) m/s, m/s, rad/s
    contacts: NDArray[np.uint8]  # (F, 4)
    last: Indices  # (F,) last row of each row's clip
    style: Indices  # (F,) index into `styles`
    styles: tuple[str, ...]
    codes: Array  # (M, 6, 64) Z^t of descriptions
    code_style: Indices  # (M,)
    speeds: Array  # (S, 2) walk and jog, m/s

    @staticmethod
    def load(path: Path) -> Database:
        """Load a database; ModelError if the file is invalid."""
        with open_npz(
            path, "Build it again with `python -m training.ablations --only motion-matching`.", ModelError
        ) as found:
            floats = {k: found[k].astype(np.float32) for k in ("features", "hips", "root", "codes", "speeds")}
            base = Database(
                **floats,
                world=found["world"],
                contacts=found["contacts"],
                last=found["last"].astype(np.int64),
                style=found["style"].astype(np.int64),
                styles=tuple(str(s) for s in found["styles"]),
                code_style=found["code_style"].astype(np.int64),
            )
            base.check()
        return base

    def save(self, path: Path) -> None:
        """Write the database, in half precision where that suffices: rotations are accurate to 0.05 degrees."""
        kinds: dict[str, Any] = dict.fromkeys(("world", "root", "codes", "features"), np.float16)
        kinds |= {"hips": np.float32, "speeds": np.float32, "contacts": np.uint8}
        kinds |= {"last": np.int32, "style": np.int16, "code_style": np.int16}
        arrays = {name: getattr(self, name).astype(kind) for name, kind in kinds.items()}
        np.savez_compressed(path, **arrays, styles=np.array(self.styles))

    def check(self) -> None:
        """Raise ValueError for inconsistent arrays."""
        rows, names = len(self.last), len(self.styles)
        shapes = {
            "features": (rows, SIZE), "world": (rows, J, 4), "hips": (rows, 3), "root": (rows, 3), "contacts": (rows, 4),
            "last": (rows,), "style": (rows,), "codes": (len(self.codes), 6, 64), "code_style": (len(self.codes),),
            "speeds": (names, 2),
        }  # fmt: skip
        finite = ("features", "hips", "root", "speeds", "world")
        order = np.arange(rows)
        sound = (
            all(getattr(self, name).shape == shape for name, shape in shapes.items())
            and min(rows // 4, names, len(self.codes)) > 0
            and bool(((self.last >= order) & (self.last < rows)).all())
            and {*self.style.tolist(), *self.code_style.tolist()} <= set(range(names))
            and all(np.isfinite(getattr(self, name)).all() for name in finite)
        )
        if not sound:
            raise ValueError("inconsistent arrays")


@dataclass(frozen=True)
class Playing:
    """Playback state of one character: position in the database, frames since the last search, active transitions.

    Positions count frames of 1/60 s; a transition is (position left, position entered, frames since).
    """

    place: int = -1  # -1: none yet
    since_search: int = 0
    changes: tuple[tuple[int, int, int], ...] = ()

    def packed(self) -> Array:
        """Encode the state in the amplitudes of the 35 present and future phase vectors `(7, 5, 2)`."""
        high, low = divmod(self.place, PLACES)
        numbers = [high, low, self.since_search]
        for left, entered, since in self.changes:
            (high_a, low_a), (high_b, low_b) = divmod(left, PLACES), divmod(entered, PLACES)
            numbers += [100 * high_a + high_b, low_a, low_b, since]
        amplitude = np.zeros(7 * features.C)
        amplitude[: len(numbers)] = np.array(numbers) + 1
        return np.stack([np.zeros_like(amplitude), amplitude], -1).reshape(7, features.C, 2)

    @staticmethod
    def unpacked(phase: Array) -> Playing:
        """Decode the phase vectors `(13, 5, 2)` of an input; zeros mean that nothing is played."""
        amplitude = np.linalg.norm(phase[features.L // 2 :].reshape(-1, 2), axis=-1)
        high, low, since_search, *rest = (np.rint(amplitude).astype(int) - 1).tolist()
        if min(high, low) < 0:
            return Playing()
        rows = np.reshape(rest[: 4 * CHANGES], (-1, 4)).tolist()
        changes = tuple(
            (highs // 100 * PLACES + a, highs % 100 * PLACES + b, since)
            for highs, a, b, since in rows
            if min(highs, a, b, since) >= 0
        )
        return Playing(high * PLACES + low, max(0, since_search), changes)


class MatchingModel:
    """A database with the interface of `MotionModel`; deterministic, without noise."""

    def __init__(self, folder: Path, metadata: dict[str, Any], database: Database | None = None) -> None:
        self.folder, self.metadata = folder, metadata
        self.name = str(metadata["name"])
        self.precision, self.provider = "fp32", "database"
        self.noise_shape = (1, 1, 1)
        self.batches = False  # each character has its own position in the database
        self.in_full = self
        self.style_shape = (6, 64)
        self.database = base = Database.load(folder / DATABASE) if database is None else database
        self._mean, self._scale = scales(base.features)
        self._known = (base.features - self._mean) * self._scale
        ends = base.last - np.arange(len(base.last)) >= 2  # rows with at least two successors
        self._rows = [np.flatnonzero((base.style == s) & ends) for s in range(len(base.styles))]
        self._searched = [np.ascontiguousarray(self._known[rows]) for rows in self._rows]
        self._squares = [np.square(known).sum(1) for known in self._searched]
        self._neutral = base.styles.index("neutral") if "neutral" in base.styles else 0

    @property
    def prompt_path(self) -> Path:
        """The text side of the model with which the database was built."""
        return self.folder / "prompt.onnx"

    @property
    def neutral(self) -> Array:
        """Z^t `(6, 64)` of neutral walking."""
        codes = self.database.codes[self.database.code_style == self._neutral]
        return codes[0] if len(codes) else self.database.codes[0]

    calibration = None  # captured rows have fixed sides

    def crosses(self, obstacle: ObstacleAhead) -> bool:
        """Return False: captures do not contain leaps in every style."""
        return False

    def fold_style(self, z: Array, strength: float = 1.0) -> Style:
        """Return the captured style with the descriptions nearest to Z^t `(6, 64)`; `strength` has no effect."""
        z = np.ascontiguousarray(z, np.float32)
        if z.shape != self.style_shape or not np.all(np.isfinite(z)):
            raise ModelError(
                f"Z^t: expected finite values of shape {self.style_shape}, got {z.shape}.",
                "Encode the prompt again.",
            )
        away = np.square(self.database.codes - z).sum((1, 2))
        label = int(self.database.code_style[int(np.argmin(away))])
        one_hot = np.zeros(len(self.database.styles), np.float32)
        one_hot[label] = 1.0
        walk, jog = (float(v) for v in self.database.speeds[label])
        nothing = np.zeros(1, np.float32)
        return Style(z, one_hot, nothing, nothing, walk, jog)

    def neutral_style(self, mirrored: bool) -> Style:
        """Return the captured neutral style, also for a mirrored walk: rows are never mirrored."""
        return replace(self.fold_style(self.neutral), mirrored=mirrored)

    def step(self, x: Array, noise: Array, style: Style | Sequence[Style]) -> tuple[Array, Array]:
        """Return y `(B, 473)` of inputs `(B, 472)`, and ones `(B, 1)`; `style` is shared or one per character."""
        styles = [style] * len(x) if isinstance(style, Style) else style
        y = np.concatenate([self._frame(row, one) for row, one in zip(x, styles, strict=True)])
        return y, np.ones((len(x), 1), np.float32)

    def output_of(self, row: int) -> Array:
        """Return y `(473,)` of a row, without transitions."""
        place = np.array(STEP * row)
        y = self._output(*self._at(place), Playing(STEP * row))[0]
        y[features.OUTPUT["phase"]] = 0.0
        return y

    # --- one character ------------------------------------------------------------------------------------------------

    def _frame(self, x: Array, style: Style) -> Array:
        phase = x[INPUT["phase"]].reshape(features.L + 1, features.C, 2)
        playing = self._advanced(Playing.unpacked(phase), x, int(np.argmax(style.front_bias)))
        world, hips, root = self._at(np.array(playing.place))
        # from the newest to the oldest transition: each started from the pose shown at its time
        if playing.changes:
            turns, moved, way = self._left_over(*np.array(playing.changes).T)
            for turn in turns[::-1]:
                world = rotations.multiply(turn, world)
            hips, root = hips + moved, root + way
        return self._output(world, hips, root, playing)

    def _advanced(self, playing: Playing, x: Array, label: int) -> Playing:
        """Advance playback by one frame, or jump to a nearer frame found by a search."""
        base = self.database
        if not 0 <= playing.place < STEP * len(base.last):
            return Playing(STEP * self._nearest(self._query(x, None), label), 0, ())
        last = STEP * int(base.last[playing.place // STEP])
        place, since = min(playing.place + 1, last), playing.since_search + 1
        changes = tuple((a, b, n + 1) for a, b, n in playing.changes if n < CHANGE_FRAMES)
        if since < SEARCH_FRAMES and place < last:
            return Playing(place, since, changes)
        row = place // STEP
        query = self._query(x, row)
        found = self._nearest(query, label)
        if place < last and base.style[row] == label and not self._is_change(row, found, query):
            return Playing(place, 0, changes)
        return Playing(STEP * found, 0, (*changes, (place, STEP * found, 0))[-CHANGES:])

    def _is_change(self, row: int, found: int, query: Array) -> bool:
        """Return whether a found row differs from the playing one and is nearer to the query."""
        near = self.database.last[found] == self.database.last[row] and abs(found - row) < NEAR_ROWS
        return not near and self._cost(row, query) > self._cost(found, query)

    def _query(self, x: Array, row: int | None) -> Array:
        """Return normalised features `(33,)`: the requested path of x, and the pose of a row (of x if nothing is played)."""
        joints = x[INPUT["joint_positions"]].reshape(J, 3)
        velocities = x[INPUT["joint_velocities"]].reshape(J, 3)
        query = (feature_vectors(x, joints, velocities) - self._mean) * self._scale
        if row is not None:
            query[POSE] = self._known[row, POSE]
        return query

    def _nearest(self, query: Array, label: int) -> int:
        """Find a style's row nearest to a query, by exhaustive search with one matrix product."""
        label = label if len(self._rows[label]) else self._neutral
        away = self._squares[label] - 2.0 * (self._searched[label] @ query)
        return int(self._rows[label][int(np.argmin(away))])

    def _cost(self, row: int, query: Array) -> float:
        return float(np.square(self._known[row] - query).sum())

    def _at(self, place: Indices) -> tuple[Array, Array, Array]:
        """Return rotations `(..., 31, 4)`, hips and root velocity `(..., 3)` at positions `(...)`, interpolated between rows."""
        base = self.database
        row, part = place // STEP, ((place % STEP) / STEP)[..., None]
        following = np.minimum(row + 1, base.last[row])
        a, b = base.world[row].astype(np.float64), base.world[following].astype(np.float64)
        b = np.where((a * b).sum(-1, keepdims=True) < 0.0, -b, b)
        world = rotations.normalize((1.0 - part[..., None]) * a + part[..., None] * b)
        hips, root = (
            (1.0 - part) * values[row] + part * values[following] for values in (base.hips, base.root)
        )
        return world, hips, root

    def _left_over(self, left: Indices, entered: Indices, frames: Indices) -> tuple[Array, Array, Array]:
        """Return the decayed offsets of transitions `(K,)`: rotations `(K, 31, 4)`, and sums for hips and root velocity."""
        (q0, h0, r0), (q1, h1, r1) = self._at(left), self._at(entered)
        before, h_before, _ = self._at(np.maximum(left - 1, 0))
        after, h_after, _ = self._at(entered + 1)
        seconds = frames[:, None] / FPS

        def turn(a: Array, b: Array) -> Array:
            return rotations.to_rotation_vector(rotations.multiply(a, rotations.inverse(b)))

        def decayed(offset: Array, velocity: Array, at: Array) -> Array:
            return spring(offset, velocity, np.zeros(3), HALF_LIFE_S, at)[0]

        turns = decayed(turn(q0, q1), FPS * (turn(q0, before) - turn(after, q1)), seconds[..., None])
        moved = decayed(h0 - h1, FPS * ((h0 - h_before) - (h_after - h1)), seconds)
        way = decayed(r0 - r1, np.zeros(3), seconds)
        return rotations.from_rotation_vector(turns), moved.sum(0), way.sum(0)

    def _output(self, world: Array, hips: Array, root: Array, playing: Playing) -> Array:
        path, directions = self._forecast(playing.place)
        parts = OutputParts(
            trajectory_positions=path,
            trajectory_directions=directions,
            joint_positions=_positions(hips, world),
            joint_velocities=np.zeros((J, 3)),
            root=root,
            contacts=self.database.contacts[playing.place // STEP].astype(np.float64),
            phase=playing.packed(),
            joint_rotations=rotations.to_6d(world),
        )
        return build_output(parts)[None]

    def _forecast(self, place: int) -> tuple[Array, Array]:
        """Return future path and directions `(6, 2)` of the clip, relative to the next frame, extrapolated beyond its end."""
        base = self.database
        rows = np.minimum(place // STEP + np.arange(FORECAST[-1] // STEP + 1), int(base.last[place // STEP]))
        velocity = base.root[rows].astype(np.float64)
        yaw = np.concatenate([[0.0], np.cumsum(velocity[:-1, 2])]) * STEP / FPS
        steps = features.to_world(velocity[:, :2], yaw) * STEP / FPS
        way = np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:-1], axis=0)])
        at = FORECAST // STEP
        return way[at], np.stack([np.sin(yaw[at]), np.cos(yaw[at])], -1)


def _positions(hips: Array, world: Array) -> Array:
    """Return root-relative joints `(31, 3)`."""
    bones = rotations.rotate(world[list(SPORT_SKELETON.parents[1:])], SPORT_SKELETON.offsets[1:])
    positions = np.zeros((J, 3))
    positions[0] = hips
    for joint in range(1, J):
        positions[joint] = positions[SPORT_SKELETON.parents[joint]] + bones[joint - 1]
    return positions
