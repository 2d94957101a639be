"""Feet stay where they stand, on any ground, without pops."""

import numpy as np
import pytest

from runtime import rotations
from runtime.feet import ik
from runtime.feet.foot_lock import FootLock
from runtime.feet.settings import FootLockSettings
from runtime.feet.skating import SOLE_HEIGHTS, SOLE_POINTS, joint_heights, skating
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT, J
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import make_terrain
from tests.helpers.walker import CYCLE_FRAMES, walk

DT = 1 / 60
TOES, ANKLES, KNEES = [5, 10], [4, 9], [3, 8]


def planted(hips, local, contacts, terrain, lock=None):
    """World positions `(T, 31, 3)` after the foot lock, and what held the feet."""
    lock = lock or FootLock()
    results, held = [], []
    for frame in zip(hips, local, contacts, strict=True):
        results.append(lock.apply(*frame, terrain, DT))
        held.append(lock.held)
    out_hips = np.stack([r.hips_position for r in results])
    positions, _ = SPORT_SKELETON.forward_kinematics(out_hips, np.stack([r.local_rotations for r in results]))
    return positions, held


def forward(hips, local):
    return SPORT_SKELETON.forward_kinematics(hips, local)[0]


def slope(rise=0.2):
    heights = np.repeat(np.linspace(-4, 4, 81)[None] * rise, 81, axis=0)
    return Terrain("slope", heights.astype(np.float32), 0.1, (-4.0, -4.0))


def test_a_clean_walk_on_flat_ground_passes_nearly_unchanged():
    hips, local, contacts = walk(3 * CYCLE_FRAMES)
    positions, _ = planted(hips, local, contacts, Terrain.flat())
    before = forward(hips, local)
    assert np.abs(positions - before)[:, ANKLES].max() < 0.03
    others = [j for j in range(J) if j not in (*KNEES, *ANKLES, *TOES)]
    assert np.abs(positions - before)[:, others].max() < 0.015


@pytest.mark.parametrize("drift", [(0.1, 0.0), (0.0, 0.15), (-0.08, -0.1)])
def test_drifting_roots_do_not_make_feet_skate(drift):
    hips, local, contacts = walk(6 * CYCLE_FRAMES, drift)
    ground = Terrain.flat()
    positions, held = planted(hips, local, contacts, ground)
    before = skating(forward(hips, local), ground, resting_m=TOE_HEIGHT).mean()
    after = skating(positions, ground, resting_m=TOE_HEIGHT).mean()
    assert before > 0.05
    assert after < 0.7 * before  # what is left is the swing's own beginning and end
    assert skating(positions, ground).max() <= 1e-3
    for side, joint in enumerate(TOES):
        still = np.array([held[i][side] == held[i - 1][side] == "toe" for i in range(1, len(held))])
        moved = np.linalg.norm(np.diff(positions[:, joint][:, [0, 2]], axis=0), axis=-1)
        assert still.mean() > 0.3
        assert moved[still].max() < 1.5e-3


@pytest.mark.parametrize("name", ["hills", "rough", "stairs", "platforms"])
def test_toes_stay_above_uneven_ground(name):
    ground = make_terrain(name)
    hips, local, contacts = walk(10 * CYCLE_FRAMES, terrain=ground)
    assert joint_heights(forward(hips, local), ground).min() < -0.01  # the incoming feet sink
    positions, _ = planted(hips, local, contacts, ground)
    assert joint_heights(positions, ground).min() > TOE_HEIGHT - FootLockSettings().sink - 1e-4
    ankles = positions[:, ANKLES].astype(float)
    over = ankles[..., 1] - ground.height(ankles[..., 0], ankles[..., 2])
    assert over.min() > ANKLE_HEIGHT - FootLockSettings().sink - 1e-4


