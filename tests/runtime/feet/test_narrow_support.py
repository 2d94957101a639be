"""Feet that would come down beside a beam are led onto it; on other ground nothing is led."""

import numpy as np
import pytest

from runtime import rotations
from runtime.feet.foot_lock import FootLock
from runtime.feet.leg import leg_bones, leg_forward
from runtime.feet.narrow_support import (
    ARMS,
    ARMS_OUT_RAD,
    LANDING_OFFSET_M,
    MAX_LEAD_M,
    PASSING_HEIGHT_M,
    PASSING_OFFSET_M,
    SidewaysLead,
    pull_of_beam,
    side_of_beam,
)
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import PointHeights
from runtime.terrain.library import make_terrain
from tests.helpers.walker import walk

BEAM = make_terrain("beam")


def along(x, terrain, frames=240, begin=5.0):
    """A walk along +Z with its middle at `x`, carried at the height of the ground under it."""
    hips, local, contacts = walk(frames)
    hips = hips + np.array([x, float(terrain.height(x, begin)), begin], np.float32)
    return hips, local, contacts


def locked(x, terrain):
    hips, local, contacts = along(x, terrain)
    lock = FootLock()
    made = [lock.apply(h, r, c, terrain, 1 / 60) for h, r, c in zip(hips, local, contacts, strict=True)]
    hips, turns = (
        np.stack([getattr(m, name) for m in made]) for name in ("hips_position", "local_rotations")
    )
    return SPORT_SKELETON.forward_kinematics(hips, turns)[0], contacts


def test_contacts_beside_a_beam_come_onto_it():
    positions, contacts = locked(0.06, BEAM)  # the left foot comes down at 13.5 cm from the middle
    stands = contacts[64:, 1] > 0.5
    toe = positions[64:, 5][stands]
    assert np.abs(toe[:, 0]).max() <= 0.1
    assert toe[:, 1].min() > 0.4
    assert np.abs(np.diff(positions[:, 5, 0])).max() < 0.03  # nothing jumps


def legs_of(hips, local):
    place = tuple(float(v) for v in hips)
    return place, tuple(leg_forward(leg_bones(k), place, local.astype(np.float64).tolist()) for k in (0, 1))


def test_a_foot_beside_narrow_ground_that_it_cannot_reach_is_left_where_it_is():
    hips, local, _ = along(0.0, BEAM, 1)
    place, (leg, other) = legs_of(hips[0], local[0])
    ground = PointHeights(BEAM)
    side = side_of_beam(place, (leg, other), ground)
    assert side == pytest.approx((1.0, 0.0, 0.0), abs=0.01)
    x = 0.14 + MAX_LEAD_M
    far = leg._replace(toe=(x, *leg.toe[1:]), ankle=(x, *leg.ankle[1:]))
    assert SidewaysLead().apply(far, other, side, False, ground, 1 / 60) is far


def test_the_lead_grows_smoothly_to_the_middle_and_is_kept_while_held():
    hips, local, _ = along(0.06, BEAM, 1)
    place, (leg, other) = legs_of(hips[0], local[0])
    ground = PointHeights(BEAM)
    side, lead = side_of_beam(place, (leg, other), ground), SidewaysLead()
    ways = [lead.apply(leg, other, side, False, ground, 1 / 60).toe[0] - leg.toe[0] for _ in range(60)]
    assert abs(ways[0]) < 0.01
    middle = 0.5 * (leg.toe[0] + leg.ankle[0]) + ways[-1]
    assert middle == pytest.approx(LANDING_OFFSET_M, abs=0.02)  # a left foot, a little to the left
    held = lead.apply(leg, other, side, True, ground, 1 / 60)
    assert held.toe[0] - leg.toe[0] == pytest.approx(ways[-1])


def test_a_foot_passes_the_other_one_on_its_own_side():
    hips, local, _ = along(0.0, BEAM, 1)
    place, (leg, other) = legs_of(hips[0], local[0])
    ground = PointHeights(BEAM)
    side = side_of_beam(place, (leg, other), ground)
    z, y = other.ankle[2], other.ankle[1] + PASSING_HEIGHT_M
    swings = leg._replace(ankle=(leg.ankle[0], y, z), toe=(leg.toe[0], y, z + 0.13))
    lead = SidewaysLead(1.0)
    for _ in range(60):
        passed = lead.apply(swings, other, side, False, ground, 1 / 60)
    assert 0.5 * (passed.toe[0] + passed.ankle[0]) > LANDING_OFFSET_M + 0.8 * PASSING_OFFSET_M


def test_arms_are_held_out_on_a_beam_and_come_back():
    hips, local, contacts = along(0.0, BEAM)
    lock = FootLock()
    for h, r, c in zip(hips, local, contacts, strict=True):
        shown = lock.apply(h, r, c, BEAM, 1 / 60).local_rotations
    assert lock.on_beam
    turned = rotations.angle_between(shown[list(ARMS)], local[-1][list(ARMS)])
    assert turned == pytest.approx([ARMS_OUT_RAD, ARMS_OUT_RAD], rel=0.05)
    flat = make_terrain("flat")
    for h, r, c in zip(hips, local, contacts, strict=True):
        shown = lock.apply(h - np.array([0.0, 0.4, 0.0], np.float32), r, c, flat, 1 / 60).local_rotations
    moved = rotations.angle_between(shown[list(ARMS)], local[-1][list(ARMS)])
    assert moved == pytest.approx([0.0, 0.0], abs=0.01)


@pytest.mark.parametrize("name", ["flat", "stairs", "hurdles", "gaps", "wall"])
def test_no_other_ground_is_taken_for_a_beam(name):
    ground = PointHeights(make_terrain(name))
    hips, local, _ = walk(1)
    turns = rotations.from_yaw(np.linspace(-0.35, 0.35, 3))  # as far as a pelvis turns in a step
    for z in np.arange(0.0, 19.0, 0.05):
        for turn in turns:
            turned = local[0].copy()
            turned[0] = rotations.multiply(turn, local[0, 0].astype(np.float64))
            h = hips[0] + np.array([0.0, ground.height(0.0, z), z], np.float32)
            place, legs = legs_of(h, turned)
            assert side_of_beam(place, legs, ground) is None


def test_the_root_is_led_back_over_the_middle_and_nowhere_else():
    for x in (-0.2, 0.0, 0.15):
        hips, local, _ = along(x, BEAM, 1)
        place, legs = legs_of(hips[0], local[0])
        ground = PointHeights(BEAM)
        pull = pull_of_beam(place, side_of_beam(place, legs, ground), ground)
        assert pull[0] == pytest.approx(-1.5 * x, abs=0.05)
        assert abs(pull[1]) < 0.02
    assert pull_of_beam((0.0, 0.95, 0.0), None, PointHeights(make_terrain("flat"))) == (0.0, 0.0)
