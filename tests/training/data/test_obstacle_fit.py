"""Obstacles under made-up motion: what is fitted has the size of the leap, and no foot meets the new ground."""

import numpy as np
import pytest

from runtime.controls import Gait
from runtime.feet.skating import SOLE_HEIGHTS, SOLE_POINTS
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from tests.helpers.synthetic_clips import flat_patch
from tests.helpers.walker import walk
from training.data.clip_files import TrainingClip
from training.data.obstacle_clips import fitted_copies, load_clip, report
from training.data.obstacle_fit import fit_obstacles, platform_ground, raised

FLAT = Terrain.flat()
WAY_M, FLIGHT = 1.6, 30


def leap(peak, landing=0.0):
    """Hips `(T, 3)`, rotations and contacts: a second's standing, a flight of 1.6 m in half a second, standing again."""
    hips, local, _ = walk(1)
    share = np.clip((np.arange(150) - 60) / FLIGHT, 0.0, 1.0)
    height = 4.0 * peak * share * (1.0 - share) + landing * share
    way = np.stack([0 * share, height, WAY_M * share], -1)
    contacts = np.ones((150, 4), np.uint8)
    contacts[61 : 60 + FLIGHT] = 0
    return (hips + way).astype(np.float32), np.repeat(local, 150, 0), contacts


def joints(hips, local):
    return SPORT_SKELETON.forward_kinematics(hips, local)[0].astype(np.float64)


def depth(positions, patches):
    """How far a sole is in the ground at most, metres."""
    soles = positions[:, SOLE_POINTS]
    ground = patches.terrain().height(soles[..., 0], soles[..., 2])
    return float((ground - soles[..., 1] + np.array(SOLE_HEIGHTS)).max())


def test_a_leap_gets_a_hurdle_that_it_clears():
    hips, local, contacts = leap(0.6)
    positions = joints(hips, local)
    before = depth(positions, flat_patch(positions))
    fits = fit_obstacles(positions, contacts, FLAT, np.random.default_rng(0))
    hurdle = fits[0]
    assert hurdle.kind == "hurdle"
    assert 0.3 < hurdle.size < 0.6
    ground = raised(fits, positions, FLAT)
    assert float(ground.terrain().height(*hurdle.place)) == pytest.approx(hurdle.size, abs=0.01)
    assert depth(positions, ground) <= before + 1e-3
    higher = joints(*leap(0.4)[:2])
    assert fit_obstacles(higher, contacts, FLAT, np.random.default_rng(0))[0].size < hurdle.size


def test_a_flat_flight_gets_a_gap_between_its_footholds():
    hips, local, contacts = leap(0.08)
    positions = joints(hips, local)
    before = depth(positions, flat_patch(positions))
    gap = fit_obstacles(positions, contacts, FLAT, np.random.default_rng(0))[0]
    feet = positions[:, SOLE_POINTS, 2]
    free = feet[-1].min() - feet[0].max()  # between the toes before it and the heels behind it
    assert gap.kind == "gap"
    assert gap.size == pytest.approx(free - 0.1, abs=0.02)
    ground = raised([gap], positions, FLAT)
    assert float(ground.terrain().height(*gap.place)) == pytest.approx(gap.rise)
    held = positions[contacts.all(1)]
    assert depth(held, ground) <= before + 1e-3
    soles = held[:, SOLE_POINTS]
    assert ground.terrain().height(soles[..., 0], soles[..., 2]) == pytest.approx(0.0, abs=1e-3)


def test_standing_and_plain_walking_get_no_hurdle_but_a_narrow_walk_gets_a_beam():
    still = joints(*leap(0.6)[:2])[:60]
    assert fit_obstacles(still, np.ones((60, 4), np.uint8), FLAT, np.random.default_rng(0)) == []
    hips, local, contacts = walk(300)
    fits = fit_obstacles(joints(hips, local), contacts.astype(np.uint8), FLAT, np.random.default_rng(0))
    assert [f.kind for f in fits] == ["beam"]
    assert fits[0].size == pytest.approx(2 * (0.0753 + 0.04), abs=0.02)
    ground = raised(fits, joints(hips, local), FLAT).terrain()
    x, z = fits[0].place
    assert float(ground.height(0.0, z)) == 0.0
    assert float(ground.height(x + 0.5, z)) == pytest.approx(fits[0].rise)


@pytest.mark.parametrize("landing", [0.5, -0.4])
def test_footholds_on_two_levels_get_a_platform_with_an_edge(landing):
    hips, local, contacts = leap(0.3, landing)
    positions = joints(hips, local)
    before = depth(positions[:60], flat_patch(positions))
    ground, steps = platform_ground(positions, contacts)
    assert len(steps) == 1
    assert steps[0].rise == pytest.approx(landing, abs=0.02)
    assert ("onto" in steps[0].words()) == (landing > 0)
    assert depth(positions, ground) < before + 0.05
    rise = np.abs(np.diff(ground.heights[0], axis=1)).max()
    assert rise == pytest.approx(abs(landing), abs=0.03)  # upright, not a slope


def test_copies_have_words_a_gait_and_the_motion_of_their_source(tmp_path):
    hips, local, contacts = leap(0.6)
    gait = np.eye(6)[np.full(len(hips), Gait.WALK)]
    flat = flat_patch(joints(hips, local))
    clip = TrainingClip(
        "hop", hips, local, contacts, gait, "neutral", "walk leap", "accad", "train", "exact", flat
    )
    copies = list(fitted_copies(clip))
    assert len(copies) == 1
    copy, row = copies[0]
    assert copy.name == "hop_0_fit_t"
    assert copy.content.startswith("walk leap: over a hurdle of ")
    assert copy.gait[75].argmax() == Gait.JUMP
    assert copy.gait[5].argmax() == Gait.WALK
    again = load_clip(copy.save(tmp_path))
    assert np.array_equal(again.hips, hips)
    assert again.patches.heights.max() == pytest.approx(row.fits[0].size, abs=0.01)
    text = report([row], "command")
    assert "| accad | hurdle | 1 | 1 |" in text
