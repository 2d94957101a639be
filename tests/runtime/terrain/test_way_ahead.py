"""What lies across a walker's way is recognised by its kind, its edges and its height."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.terrain.courses import Obstacle as Block
from runtime.terrain.courses import raise_obstacles
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import make_terrain
from runtime.terrain.obstacle_detection import ObstacleKind, obstacle_ahead

AHEAD = np.array([0.0, 1.0])


def ground(*blocks: Block, base: float = 0.0) -> Terrain:
    x, z = np.meshgrid(np.arange(-4.0, 4.01, 0.05), np.arange(0.0, 12.01, 0.05), indexing="ij")
    return Terrain("test", (base + raise_obstacles(x, z, blocks)).astype(np.float32), 0.05, (-4.0, 0.0))


@given(top=st.floats(0.15, 1.4), begin=st.floats(2.5, 3.5), base=st.floats(-3.0, 3.0))
def test_a_bar_has_two_edges_and_a_height(top: float, begin: float, base: float) -> None:
    found = obstacle_ahead(ground(Block(begin, begin + 0.1, top, 4.0), base=base), 0.0, 1.0, AHEAD, 3.0)
    assert (found.kind, found.skew) == (ObstacleKind.BAR, 0.0)
    assert found.near == pytest.approx(begin - 1.0, abs=0.11)  # a riser is a cell wide
    assert 0.0 < found.far - found.near < 0.35
    assert found.top == pytest.approx(top, abs=0.02)
    assert found.beyond == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(
    ("top", "kind"),
    [(0.4, ObstacleKind.UP), (1.2, ObstacleKind.UP), (-0.5, ObstacleKind.DOWN), (-1.0, ObstacleKind.DOWN)],
)
def test_walls_and_drops_are_steps(top: float, kind: ObstacleKind) -> None:
    blocks = (Block(3.0, 4.5, top, 4.0),) if top > 0.0 else (Block(0.0, 3.0, -top, 4.0),)
    found = obstacle_ahead(ground(*blocks), 0.0, 1.0, AHEAD, 3.0)
    assert found.kind is kind
    assert found.near == pytest.approx(2.0, abs=0.1)
    assert found.top == pytest.approx(top, abs=0.02)
    if kind is ObstacleKind.UP:
        assert found.far == pytest.approx(3.5, abs=0.15)


def test_the_far_side_of_a_bar_is_not_a_drop() -> None:
    """Seen from its top; from the edge of a block it is one."""
    bar, block = ground(Block(3.0, 3.1, 0.5, 4.0)), ground(Block(2.0, 3.1, 0.5, 4.0))
    assert obstacle_ahead(bar, 0.0, 3.05, AHEAD, 3.0) is None
    assert obstacle_ahead(block, 0.0, 3.05, AHEAD, 3.0).kind is ObstacleKind.DOWN


def test_a_gap_ends_where_the_ground_comes_back() -> None:
    terrain = ground(Block(0.0, 3.0, 0.5, 4.0), Block(3.7, 6.0, 0.6, 4.0))
    found = obstacle_ahead(terrain, 0.0, 1.0, AHEAD, 3.0)
    assert found.kind is ObstacleKind.GAP
    assert found.near == pytest.approx(2.0, abs=0.1)
    assert found.far == pytest.approx(2.7, abs=0.1)
    assert found.beyond == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize(
    ("depth", "width", "kind"), [(0.16, 1.1, None), (0.16, 0.35, None), (0.5, 1.1, ObstacleKind.GAP)]
)
def test_a_dip_as_deep_as_a_stair_is_walked_through(
    depth: float, width: float, kind: ObstacleKind | None
) -> None:
    terrain = ground(Block(0.0, 3.0, depth, 4.0), Block(3.0 + width, 8.0, depth, 4.0))
    found = obstacle_ahead(terrain, 0.0, 1.0, AHEAD, 3.0)
    assert (None if found is None else found.kind) is kind


@given(angle=st.floats(-0.6, 0.6))
def test_an_edge_that_is_met_aslant_says_how_far_to_turn(angle: float) -> None:
    way = np.array([np.sin(angle), np.cos(angle)])
    found = obstacle_ahead(ground(Block(3.0, 6.0, 1.0, 4.0)), 0.0, 1.0, way, 3.0)
    assert angle + found.skew == pytest.approx(0.0, abs=0.2)


@pytest.mark.parametrize("name", ["flat", "hills", "rough", "stairs"])
def test_ground_that_is_walked_on_holds_no_obstacle(name: str) -> None:
    terrain = make_terrain(name)
    for z in np.arange(0.0, 12.0, 0.5):
        for x in (-1.0, 0.0, 1.3):
            assert obstacle_ahead(terrain, x, float(z), AHEAD, 2.0) is None


def test_what_lies_farther_than_the_reach_is_not_seen() -> None:
    terrain = ground(Block(5.0, 5.1, 0.5, 4.0))
    assert obstacle_ahead(terrain, 0.0, 1.0, AHEAD, 3.0) is None
    assert obstacle_ahead(terrain, 0.0, 3.0, AHEAD, 3.0) is not None
