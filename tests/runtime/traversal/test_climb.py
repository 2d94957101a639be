"""Keyed climbing: it begins and ends in the network's pose, the hands hold the edge, and nothing is inside the wall."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import rotations
from runtime.arrays import Array
from runtime.feet.ik import solve_legs
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT
from runtime.terrain.courses import Obstacle
from runtime.traversal.climb import Climb
from runtime.traversal.keyframes import Track
from training.evaluation.metrics.traversal import CAPSULES, capsule_points, hands_on_edge, on_top_after

FPS = 60
RISES = st.floats(0.55, 1.5)
STARTS = st.floats(-0.45, -0.3)
STYLES = st.sampled_from(("upright", "slumped", "wide", "aeroplane"))
MAX_JOINT_SPEED_M_PER_S = 9.0  # m/s of a joint


def depth_of(points: Array, rise: float, depth: float) -> Array:
    """Depth in metres of `(..., 3)` points in the wall, or in the upper ground behind the edge of a drop."""
    z = points[..., 2]
    if rise > 0.0:
        return np.maximum(np.minimum(np.minimum(z, depth - z), rise - points[..., 1]), -points[..., 1])
    return np.maximum(np.minimum(-z, -points[..., 1]), rise - points[..., 1])


@cache
def standing(style: str) -> tuple[Array, Array]:
    """Hips over the root and local rotations of somebody who stands: knees hardly bent, arms down or out."""
    local = rotations.identity((31,)).astype(np.float64)
    turn = {"upright": 0.0, "slumped": 0.25, "wide": -0.05, "aeroplane": 0.1}[style]
    hang = 0.1 if style == "aeroplane" else 1.3
    for joint in (11, 12, 13):
        local[joint] = rotations.from_rotation_vector(np.array([turn, 0.0, 0.0]))
    for arm, fore, side in ((18, 19, 1.0), (25, 26, -1.0)):
        local[arm] = rotations.from_rotation_vector(np.array([0.0, 0.1 * side, -hang * side]))
        local[fore] = rotations.from_rotation_vector(np.array([0.0, -0.3 * side, 0.0]))
    half, ahead = (0.17, 0.05) if style == "wide" else (0.09, 0.0)
    hips = np.array([0.0, 0.96 if style == "slumped" else 0.975, 0.0])
    ankles = np.array([[half, ANKLE_HEIGHT, 0.01 + ahead], [-half, ANKLE_HEIGHT, 0.01 - ahead]])
    return hips, solve_legs(hips, local, ankles, rotations.identity((2,)).astype(np.float64))


def moved(hips: Array, z: float, y: float = 0.0) -> Array:
    """Hips `(3,)` at another root."""
    return hips + np.array([0.0, y, z])


def played(crossing: Climb, style: str = "upright") -> tuple[Array, Array]:
    """World positions `(T, 31, 3)` and contacts `(T, 4)` of a crossing at 60 frames a second."""
    hips, local = standing(style)
    times = np.arange(0.0, crossing.seconds, 1.0 / FPS)
    poses = [crossing.pose(t, moved(hips, crossing.root_z(t)), local) for t in times]
    hips, local = np.array([p.hips for p in poses]), np.array([p.local for p in poses])
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    return positions, np.array([p.contacts for p in poses])


def check_ends(crossing: Climb, rise: float, start: float, style: str) -> None:
    """Both ends show the incoming pose, lifted by the rise, and the root rests there."""
    hips, local = standing(style)
    for t, z, y in ((0.0, start, 0.0), (crossing.seconds, crossing.end_z, rise)):
        assert crossing.root_z(t) == pytest.approx(z, abs=1e-9)
        pose = crossing.pose(t, moved(hips, crossing.root_z(t)), local)
        np.testing.assert_allclose(pose.hips, moved(hips, z, y), atol=1e-6)
        assert rotations.angle_between(pose.local, local).max() < 1e-4
        assert pose.contacts.tolist() == [1.0] * 4
    for t in (0.0, crossing.seconds - 1e-3):
        assert abs(crossing.root_z(t + 1e-3) - crossing.root_z(t)) < 1e-4


def check_body(positions: Array, rise: float, depth: float = 1.0) -> None:
    """Finite, no faster than a person, and not inside the ground."""
    assert np.isfinite(positions).all()
    assert np.linalg.norm(np.diff(positions, axis=0), axis=-1).max() * FPS < MAX_JOINT_SPEED_M_PER_S
    assert (depth_of(positions, rise, depth) > 0.03).mean(0).max() <= 0.01
    for name, pairs in CAPSULES.items():
        surface = np.concatenate([capsule_points(positions, *ends) for ends in pairs], 1)
        depths = depth_of(surface, rise, depth).max(1)
        assert (depths > 0.03).mean() <= 0.02, name
        assert depths.max() < 0.06, name


def check_stance(positions: Array, contacts: Array) -> None:
    """A toe or a heel in contact moves no farther than a sole rolls."""
    way = np.linalg.norm(np.diff(positions[:, [4, 5, 9, 10]], axis=0), axis=-1) * FPS
    both = (contacts[1:] > 0.99) & (contacts[:-1] > 0.99)
    assert way[both].size > 0
    assert np.percentile(way[both], 95) < 0.5
    assert np.percentile(way[:, [1, 3]][both[:, [1, 3]]], 95) < 0.15


@settings(max_examples=12)
@given(rise=RISES, start=STARTS, style=STYLES)
def test_climbing_begins_and_ends_in_the_incoming_pose(rise: float, start: float, style: str) -> None:
    check_ends(Climb(rise, start, 1.0), rise, start, style)


@settings(max_examples=12)
@given(drop=RISES, start=STARTS, style=STYLES)
def test_getting_down_begins_and_ends_in_the_incoming_pose(drop: float, start: float, style: str) -> None:
    check_ends(Climb(-drop, start, 1.0), -drop, start, style)


@settings(max_examples=10)
@given(rise=RISES, start=STARTS, style=STYLES)
def test_a_climber_holds_the_edge_and_stays_out_of_the_wall(rise: float, start: float, style: str) -> None:
    positions, contacts = played(Climb(rise, start, 1.0), style)
    check_body(positions, rise)
    check_stance(positions, contacts)
    wall = Obstacle(0.0, 1.0, rise, 3.0)
    assert hands_on_edge(positions, [wall])[0] >= 0.35
    assert on_top_after(np.concatenate([positions[:1] - [0.0, 0.0, 1.0], positions]), wall) is not None


@settings(max_examples=10)
@given(drop=RISES, start=STARTS, style=STYLES)
def test_getting_down_lands_softly_and_clears_the_edge(drop: float, start: float, style: str) -> None:
    positions, contacts = played(Climb(-drop, start, 1.0), style)
    check_body(positions, -drop)
    check_stance(positions, contacts)
    height = positions[:, 0, 1]
    acceleration = np.diff(height, 2) * FPS**2
    assert acceleration.min() > -40.0  # falling, at most pulled down by the legs
    assert height.min() < height[-1] - 0.15  # the knees take the landing


@pytest.mark.parametrize("drop", [0.6, 1.0, 1.4])
@pytest.mark.parametrize("start", [-0.75, -0.4])
def test_getting_down_no_knee_kneels_and_no_heel_brushes_the_edge(drop: float, start: float) -> None:
    """Also from as far before the edge as a jogger stops."""
    positions, _ = played(Climb(-drop, start, 1.0))
    for name, margin in (("shins", 0.02), ("thighs", 0.02)):
        surface = np.concatenate([capsule_points(positions, *ends) for ends in CAPSULES[name]], 1)
        assert depth_of(surface, -drop, 1.0).max() < margin, name
    ankles = positions[:, [4, 9]] - [0.0, ANKLE_HEIGHT, 0.0]
    assert depth_of(ankles, -drop, 1.0).max() < 0.01


def test_a_body_that_hovers_meanwhile_lands_on_the_ground() -> None:
    """The network's pose of a drunk tucks its feet by as much as 14 cm."""
    crossing, (hips, local) = Climb(-1.4, -0.4, 1.0), standing("upright")
    tucked = np.array([[0.09, ANKLE_HEIGHT + 0.14, 0.01], [-0.09, ANKLE_HEIGHT + 0.14, 0.01]])
    local = solve_legs(hips, local, tucked, rotations.identity((2,)).astype(np.float64))
    t = 0.8 * crossing.seconds
    pose = crossing.pose(t, moved(hips, crossing.root_z(t)), local)
    positions, _ = SPORT_SKELETON.forward_kinematics(pose.hips, pose.local)
    assert pose.contacts.tolist() == [1.0] * 4
    np.testing.assert_allclose(positions[[5, 10], 1], TOE_HEIGHT - 1.4, atol=0.01)


