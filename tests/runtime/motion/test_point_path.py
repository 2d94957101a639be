"""Paths of points: followed on every leg with its gait, to the end, and given up where there is no way on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.controls import Gait
from runtime.errors import UsageError
from runtime.motion.control_scripts import PathWalk, PlanarPose, PointPath, Waypoint
from runtime.motion.controller import Controller
from runtime.terrain.height_map import Terrain
from tests.helpers.shipped import shipped_model

HERE = PlanarPose(0.0, 0.0, 0.0)
COORDINATES = st.floats(-8.0, 8.0)


def slide(walk: PathWalk, seconds: float, metres_per_second: float = 1.4) -> list[tuple[float, float, Gait]]:
    """A point without inertia that goes where the stick says."""
    x, z, rows = 0.0, 0.0, []
    for frame in range(round(seconds * 60)):
        controls = walk(frame / 60, PlanarPose(x, z, 0.0))
        x += controls.move[0] * metres_per_second / 60
        z += controls.move[1] * metres_per_second / 60
        rows.append((x, z, controls.gait))
    return rows


def test_every_leg_has_its_gait_and_the_crossing_is_not_cut() -> None:
    points = Waypoint(0.0, 6.0), Waypoint(3.0, 3.0, 0.5, Gait.CROUCH), Waypoint(-3.0, 3.0, 1.0, Gait.JOG)
    path = PointPath(points)
    walk = path.walk_from(HERE)
    rows = slide(walk, 20.0)
    assert walk.arrived
    assert list(dict.fromkeys(gait for *_, gait in rows)) == [Gait.WALK, Gait.CROUCH, Gait.JOG]
    for point in path.points:
        assert min(np.hypot(x - point.x, z - point.z) for x, z, _ in rows) < 0.6
    assert np.hypot(rows[-1][0] + 3.0, rows[-1][1] - 3.0) < 0.5


@given(st.lists(st.tuples(COORDINATES, COORDINATES), min_size=1, max_size=5))
def test_any_path_is_walked_to_its_end(points: list[tuple[float, float]]) -> None:
    walk = PointPath(tuple(Waypoint(*point) for point in points)).walk_from(HERE)
    rows = slide(walk, 3.0 + float(walk.ends[-1]))
    assert walk.arrived
    assert np.hypot(rows[-1][0] - points[-1][0], rows[-1][1] - points[-1][1]) < 0.7


def test_a_blocked_walk_ends() -> None:
    walk = PointPath((Waypoint(0.0, 6.0),)).walk_from(HERE)
    for frame in range(300):
        controls = walk(frame / 60, HERE)
    assert walk.stuck
    assert not walk.arrived
    assert controls.move == (0.0, 0.0)


def test_what_is_no_path_is_refused() -> None:
    with pytest.raises(UsageError, match="path of 0 points"):
        PointPath(())
    with pytest.raises(UsageError, match="speed 0"):
        Waypoint(0.0, 0.0, 0.0)


def test_the_character_follows_it() -> None:
    controller = Controller(shipped_model(), Terrain.flat())
    walk = PointPath((Waypoint(0.0, 2.0), Waypoint(1.5, 2.0))).walk_from(HERE)
    pose, places = controller.pose, []
    for frame in range(60 * 12):
        x, _, z = (float(v) for v in pose.root_position)
        pose = controller.step(walk(frame / 60, PlanarPose(x, z, pose.root_yaw)))
        places.append((x, z))
        if walk.ended:
            break
    assert walk.arrived
    assert min(np.hypot(x - 0.0, z - 2.0) for x, z in places) < 0.7
