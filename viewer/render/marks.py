"""Overlays and contact shadows as arrays of strokes, and the pass that draws them."""

import moderngl
import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.pose import Pose
from runtime.skeleton import ANKLE_HEIGHT, PART_JOINTS, SPORT_SKELETON, TOE_HEIGHT
from runtime.terrain.height_map import Terrain
from viewer.render.gl import load_program, release, upload
from viewer.render.overlays import PathOverlay, PinOverlay, TrailOverlay, TrajectoryOverlay

Strokes = NDArray[np.void]

STROKE = np.dtype(
    [("start", "<f4", 3), ("end", "<f4", 3), ("normal", "<f4", 3), ("radius", "<f4", 2), ("color", "<f4", 4)]
)

# Radii in metres on the ground, on top in pixels of a frame 720 high; colours sRGB.
FOOT_RADIUS_M = 0.145
FOOT_SHADE_WEIGHT = 0.60
BODY_RADIUS_M = 0.60
BODY_SHADE_WEIGHT = 0.16
DOT_RADIUS_M = 0.038
LINE_RADIUS_M, LINE_PIECES = 0.014, 4  # of the trajectory; segments between two samples
TICK_RADIUS_M = 0.009
TICK_LENGTH_M = 0.055  # to each side
CONTACT_RADIUS_M = 0.075
PATH_RADIUS_M = 0.02
PATH_STEP_M = 0.25
BONE_RADIUS_PX = 1.6
JOINT_RADIUS_PX = 3.2
OUTLINE_PX = 1.3
TRAIL_RADIUS_PX = 1.4
PIN_RADIUS_PX, RAIL_RADIUS_PX = 5.0, 1.8
REFERENCE_HEIGHT_PX = 720

PAST = (0.36, 0.40, 0.45)
FUTURE = (0.05, 0.47, 0.86)
LEFT = (0.00, 0.56, 0.60)
RIGHT = (0.91, 0.38, 0.05)
MIDDLE = (0.20, 0.24, 0.30)
OUTLINE = (1.0, 1.0, 1.0, 0.85)
PIN = (0.86, 0.20, 0.46)
FREE = (0.45, 0.48, 0.52)
TOUCHING = (0.10, 0.76, 0.30)
SPEED_COLORS = (
    (0.13, 0.38, 0.92),
    (0.10, 0.72, 0.66),
    (0.62, 0.80, 0.16),
    (0.98, 0.62, 0.10),
    (0.92, 0.18, 0.14),
)
FAST_M_PER_S = 4.0  # speed of the last of them

CONTACT_JOINTS = ("LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase")  # in the order of Pose.contacts
CONTACT_INDICES = [SPORT_SKELETON.index(name) for name in CONTACT_JOINTS]
SOLE_HEIGHTS = np.array([ANKLE_HEIGHT, TOE_HEIGHT, ANKLE_HEIGHT, TOE_HEIGHT], np.float32)


def make_strokes(
    start: Array, end: Array, radius: float, color: Array | tuple[float, ...], hole: float = 0.0
) -> Strokes:
    """Return `(n,)` strokes from `start` to `end` `(n, 3)`; `color` is `(4,)` or `(n, 4)`."""
    strokes = np.zeros(len(start), STROKE)
    strokes["start"], strokes["end"] = start, end
    strokes["radius"] = radius, hole
    strokes["color"] = color
    return strokes


def trajectory_strokes(trajectory: TrajectoryOverlay, terrain: Terrain) -> Strokes:
    """Return a line through the trajectory samples on the terrain with a tick at each; grey in the past, blue with an arrow ahead."""
    places = np.asarray(trajectory.positions, np.float32)[:, [0, 2]]
    facing = np.asarray(trajectory.directions, np.float32)
    past = np.asarray(trajectory.past, bool)
    even = np.linspace(0.0, len(places) - 1.0, LINE_PIECES * (len(places) - 1) + 1)
    fine = np.stack([_smooth(places[:, k], even) for k in (0, 1)], -1)
    colors = np.where(past[:, None], (*PAST, 0.75), (*FUTURE, 0.95)).astype(np.float32)
    line = _on_terrain(fine, terrain)
    legs = make_strokes(line[:-1], line[1:], LINE_RADIUS_M, colors[np.int64(np.floor(even[:-1]))])
    apart = np.linalg.norm(np.diff(places, axis=0), axis=1)
    marked = np.flatnonzero(apart[:-1] > TICK_LENGTH_M) + 1  # ticks of a standing character would overlap
    across = TICK_LENGTH_M * np.stack([facing[:, 1], -facing[:, 0]], -1)
    ends = [_on_terrain(places[marked] + side * across[marked], terrain) for side in (-1.0, 1.0)]
    ticks = make_strokes(ends[0], ends[1], TICK_RADIUS_M, colors[marked])
    tip, back = places[-1], np.array([1.0, -1.0])[:, None] * across[-1] - TICK_LENGTH_M * facing[-1]
    head = _on_terrain(np.stack([tip + 1.6 * back[0], tip, tip + 1.6 * back[1]]), terrain)
    arrow = make_strokes(head[[0, 2]], head[[1, 1]], LINE_RADIUS_M, colors[-1])
    return _laid(np.concatenate([legs, ticks, arrow]), "start", terrain, 0.15)


