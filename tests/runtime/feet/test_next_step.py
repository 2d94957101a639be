"""The next step of a foot: known early, led past a bar or a gap, lifted over edges, with a knee that gives way."""

import numpy as np
import pytest

from runtime.feet.leg import leg_bones, leg_forward, turned_out
from runtime.feet.next_step import HEEL_M, TOE_M, NextStep, SteppedOver, has_edges
from runtime.scalar_math import length, subtract
from runtime.skeleton import ANKLE_HEIGHT
from runtime.terrain.height_map import PointHeights, Terrain
from runtime.terrain.library import make_terrain
from tests.helpers.walker import walk

DT = 1.0 / 60.0
FLAT = PointHeights(Terrain.flat())


def legs(frames=150):
    """Of a walk along +Z, left and right, with whether each stands."""
    hips, local, contacts = walk(frames)
    for h, r, c in zip(hips, local, contacts, strict=True):
        place = tuple(float(v) for v in h)
        pair = tuple(leg_forward(leg_bones(k), place, r.astype(np.float64).tolist()) for k in (0, 1))
        yield pair, (max(c[:2]) > 0.5, max(c[2:]) > 0.5)


def walked(over=None):
    """Each frame's predicted place of the left ankle, where it was led to, and whether it stands."""
    steps, before, rows = (NextStep(), NextStep()), None, []
    for pair, held in legs():
        for k in (0, 1):
            last = pair[k] if before is None else before[k]
            velocity = tuple((a - b) / DT for a, b in zip(pair[k].toe, last.toe, strict=True))
            steps[k].watch(pair[k], steps[1 - k], held[k], held[k], velocity, DT)
        led = steps[0].lead(pair[0], over, held[0], DT)
        steps[1].lead(pair[1], over, held[1], DT)
        rows.append((pair[0].ankle[2] + steps[0].metres, led.ankle[2], held[0], pair[0].ankle[2]))
        before = pair
    return np.array(rows, float)


def landings(rows):
    """Frames in which the left foot comes down after its second step."""
    came = np.flatnonzero(np.diff(rows[:, 2]) > 0) + 1
    return came[came > 70]


def test_a_foot_knows_where_it_comes_down():
    rows = walked()
    for frame in landings(rows):
        assert rows[frame - 10, 0] == pytest.approx(rows[frame, 3], abs=0.12)
    assert np.array_equal(rows[:, 1], rows[:, 3])  # nothing to step over: nothing is led


def test_a_foot_is_led_behind_what_it_would_come_down_on():
    plain = walked()
    frame = landings(plain)[0]
    bar = SteppedOver(z=float(plain[frame, 3]) - 0.1, length=0.1, crossing=True)
    assert walked(bar)[frame, 1] - bar.z >= bar.length + HEEL_M - 0.04
    before = SteppedOver(z=float(plain[frame, 3]) + 0.05, length=0.1)
    assert walked(before)[frame, 1] - before.z <= -TOE_M + 0.06


def test_a_foot_is_high_enough_before_it_is_over_an_edge():
    step = NextStep(way_z=1.2, metres=0.6, seconds=0.4)
    heights = np.where(np.abs(np.arange(80) * 0.05 - 2.3) < 0.06, 0.4, 0.0)[None].repeat(3, 0)
    bar = PointHeights(Terrain("bar", heights, 0.05, (-0.05, -2.0)))
    lifts = [step.lift((((0.0, 0.1, z), 0.1),), bar) for z in (-0.4, -0.25, 0.1)]
    assert lifts[0] == 0.0 < lifts[1] < lifts[2]
    assert lifts[2] == pytest.approx(0.35, abs=0.02)
    assert step.lift((((0.0, 0.1, 0.1), 0.1),), FLAT) == 0.0


def test_a_foot_rises_before_its_shin_is_in_a_bar():
    """The knee is over the bar, the ankle well behind it: the line between them has to pass over its near edge."""
    over = SteppedOver(length=0.1, top=0.5)
    step = NextStep(way_z=1.2, metres=0.5, seconds=0.4, knee=(0.0, 0.7, 0.05), over=over)
    low, high = (((0.0, y, -0.3), y - ANKLE_HEIGHT) for y in (0.2, 0.7))
    toe = ((0.0, 0.1, -0.2), 0.1)
    assert step.lift((toe, low), FLAT) > 0.25
    assert step.lift((toe, high), FLAT) <= 0.0
    step.knee = (0.0, 0.7, -0.6)
    assert step.lift((toe, low), FLAT) == 0.0


def test_a_knee_gives_way_to_a_bar_and_the_foot_stays():
    pair = list(legs(60))[52][0]  # in mid-swing
    out = turned_out(pair[0], 0, 0.8)
    assert out.ankle == pair[0].ankle
    assert out.knee[0] > pair[0].knee[0]
    assert length(subtract(out.knee, out.hip)) == pytest.approx(length(subtract(pair[0].knee, pair[0].hip)))
    wall = np.where(np.arange(80) * 0.05 - 2.0 > pair[0].knee[2] + 0.1, 0.9, 0.0)[None].repeat(3, 0)
    high = PointHeights(Terrain("wall", wall, 0.05, (-0.05, -2.0)))
    step = NextStep(way_z=1.0)
    assert [step.knee_out(pair[0], 0, FLAT, DT) for _ in range(3)][-1] == 0.0
    assert [step.knee_out(pair[0], 0, high, DT) for _ in range(9)][-1] > 0.1


@pytest.mark.parametrize(
    ("name", "edges"), [("flat", False), ("hills", False), ("hurdles", True), ("stairs", True)]
)
def test_only_ground_with_edges_has_next_steps(name, edges):
    assert has_edges(PointHeights(make_terrain(name))) == edges
