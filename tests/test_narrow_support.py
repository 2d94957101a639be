"""Feet that would come down beside a beam are led onto it; on other ground nothing is led."""

import numpy as np
import pytest
from walker import walk

from sport.runtime import rotations
from sport.runtime.feet.foot_lock import FootLock
from sport.runtime.feet.leg_scalar import leg_bones, leg_forward
from sport.runtime.feet.narrow_support import FARTHEST_M, INSIDE_M, SidewaysLead, side_of_beam
from sport.runtime.skeleton import SPORT_SKELETON
from sport.runtime.terrain.library import make_terrain
from sport.runtime.terrain.point_heights import PointHeights

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
    positions = SPORT_SKELETON.forward_kinematics(
        np.stack([m.hips_position for m in made]), np.stack([m.local_rotations for m in made])
    )[0]
    return positions, contacts


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


def test_a_foot_too_far_away_is_left_where_it_is():
    hips, local, _ = along(0.0, BEAM, 1)
    place, legs = legs_of(hips[0], local[0])
    ground = PointHeights(BEAM)
    side = side_of_beam(place, legs, ground)
    assert side == pytest.approx((1.0, 0.0, 0.0), abs=0.01)
    x = 0.14 + FARTHEST_M
    far = legs[0]._replace(toe=(x, *legs[0].toe[1:]), ankle=(x, *legs[0].ankle[1:]))
    assert SidewaysLead().apply(far, place, side, False, ground, 1 / 60) is far


def test_the_lead_grows_smoothly_to_the_edge_and_is_kept_while_held():
    hips, local, _ = along(0.06, BEAM, 1)
    place, (leg, other) = legs_of(hips[0], local[0])
    ground = PointHeights(BEAM)
    side, lead = side_of_beam(place, (leg, other), ground), SidewaysLead()
    ways = [lead.apply(leg, place, side, False, ground, 1 / 60).toe[0] - leg.toe[0] for _ in range(60)]
    assert abs(ways[0]) < 0.01
    assert leg.toe[0] + ways[-1] == pytest.approx(0.1 - INSIDE_M, abs=0.025)
    held = lead.apply(leg, place, side, True, ground, 1 / 60)
    assert held.toe[0] - leg.toe[0] == pytest.approx(ways[-1])


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