def _smooth(values: Array, at: Array) -> Array:
    """Return a Catmull-Rom curve through values, at fractions of their indices."""
    padded = np.concatenate([2 * values[:1] - values[1:2], values, 2 * values[-1:] - values[-2:-1]])
    index = np.minimum(at.astype(int), len(values) - 2)
    t, (a, b, c, d) = at - index, (padded[index + k] for k in range(4))
    return np.asarray(b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a))))


def path_strokes(path: PathOverlay, terrain: Terrain) -> Strokes:
    """Return a path as lines on the terrain, with a dot at each point, larger for the selected one."""
    corners = np.asarray(path.points, np.float32)
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    even = np.linspace(0.0, lengths[-1], 2 + int(lengths[-1] / PATH_STEP_M))
    places = np.stack([np.interp(even, lengths, corners[:, k]) for k in (0, 1)], -1)
    line, dots = _on_terrain(places, terrain), _on_terrain(corners, terrain)
    legs = make_strokes(line[:-1], line[1:], PATH_RADIUS_M, (*FUTURE, 0.8))
    points = make_strokes(dots, dots, 2.4 * DOT_RADIUS_M, (*FUTURE, 1.0))
    if path.selected >= 0:
        points["radius"][path.selected, 0] = 3.6 * DOT_RADIUS_M
    return _laid(np.concatenate([legs, points]), "end", terrain, 0.15)


def contact_strokes(pose: Pose, terrain: Terrain) -> Strokes:
    """Return a ring on the ground under each heel and toe, filled green while in contact."""
    places = _on_terrain(pose.positions[CONTACT_INDICES][:, [0, 2]], terrain)
    size, hole = CONTACT_RADIUS_M, 0.8 * CONTACT_RADIUS_M
    ring = make_strokes(places, places, size, _contact_colors(pose, 0.4, 0.6), hole)
    fill = make_strokes(places, places, hole, _contact_colors(pose, 0.0, 0.45))
    return _laid(np.concatenate([fill, ring]), "start", terrain)


def contact_dots(pose: Pose, pixel_scale: float) -> Strokes:
    """Return a dot on top of everything at each heel and toe, green while in contact."""
    places, size = _soles(pose), 1.3 * JOINT_RADIUS_PX * pixel_scale
    rim = make_strokes(places, places, size + OUTLINE_PX * pixel_scale, OUTLINE)
    return np.concatenate([rim, make_strokes(places, places, size, _contact_colors(pose, 0.55, 0.45))])


def _soles(pose: Pose) -> Array:
    """Return the points `(4, 3)` of heels and toes on the ground, in the order of `Pose.contacts`."""
    return pose.positions[CONTACT_INDICES] - SOLE_HEIGHTS[:, None] * (0.0, 1.0, 0.0)


def _contact_colors(pose: Pose, opacity: float, more: float) -> Array:
    """Return colours `(4, 4)` from free to in contact, with opacity increased by `more` in contact."""
    bearing = np.clip(pose.contacts, 0.0, 1.0)[:, None]
    color = np.array(FREE) + (np.array(TOUCHING) - np.array(FREE)) * bearing
    return np.hstack([color, opacity + more * bearing])


def skeleton_strokes(pose: Pose, pixel_scale: float) -> Strokes:
    """Return bones and joints on top of everything: left teal, right orange, the middle dark, with a light outline."""
    offsets = np.linalg.norm(SPORT_SKELETON.offsets, axis=1)
    pairs = [(j, p) for j, p in enumerate(SPORT_SKELETON.parents) if p >= 0 and offsets[j] > 1e-4]
    child, parent = np.array(pairs).T
    colors = _joint_colors()[child]
    start, end = pose.positions[parent], pose.positions[child]
    bone, dot, rim = (size * pixel_scale for size in (BONE_RADIUS_PX, JOINT_RADIUS_PX, OUTLINE_PX))
    return np.concatenate(
        [
            make_strokes(start, end, bone + rim, OUTLINE),
            make_strokes(end, end, dot + rim, OUTLINE),
            make_strokes(start, end, bone, colors),
            make_strokes(end, end, dot, colors),
        ]
    )