def test_bones_keep_their_lengths_and_knees_their_side():
    ground = make_terrain("stairs")
    hips, local, contacts = walk(8 * CYCLE_FRAMES, (0.1, 0.1), ground)
    positions, _ = planted(hips, local, contacts, ground)
    parents = list(SPORT_SKELETON.parents[1:])
    lengths = np.linalg.norm(positions[:, 1:] - positions[:, parents], axis=-1)
    expected = np.linalg.norm(SPORT_SKELETON.offsets[1:], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(expected, lengths.shape), atol=1e-4)
    knees, ends = positions[:, KNEES], (positions[:, [2, 7]] + positions[:, ANKLES]) / 2
    assert (knees - ends)[..., 2].min() > -0.01  # the walk faces +Z


def stumble(seed, terrain, frames=150):
    """A walk with jitter, slipping and a wrong height, and contacts that say little: worse than any network's output."""
    rng = np.random.default_rng(seed)
    hips, local, contacts = walk(frames, rng.uniform(-0.5, 0.5, 2), terrain, rng.uniform(0.3, 1.8))
    wander = np.cumsum(rng.normal(0.0, 0.004, hips.shape), axis=0) * [1.0, 0.3, 1.0]
    hips = hips + rng.normal(0.0, 0.004, hips.shape) + wander
    hips[:, 1] += rng.uniform(-0.15, 0.1)
    axes = rng.normal(size=(*local.shape[:2], 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    angles = rng.normal(0.0, rng.uniform(0.01, 0.1), local.shape[:2])
    local = rotations.multiply(local, rotations.from_axis_angle(axes, angles))
    contacts = np.clip(contacts + rng.normal(0.0, 0.4, contacts.shape), 0.0, 1.0)
    return hips.astype(np.float32), local, contacts


@pytest.mark.parametrize("name", ["flat", "hills", "rough", "stairs", "hurdles"])
def test_whatever_comes_in_no_sole_moves_in_the_ground(name):
    ground, deepest = make_terrain(name), 0.0
    for seed in range(3):
        hips, local, contacts = stumble(seed, ground)
        positions, _ = planted(hips, local, contacts, ground)
        soles = joint_heights(positions, ground, SOLE_POINTS) - np.array(SOLE_HEIGHTS)
        assert soles.min() > -FootLockSettings().sink - 1e-4
        assert skating(positions, ground).max() <= 1e-3
        deepest = min(deepest, (joint_heights(forward(hips, local), ground) - TOE_HEIGHT).min())
    assert deepest < -0.03  # there was something to do


def test_a_foot_out_of_reach_is_not_drawn_into_a_step():
    axis = np.arange(-50, 51) * 0.04
    heights = np.broadcast_to(np.where(axis > 0.02, 0.16, 0.0), (101, 101))
    ground = Terrain("step", heights.astype(np.float32), 0.04, (axis[0], axis[0]))
    hips, local, contacts = standing(40, lift=0.025)
    hips[:, 2] -= forward(hips, local)[0, 5, 2] + 0.002  # the toes stand right before the riser
    after = np.maximum(np.arange(40) - 10, 0)
    hips[:, 2] += after * 1.7 / 60  # the hips go over it faster than the feet are let go
    hips[:, 1] += after * 0.004
    positions, _ = planted(hips, local, contacts, ground)
    assert joint_heights(positions, ground).min() > TOE_HEIGHT - FootLockSettings().sink - 1e-4


def test_a_swinging_foot_does_not_drag():
    ground = Terrain.flat()
    hips, local, contacts = walk(6 * CYCLE_FRAMES)
    hips[:, 1] -= 0.08  # the toes pass some millimetres over the ground
    before, (positions, _) = forward(hips, local), planted(hips, local, contacts, ground)
    fast = np.linalg.norm(np.diff(positions[:, TOES][..., [0, 2]], axis=0), axis=-1) * 60 > 2.0
    assert fast.mean() > 0.1
    assert (joint_heights(before, ground)[1:][fast] - TOE_HEIGHT).min() < 0.0
    assert np.median(joint_heights(positions, ground)[1:][fast] - TOE_HEIGHT) > 0.015


@pytest.mark.parametrize("name", ["flat", "hills"])
def test_nothing_pops(name):
    ground = make_terrain(name)
    hips, local, contacts = walk(8 * CYCLE_FRAMES, (0.08, 0.1), ground)
    positions, _ = planted(hips, local, contacts, ground)
    before = forward(hips, local)
    for joints, room in ((TOES, 0.012), (ANKLES, 0.012), ([0], 0.004)):
        jerk = np.linalg.norm(np.diff(positions[:, joints], n=2, axis=0), axis=-1)
        usual = np.linalg.norm(np.diff(before[:, joints], n=2, axis=0), axis=-1)
        assert jerk.max() < usual.max() + room


def knee_flexion(positions):
    """Degrees `(T, 2)`."""
    thighs = rotations.normalize(positions[:, KNEES] - positions[:, [2, 7]])
    shins = rotations.normalize(positions[:, ANKLES] - positions[:, KNEES])
    return np.degrees(np.arccos(np.clip((thighs * shins).sum(-1), -1.0, 1.0)))


def tilted(hips, local, rise):
    """The same walk on a slope of `rise` along Z: all of it is tilted, so that legs and feet fit the ground."""
    turn = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(-np.arctan(rise)))
    local = local.copy()
    local[:, 0] = rotations.multiply(np.broadcast_to(turn, local[:, 0].shape), local[:, 0])
    return rotations.rotate(np.broadcast_to(turn, (len(hips), 4)), hips), local


@pytest.mark.parametrize("rise", [0.0, 0.1, -0.1])
@pytest.mark.parametrize("drift", [0.0, 0.08, -0.08])
def test_straight_knees_stay_straight(rise, drift):
    hips, local, contacts = walk(8 * CYCLE_FRAMES, (0.0, drift), straight=True)
    heights = np.repeat(rise * np.linspace(-20, 20, 81)[None], 81, axis=0)
    ground = Terrain("slope", heights, 0.5, (-20.0, -20.0))
    hips, local = tilted(hips, local, rise)
    before, (after, _) = forward(hips, local), planted(hips, local, contacts, ground)
    incoming, outgoing = (knee_flexion(p)[20:] for p in (before, after))
    straight = incoming < 8.0
    assert straight.mean() > 0.15
    bent = (outgoing - incoming)[straight]
    assert abs(np.mean(bent)) < 2.0
    assert np.percentile(bent, 95) < 8.0
    assert abs(np.percentile(outgoing, 3) - np.percentile(incoming, 3)) < 1.0
    usual, jolt = (np.abs(np.diff(k, n=2, axis=0)).max() for k in (incoming, outgoing))
    assert jolt < usual  # degrees in a frame, squared
    carried = after[20:, 0, 1] - before[20:, 0, 1]
    assert np.abs(carried).max() < 0.02
    assert np.median(carried) > -0.002


def standing(frames, lift=0.0):
    """Upright, both feet flat."""
    local = rotations.identity((frames, J))
    hips = np.tile([0.0, 0.1013 + 0.4118 + 0.4233 + ANKLE_HEIGHT - 0.03 + lift, 0.0], (frames, 1))
    return hips.astype(np.float32), local, np.ones((frames, 4), np.float32)


def test_feet_of_a_stander_lie_flat_on_a_slope():
    ground = slope()
    positions, _ = planted(*standing(60), ground)
    toes, ankles = positions[-1, TOES].astype(float), positions[-1, ANKLES].astype(float)
    assert toes[:, 1] - ground.height(toes[:, 0], toes[:, 2]) == pytest.approx([TOE_HEIGHT] * 2, abs=0.004)
    above = ankles[:, 1] - ground.height(ankles[:, 0], ankles[:, 2])
    assert above == pytest.approx([ANKLE_HEIGHT] * 2, abs=0.008)


def test_hips_sink_smoothly_where_the_ground_falls_away():
    ground = Terrain("lower", np.full((21, 21), -0.12, np.float32), 0.5, (-5.0, -5.0))
    hips, local, contacts = standing(60)
    positions, _ = planted(hips, local, contacts, ground)
    sunk = hips[:, 1] - positions[:, 0, 1]
    assert sunk[-1] > 0.08
    assert sunk.max() - sunk[-1] < 0.008
    assert np.diff(sunk).max() < 0.015
    assert joint_heights(positions, ground)[-1] == pytest.approx([TOE_HEIGHT] * 2, abs=0.01)


def test_a_standing_root_that_wanders_off_releases_one_foot_after_the_other():
    hips, local, contacts = standing(180)
    hips[:, 0] += np.linspace(0.0, 0.5, 180)
    positions, held = planted(hips, local, contacts, Terrain.flat())
    assert any(h == ("", "toe") or h == ("toe", "") for h in held)
    assert np.abs(positions[:, TOES, 0] - forward(hips, local)[:, TOES, 0]).max() < 0.33
    speed = np.linalg.norm(np.diff(positions[:, TOES], axis=0), axis=-1) * 60
    assert speed.max() < 5.0


def test_a_raised_foot_follows_the_pose_again():
    hips, local, contacts = standing(120)
    hips[:, 0] += np.minimum(np.arange(120), 60) * 0.001  # 6 cm of drift while it stands
    contacts[60:] = 0.0
    hips[60:, 1] += np.minimum(np.arange(60) * 0.02, 0.3)  # then it jumps
    positions, held = planted(hips, local, contacts, Terrain.flat())
    before = forward(hips, local)
    assert np.abs(positions - before)[59, TOES].max() > 0.04
    assert held[-1] == ("", "")
    feet = ANKLES + TOES
    np.testing.assert_allclose(positions[-1, feet], before[-1, feet], atol=6e-3)  # a straight leg is eased


def near_ground(toe):
    """Metres that a toe `(T, 3)` travels in its longest stay within a centimetre of flat ground."""
    low = toe[:, 1] < TOE_HEIGHT + 0.01
    steps = np.where(low[1:] & low[:-1], np.linalg.norm(np.diff(toe[:, [0, 2]], axis=0), axis=-1), 0.0)
    return max(float(stay.sum()) for stay in np.split(steps, np.flatnonzero(~low[1:])))


@pytest.mark.parametrize("seconds", [0.2, 0.4, 0.8])
def test_a_foot_that_the_pose_drags_lifts_before_it_travels(seconds):
    hips, local, contacts = standing(120)
    ankles = forward(hips, local)[:, ANKLES].astype(np.float64)
    ankles[:, 0, 2] += 0.25 * np.clip((np.arange(120) - 30) / (60 * seconds), 0.0, 1.0)
    dragged = ik.solve_legs(hips.astype(np.float64), local.astype(np.float64), ankles)
    contacts[30:, :2] = np.clip(1.0 - (np.arange(90) / (60 * seconds)), 0.0, 1.0)[:, None]
    contacts[30 + round(60 * seconds) :, :2] = 1.0
    incoming = forward(hips, dragged)[:, 5]
    positions, _ = planted(hips, dragged, contacts, Terrain.flat())
    assert near_ground(incoming) > 0.2
    assert near_ground(positions[:, 5]) < 0.04
    assert positions[-1, 5] == pytest.approx(incoming[-1], abs=0.2)


def test_a_body_that_turns_over_a_held_heel_steps():
    hips, local, contacts = standing(90)
    yaw = np.clip((np.arange(90) - 20) / 40, 0.0, 1.0) * np.pi / 2
    local[:, 0] = rotations.from_axis_angle(np.broadcast_to([0.0, 1.0, 0.0], (90, 3)), yaw)
    contacts[20:60, [1, 3]] = 0.0
    positions, held = planted(hips, local, contacts, Terrain.flat())
    assert ("heel", "heel") in held
    assert max(near_ground(positions[:, joint]) for joint in TOES) < 0.06