def test_arms_keep_their_style_while_they_swing() -> None:
    """Hanging arms swing, spread ones stay."""
    for style, least, most in (("upright", 0.5, 0.8), ("aeroplane", 0.0, 0.05)):
        crossing, (hips, local) = Climb(-1.0, -0.4, 1.0), standing(style)
        turned = [
            rotations.angle_between(
                crossing.pose(t, moved(hips, crossing.root_z(t)), local).local[[18, 25]], local[[18, 25]]
            ).max()
            for t in np.linspace(0.0, crossing.seconds, 40)
        ]
        assert least <= max(turned) <= most


@pytest.mark.parametrize("rise", [0.6, 1.0, 1.3, 1.5])
def test_spread_arms_do_not_turn_over_on_their_way_to_the_edge(rise: float) -> None:
    for start in (-0.45, -0.38, -0.3):
        positions, _ = played(Climb(rise, start, 1.0), "aeroplane")
        assert np.linalg.norm(np.diff(positions, axis=0), axis=-1).max() * FPS < MAX_JOINT_SPEED_M_PER_S


@pytest.mark.parametrize("rise", [0.6, 1.0, 1.4, -0.6, -1.0, -1.4])
def test_soles_stand_on_the_ground(rise: float) -> None:
    """Feet that are in contact with heel and toe are as high over the ground as a flat sole."""
    positions, contacts = played(Climb(rise, -0.38, 1.0))
    for heel, toe, side in ((4, 5, 0), (9, 10, 2)):
        flat = (contacts[:, side : side + 2] > 0.99).all(1)
        ground = np.where(positions[flat, toe, 2] > 0.0, rise, 0.0)
        soles = positions[flat][:, [heel, toe], 1] - ground[:, None] - [ANKLE_HEIGHT, TOE_HEIGHT]
        assert np.percentile(np.abs(soles), 90) < 0.02


def test_knees_bend_forward_and_never_lock_backwards() -> None:
    for crossing in (Climb(0.6, -0.4, 1.0), Climb(1.4, -0.4, 1.0), Climb(-1.0, -0.4, 1.0)):
        hips, local = standing("upright")
        for t in np.linspace(0.0, crossing.seconds, 60):
            pose = crossing.pose(float(t), moved(hips, crossing.root_z(float(t))), local)
            for joint in (3, 8):  # the shin turns back about +X of the thigh
                assert rotations.rotate(pose.local[joint], np.array([0.0, -1.0, 0.0]))[2] < 0.05


def test_a_track_passes_its_keys_without_overshoot() -> None:
    track = Track([(0.0, 0.0), (1.0, 2.0), (1.5, 2.0), (2.0, 0.5)])
    assert [track.at(t)[0] for t in (-1.0, 0.0, 1.0, 1.5, 2.0, 9.0)] == [0.0, 0.0, 2.0, 2.0, 0.5, 0.5]
    values = [track.at(t)[0] for t in np.linspace(0.0, 2.0, 201)]
    assert max(values) <= 2.0
    assert min(values) >= 0.0
    assert track.at(1.25)[0] == 2.0