def trail_strokes(trails: TrailOverlay, pixel_scale: float) -> Strokes:
    """Return a line per joint on top of everything, coloured by speed from blue through green to red; the future is paler."""
    points, speeds = np.asarray(trails.points, np.float32), np.asarray(trails.speeds, np.float32)
    steps, joints = len(points) - 1, points.shape[1]
    if steps < 1:
        return make_strokes(np.zeros((0, 3)), np.zeros((0, 3)), 1.0, OUTLINE)
    stops = np.linspace(0.0, FAST_M_PER_S, len(SPEED_COLORS))
    rgb = [np.interp(speeds[1:], stops, np.array(SPEED_COLORS)[:, k]) for k in range(3)]
    ahead = (np.arange(steps) >= trails.now)[:, None]
    alpha = np.where(ahead, 0.45, 0.95) * np.ones((1, joints))
    colors = np.stack([*rgb, alpha], -1).reshape(-1, 4)
    start, end = points[:-1].reshape(-1, 3), points[1:].reshape(-1, 3)
    return make_strokes(start, end, TRAIL_RADIUS_PX * pixel_scale, colors)


def pin_strokes(pins: PinOverlay, pixel_scale: float) -> Strokes:
    """Return a dot at each pin on top of everything, larger if selected, and lines for rails."""
    size, rim = PIN_RADIUS_PX * pixel_scale, OUTLINE_PX * pixel_scale
    places, rails = np.asarray(pins.points, np.float32), np.asarray(pins.rails, np.float32)
    dots = make_strokes(places, places, size, (*PIN, 1.0))
    around = make_strokes(places, places, size + rim, OUTLINE)
    dots["radius"][pins.selected, 0] *= 1.4
    around["radius"][pins.selected, 0] += 0.4 * size + rim
    lines = make_strokes(rails[:, 0], rails[:, 1], RAIL_RADIUS_PX * pixel_scale, (*PIN, 0.85))
    return np.concatenate([lines, around, dots])


def marks_of(pose: Pose) -> Array:
    """Return the contact shadows of a pose `(2, 3, 4)`: heels with radius, then toes with strength, of both feet and the body."""
    soles = _soles(pose).reshape(2, 2, 3).swapaxes(0, 1)
    places = np.concatenate([soles, np.tile(pose.root_position, (2, 1, 1))], axis=1)
    sizes = (
        [FOOT_RADIUS_M, FOOT_RADIUS_M, BODY_RADIUS_M],
        [FOOT_SHADE_WEIGHT, FOOT_SHADE_WEIGHT, BODY_SHADE_WEIGHT],
    )
    return np.concatenate([places, np.array(sizes)[..., None]], axis=-1).astype(np.float32)


def _on_terrain(places: Array, terrain: Terrain) -> Array:
    """Return the points `(n, 3)` of the ground at `places` `(n, 2)`, x and z."""
    x, z = places.T
    return np.stack([x, terrain.height(x, z), z], -1)


def _laid(strokes: Strokes, place: str, terrain: Terrain, reach_m: float = 0.05) -> Strokes:
    """Return the strokes laid on the sloping ground at their `place` ("start" or "end")."""
    at = strokes[place]
    strokes["normal"] = terrain.normal(at[:, 0], at[:, 2], reach_m=reach_m)
    return strokes


def _joint_colors() -> Array:
    colors = np.tile(np.array([*MIDDLE, 1.0], np.float32), (len(SPORT_SKELETON), 1))
    for part, joints in PART_JOINTS.items():
        if part.startswith(("left", "right")):
            colors[list(joints), :3] = LEFT if part.startswith("left") else RIGHT
    return colors


class OverlayPass:
    """Draws overlay strokes and dots with soft edges."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._strokes = ctx.buffer(reserve=STROKE.itemsize, dynamic=True)
        layout = (self._strokes, "3f4 3f4 3f4 2f4 4f4 /i", *(f"in_{name}" for name in STROKE.names or ()))
        top_layout = (self._strokes, "3f4 3f4 12x 2f4 4f4 /i", "in_start", "in_end", "in_radius", "in_color")
        on_ground, on_top = (
            load_program(ctx, "stroke.vert", "stroke.frag", {"ON_GROUND": flag}) for flag in (1, 0)
        )
        self._on_ground = ctx.vertex_array(on_ground, [layout])
        self._on_top = ctx.vertex_array(on_top, [top_layout])

    def draw_on_ground(self, strokes: Strokes) -> None:
        """Draw strokes with radii in metres, hidden by objects in front."""
        self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        self._ctx.depth_func = "<="
        self._draw(self._on_ground, strokes)

    def draw_on_top(self, strokes: Strokes) -> None:
        """Draw strokes with radii in pixels, on top of everything."""
        self._ctx.enable_only(moderngl.BLEND)
        self._draw(self._on_top, strokes)

    def _draw(self, array: moderngl.VertexArray, strokes: Strokes) -> None:
        if len(strokes):
            self._ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
            upload(self._strokes, strokes.tobytes())
            array.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(strokes))

    def release(self) -> None:
        release(self._on_ground, self._on_top, self._strokes)
