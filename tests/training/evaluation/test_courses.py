"""Obstacle courses: measures on made-up motion with known depths, and the command with a synthetic walker."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from runtime.controls import Gait
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.courses import BEAM, BEAM_RAMP_M, GAPS, HURDLES, WALLS, Obstacle
from runtime.terrain.height_map import Terrain
from tests.helpers.walker import WalkerModel, settle_soon, walk
from training.evaluation.metrics import traversal
from training.evaluation.metrics.traversal import capsule_points, depth_inside, limb_depths
from training.evaluation.on_obstacles import COURSES, markdown, score_obstacles

BLOCK = Obstacle(2.0, 4.0, 1.0, 3.0)


def block():
    """Level ground with a block of 1 m between z = 2 and 4."""
    axis = np.arange(-200, 201) * 0.05
    heights = np.where((axis >= 2.0 - 1e-6) & (axis <= 4.0 + 1e-6), 1.0, 0.0)
    return Terrain("block", np.repeat(heights[None], 401, 0).astype(np.float32), 0.05, (-10.0, -10.0))


def standing(frames=30, z=0.0, height=0.0):
    """World joints `(T, 31, 3)` of somebody who stands at z, and contacts of both whole feet."""
    hips, local, _ = walk(1)
    positions = SPORT_SKELETON.forward_kinematics(hips, local)[0].astype(np.float64)
    return np.repeat(positions, frames, 0) + np.array([0.0, height, z]), np.ones((frames, 4))


def test_depth_is_the_shortest_way_out():
    ground = block()
    points = np.array([[0, 0.7, 3.0], [0, 0.4, 2.1], [0, 0.5, 1.0], [0, -0.25, 0.0], [0, 0.95, 2.04]])
    assert depth_inside(points, ground) == pytest.approx([0.3, 0.135, 0.0, 0.25, 0.05], abs=0.02)


def test_a_capsule_surrounds_its_bone():
    positions, _ = standing(2)
    points = capsule_points(positions, 2, 3, 0.06)
    a, b = positions[:, None, 2], positions[:, None, 3]
    along = ((points - a) * (b - a)).sum(-1) / np.square(b - a).sum(-1)
    away = np.linalg.norm(points - a - along[..., None] * (b - a), axis=-1)
    assert away == pytest.approx(0.06)
    assert (along.min(), along.max()) == pytest.approx((0.0, 1.0))


def test_limbs_in_a_wall_are_seen_and_those_beside_it_are_not():
    ground = block()
    positions, _ = standing(z=-1.0)
    assert max(v.max() for v in limb_depths(positions, ground).values()) < 1e-3
    for knee, ankle in ((3, 4), (8, 9)):
        positions[:, knee], positions[:, ankle] = [0.0, 0.5, 2.1], [0.0, 0.1, 2.1]
    # the face slants from z = 1.95 to 2, the shin has 4.5 cm around its bone
    depth = limb_depths(positions, ground)
    assert depth["shins"].max() == pytest.approx(2.1 + 0.045 - 1.955, abs=0.02)
    assert depth["hands"].max() < 1e-3


def test_depths_of_a_figure_sunk_by_a_known_amount():
    positions, _ = standing(height=-0.10)
    figures = traversal.depths(positions, Terrain.flat(), np.ones(len(positions), bool))
    exact, _ = standing()
    resting = traversal.depths(exact, Terrain.flat(), np.ones(len(exact), bool))
    assert figures["sole_p99"] - resting["sole_p99"] == pytest.approx(10.0, abs=0.5)
    assert figures["joint_max"] == pytest.approx(10.0 - 2.8, abs=1.5)  # the toe joint
    assert figures["joint_inside"] == 1.0
    assert resting["joint_deep"] == 0.0
    assert traversal.depths(exact, Terrain.flat(), np.zeros(len(exact), bool)) == {}


def test_clearance_is_that_of_the_lowest_point_over_the_bar():
    bar = HURDLES[0]
    positions, _ = standing(z=bar.begin, height=bar.top + 0.12)
    track = positions - [0.0, 0.0, 1.0]
    track[:, [5, 10], 2] = bar.begin + 0.05  # both toes over the bar, the heels before it
    assert traversal.clearances(track, HURDLES) == pytest.approx([12.0, 12.0], abs=1.5)
    assert traversal.clearances(track + np.array([0.0, 0.0, 1.0]), HURDLES) == []


def test_contacts_on_a_beam_and_falls():
    positions, contacts = standing(z=8.0, height=BEAM.top)
    on, beside = traversal.beam_contacts(positions, contacts, BEAM, BEAM_RAMP_M)
    assert (on, beside) == (120, 0)  # feet at 7.5 cm from the middle
    away = positions + np.array([0.1, 0.0, 0.0])  # the left foot at 17.5, the right at 2.5 cm
    assert traversal.beam_contacts(away, contacts, BEAM, BEAM_RAMP_M) == (60, 60)
    assert traversal.falls(away, contacts, BEAM, BEAM_RAMP_M) == 0
    away[10:20, :, 1] -= BEAM.top
    assert traversal.falls(away, contacts, BEAM, BEAM_RAMP_M) == 1


def test_hands_count_where_both_rest_on_the_edge():
    wall = WALLS[1]
    positions, _ = standing(120, z=wall.begin - 0.4)
    for hand in traversal.HANDS:
        positions[30:75, hand, 1:] = [wall.top + 0.02, wall.begin + 0.03]
    seconds = traversal.hands_on_edge(positions, WALLS)
    assert seconds == pytest.approx([0.0, 0.75, 0.0], abs=0.05)


def test_time_and_pace_over_an_obstacle():
    z = np.concatenate([np.linspace(0.0, 2.0, 121), np.full(60, 2.0), np.linspace(2.0, 6.0, 241)])
    seconds, slowest = traversal.seconds_over(np.stack([0 * z, z], -1), BLOCK)
    assert seconds == pytest.approx(0.5 + 1.0 + 2.5, abs=0.1)
    assert slowest == pytest.approx(0.0, abs=0.01)
    assert traversal.seconds_over(np.stack([0 * z, 0.5 * z], -1), BLOCK) is None


def test_a_gap_is_flown_over_or_stepped_into():
    first, second = GAPS[2:4]
    frames = 60
    z = np.linspace(first.end - 0.8, second.begin + 0.8, frames)
    standing_still, contacts = standing(frames, height=first.top)
    track = standing_still + np.stack([0 * z, 0 * z, z], -1)[:, None]
    lifted, free = track.copy(), contacts.copy()
    lifted[20:45, :, 1] += 0.1
    free[20:45] = 0.0
    assert traversal.flights(lifted, free, [(first, second)]) == (1, 1)
    sunk = track.copy()
    sunk[20:45, :, 1] -= first.top
    assert traversal.flights(sunk, contacts, [(first, second)]) == (0, 0)


def test_a_figure_that_glides_is_frozen():
    positions, _ = standing(181)
    z = np.arange(181) / 60.0
    root = np.stack([0 * z, z], -1)
    glides = positions + np.stack([0 * z, 0 * z, z], -1)[:, None]
    assert traversal.frozen_seconds(glides, root, np.full(181, 1.0)) == 3
    hips, local, _ = walk(181)
    walks = SPORT_SKELETON.forward_kinematics(hips, local)[0]
    assert traversal.frozen_seconds(walks, hips[:, [0, 2]], np.full(181, 1.1)) == 0


@pytest.mark.parametrize("course", COURSES, ids=lambda c: c.name)
def test_every_course_begins_on_level_ground_before_it(course):
    ground = course.terrain()
    assert ground.height(np.zeros(5), np.linspace(-0.5, 1.5, 5)) == pytest.approx(np.zeros(5), abs=0.02)
    for obstacle in course.obstacles:
        middle = 0.5 * (obstacle.begin + obstacle.end)
        if course.name in ("hurdles", "platforms", "wall", "beam"):
            assert float(ground.height(0.0, middle)) == pytest.approx(obstacle.top)


@pytest.fixture(scope="module")
def results():
    """A walker at a wall of 60 cm, scored."""
    course = replace(next(c for c in COURSES if c.name == "wall"), obstacles=WALLS[:1])

    code = np.zeros((6, 64), np.float32)
    evaluated = SimpleNamespace(model=WalkerModel(), style=lambda style, number: code)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("training.evaluation.on_obstacles.GAITS", (Gait.WALK,))
        settle_soon(patch)
        found = score_obstacles(evaluated, 0, ["neutral"], [course], None)
    return {"command": "sport evaluate --courses", **found}


def test_a_walker_gets_over_a_low_wall_and_its_row_is_whole(results):
    row = results["rows"][0]
    assert (row["style"], row["gait"], row["passed"]) == ("neutral", "walk", 1)
    assert row["keyed_s"] > 2.0  # it climbs up and jumps down
    assert 0.5 < row["keyed_fraction"] <= 1.0
    assert row["own"] == 0
    assert row["after"]["hands_s"][0] > 0.3
    text = markdown(json.loads(json.dumps(results)))
    assert "### Walls of 0.6, 1.0 and 1.4 m" in text
    assert "| neutral walk | 1 of 1 |" in text
    assert "both hands on the edge" in text
