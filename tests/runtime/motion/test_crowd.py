"""Many characters on one stick: each moves as a controller of its own would.

With 8-bit weights bit by bit; in full precision the network takes them as one batch, with sums in another order.
"""

import dataclasses

import numpy as np
import pytest

from runtime.controls import Controls, Gait
from runtime.errors import UsageError
from runtime.motion.controller import MAX_CHARACTERS, Controller, Crowd
from runtime.motion.model import MotionModel
from runtime.motion.style import Style
from runtime.pose import Pose
from runtime.rotations import angle_between
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import make_terrain
from runtime.terrain.steps import level_ahead, step_ahead

FLAT = Terrain.flat()


def code(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(6, 64)).astype(np.float32) * 0.5


def characters(model: MotionModel, terrain: Terrain, count: int = 3) -> list[Controller]:
    """Each with a seed, a strength, a place and a style of its own, some in the middle of a blend."""
    members = [Controller(model, terrain, seed, strength=1.0 + 0.2 * seed) for seed in range(count)]
    for i, member in enumerate(members):
        member.reset(float(i), 0.5 * i, 0.3 * i)
        member.set_style(code(i), 0.4 * i)
    return members


def stick(frame: int) -> Controls:
    gait = Gait.JUMP if frame == 30 else Gait.JOG if frame > 20 else Gait.WALK
    way = (float(np.sin(frame / 9)), float(np.cos(frame / 9)))
    return Controls(way, (0.0, 1.0) if frame > 40 else None, gait)


def same(one: Pose, two: Pose, exact: bool = False) -> bool:
    """Whether poses are equal, or within 0.01 mm and 0.01 degrees."""
    if exact:
        names = [field.name for field in dataclasses.fields(Pose)]
        return all(np.array_equal(getattr(one, name), getattr(two, name)) for name in names)
    angles = angle_between(one.local_rotations.astype(np.float64), two.local_rotations.astype(np.float64))
    return np.abs(one.positions - two.positions).max() < 1e-5 and float(np.degrees(angles).max()) < 0.01


@pytest.mark.parametrize("ground", ["hills", "stairs"])
def test_each_moves_as_it_would_alone(model: MotionModel, ground: str) -> None:
    terrain = make_terrain(ground)
    alone, crowd = characters(model, terrain), Crowd(characters(model, terrain))
    for frame in range(36):
        if frame == 24:
            alone[0].set_style(code(9), 0.3)
            crowd.members[0].set_style(code(9), 0.3)
        together = crowd.step(stick(frame))
        for one, pose in zip(alone, together, strict=True):
            assert same(one.step(stick(frame)), pose, exact=not model.batches), frame
    crowd.close()


def test_a_fault_sets_back_one_and_leaves_the_others(
    model: MotionModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone, crowd = characters(model, FLAT), Crowd(characters(model, FLAT))
    for frame in range(20):
        crowd.step(stick(frame))
        for one in alone:
            one.step(stick(frame))
    step, bad = model.step, code(0)

    def broken(x, noise, style):
        y, alpha = step(x, noise, style)
        for row, one in enumerate([style] if isinstance(style, Style) else style):
            y[row] *= np.nan if np.array_equal(one.z, bad) else 1.0
        return y, alpha

    monkeypatch.setattr(model, "step", broken)
    poses = crowd.step(stick(20))
    crowd.close()
    assert all(same(c.step(stick(20)), pose) for c, pose in zip(alone, poses, strict=True))
    assert [bool(member.message) for member in crowd.members] == [True, False, False]


def blocks() -> Terrain:
    heights = np.random.default_rng(1).choice([0.0, 0.2, 3.0], (10, 10), p=[0.6, 0.3, 0.1])
    return Terrain("blocks", np.kron(heights, np.ones((16, 16))).astype(np.float32), 0.1, (-8.0, -8.0))


def test_the_quick_look_ahead_misses_no_step() -> None:
    terrain, rng, found = blocks(), np.random.default_rng(0), 0
    places = rng.uniform(-8.0, 8.0, (200, 2))
    angles, reach = rng.uniform(0, 2 * np.pi, 200), rng.uniform(0.3, 3.0, 200)
    ways = np.stack([np.sin(angles), np.cos(angles)], -1)
    level = level_ahead(terrain, places, ways, reach)
    for (x, z), way, far, clear in zip(places, ways, reach, level, strict=True):
        distance, _ = step_ahead(terrain, float(x), float(z), way, float(far))
        found += distance < np.inf
        assert not (clear and distance < np.inf)
    assert found > 5
    assert level.any()


def test_what_is_no_crowd_is_refused(model: MotionModel) -> None:
    with pytest.raises(UsageError, match="0 characters"):
        Crowd([])
    with pytest.raises(UsageError, match=f"1 to {MAX_CHARACTERS}"):
        Crowd([Controller(model, FLAT)] * (MAX_CHARACTERS + 1))
    with pytest.raises(UsageError, match="several"):
        Crowd([Controller(model, FLAT), Controller(model, Terrain.flat())])
