"""What the import must keep of a walk: knees, lean, shoulders, and skeletons whose axes follow no rule."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import rotations
from runtime.formats.bvh import format_bvh, parse_bvh
from runtime.skeleton import ANKLE_HEIGHT, REST_HIPS_HEIGHT, SPORT_SKELETON, Skeleton
from tests.training.data.test_data_import import index, march
from training.data import gait
from training.data.foot_cleaning import clean_feet
from training.data.retarget import FOOT_OFFSET, calibrate_feet, heel_rise, load_source, pitched, retarget
from training.data.source_skeletons import SourceJoint, SourceSkeleton, standing_rotations
from training.data.sources import recognise


def knees(positions: np.ndarray) -> np.ndarray:
    """Flexion in degrees `(T, 2)`."""
    bends = []
    for hip, knee, ankle in ((2, 3, 4), (7, 8, 9)):
        thigh, shin = positions[:, knee] - positions[:, hip], positions[:, ankle] - positions[:, knee]
        cosine = np.sum(rotations.normalize(thigh) * rotations.normalize(shin), axis=-1)
        bends.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return np.stack(bends, -1)


def imported(text: str) -> np.ndarray:
    motion = parse_bvh(text)
    source = load_source(motion, recognise(motion, "march"))
    feet = calibrate_feet([load_source(parse_bvh(march(metres_per_second=0.0)), recognise(motion, "march"))])
    return SPORT_SKELETON.forward_kinematics(*retarget(source, feet, None, flex_toes=False))[0]


def test_a_straight_knee_stays_straight_and_a_bent_one_bent() -> None:
    bends = knees(imported(march(metres_per_second=0.0)))
    t = np.arange(len(bends)) / 60
    source = np.degrees(1.2 * np.maximum(np.sin(2 * np.pi * t), 0.0))
    still = source < 0.5
    assert bends[still, 0].max() < 3.6  # MAX_REACH and EASE_REACH
    assert np.abs(bends[:, 0] - source).max() < 6.0


def test_clean_feet_bends_no_knee_of_a_figure_that_stands_straight() -> None:
    hips = np.tile([0.0, REST_HIPS_HEIGHT, 0.0], (60, 1)).astype(np.float32)
    local = np.tile(rotations.identity((31,)), (60, 1, 1))
    moved, local = clean_feet(hips, local, np.ones((60, 4), np.uint8), lambda x, z: np.zeros_like(x))
    positions, _ = SPORT_SKELETON.forward_kinematics(moved, local)
    assert knees(positions).max() < 3.6
    np.testing.assert_allclose(moved[:, 1], REST_HIPS_HEIGHT, atol=0.003)


def test_a_heel_that_has_begun_to_rise_is_not_pressed_down() -> None:
    hips = np.tile([0.0, REST_HIPS_HEIGHT, 0.0], (60, 1)).astype(np.float32)
    local = np.tile(rotations.identity((31,)), (60, 1, 1)).astype(np.float64)
    local[:, 4] = rotations.from_axis_angle(np.array([1.0, 0, 0]), np.array(0.3))
    contacts = np.ones((60, 4), np.uint8)
    moved, after = clean_feet(hips, local, contacts, lambda x, z: np.zeros_like(x))
    positions, _ = SPORT_SKELETON.forward_kinematics(moved, after)
    assert positions[:, 4, 1].min() > ANKLE_HEIGHT + 0.01
    assert positions[:, 9, 1].max() < ANKLE_HEIGHT + 0.01


@settings(deadline=None)
@given(st.floats(-0.3, 0.9), st.floats(-0.25, 0.4), st.floats(-0.15, 0.25))
def test_heel_rise_gives_the_leg_its_length(pitch: float, ahead: float, turn: float) -> None:
    foot = pitched(np.array([1.0, 0, 0, 0]), pitch)
    toe = np.array([0.0, 0.03, 0.0])
    ankle = toe - rotations.rotate(pitched(foot, turn), FOOT_OFFSET)
    hip = np.array([0.05, 0.9, ahead])
    length = np.linalg.norm(ankle - hip)
    rise = heel_rise(hip, toe, foot, np.asarray(length))
    found = toe - rotations.rotate(pitched(foot, rise), FOOT_OFFSET)
    np.testing.assert_allclose(np.linalg.norm(found - hip), length, atol=1e-6)


def test_the_trunk_leads_to_the_sources_neck() -> None:
    motion = parse_bvh(march(metres_per_second=0.0))
    source = load_source(motion, recognise(motion, "march"))
    result = retarget(source, calibrate_feet([source]), None, flex_toes=False)
    positions, _ = SPORT_SKELETON.forward_kinematics(*result)
    ours = rotations.normalize(positions[:, index("Neck")] - positions[:, 0])
    np.testing.assert_allclose(ours, rotations.normalize(source.trunk), atol=1e-3)


STANDING = {  # a figure with hanging arms: joint, parent, place in metres
    "Hips": ("", (0.0, 0.9, 0.0)), "Spine": ("Hips", (0.0, 1.1, 0.0)),
    **{
        side + name: (side + parent if parent != "Hips" else parent, (x * sign, y, 0.0))
        for side, sign in (("Left", 1.0), ("Right", -1.0))
        for name, parent, x, y in (
            ("UpLeg", "Hips", 0.1, 0.9), ("Leg", "UpLeg", 0.1, 0.5), ("Foot", "Leg", 0.1, 0.1),
            ("Arm", "Hips", 0.2, 1.4), ("ForeArm", "Arm", 0.22, 1.1), ("Hand", "ForeArm", 0.22, 0.85),
        )
    },
}  # fmt: skip


def test_a_reference_pose_corrects_whatever_axes_a_rig_has() -> None:
    names = tuple(STANDING)
    parents = tuple(names.index(p) if p else -1 for p, _ in STANDING.values())
    places = np.array([place for _, place in STANDING.values()])
    axes = rotations.normalize(np.random.default_rng(1).normal(size=(len(names), 4)))  # while it stands
    bones, local = np.zeros_like(places), axes.copy()
    for j, parent in enumerate(parents[1:], 1):
        back = rotations.inverse(axes[parent])
        bones[j] = rotations.rotate(back, places[j] - places[parent])
        local[j] = rotations.multiply(back, axes[j])
    rig = Skeleton(names, parents, bones.astype(np.float32))
    motion = parse_bvh(format_bvh(rig, {0: places[[0, 0]]}, np.stack([local] * 2), 60.0))
    source = SourceSkeleton("odd", frozenset(names), {n: SourceJoint(n) for n in names}, reference="")
    wanted = standing_rotations(dict(zip(names, places, strict=True)))
    _, world = motion.world()
    for name, correction in source.corrections(motion).items():
        ours = rotations.multiply(world[0, names.index(name)].astype(np.float64), correction)
        assert rotations.angle_between(ours, wanted[name]) < 1e-2, name
    down = rotations.rotate(wanted["LeftArm"], np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(down, rotations.normalize(np.array([0.02, -0.3, 0.0])), atol=1e-6)


def walker(knee_bend: float, speed: float = 1.2, lean: float = 0.0) -> gait.GaitJoints:
    """Joints of a figure that strides along +Z twice a second with legs bent by `knee_bend` radians."""
    t = np.arange(600) / 60
    hips = np.stack([np.zeros_like(t), np.full_like(t, 0.9) + 0.02 * np.cos(4 * np.pi * t), speed * t], -1)
    p = {"hips": hips, "neck": hips + np.array([0.0, 0.5 * np.cos(lean), 0.5 * np.sin(lean)])}
    for c, sign in (("l", 1.0), ("r", -1.0)):
        swing = sign * 0.3 * np.sin(2 * np.pi * t)
        hip = hips + np.array([0.09 * sign, 0.0, 0.0])
        thigh, shin = swing + 0.5 * knee_bend, swing - 0.5 * knee_bend
        p[c + "h"] = hip
        p[c + "k"] = hip + 0.41 * np.stack([0 * t, -np.cos(thigh), np.sin(thigh)], -1)
        p[c + "a"] = p[c + "k"] + 0.41 * np.stack([0 * t, -np.cos(shin), np.sin(shin)], -1)
        p[c + "t"] = p[c + "a"] + np.array([0.0, -0.04, 0.13])
        p[c + "s"] = hips + np.array([0.18 * sign, 0.45, 0.0])
        p[c + "e"] = p[c + "s"] + np.array([0.0, -0.28, 0.0])
        p[c + "w"] = p[c + "e"] + np.stack([0 * t, -0.2 + 0 * t, 0.1 * np.sin(2 * np.pi * t + sign)], -1)
    p["head"] = p["neck"] + np.array([0.0, 0.1, 0.0])
    return gait.GaitJoints.scaled(p, 60.0)


@pytest.mark.parametrize("bend", [0.05, 0.4])
def test_gait_measures_what_a_walker_was_made_with(bend: float) -> None:
    found = gait.measure(walker(bend, lean=0.2))
    np.testing.assert_allclose(found["knee_min"], np.degrees(bend), atol=0.1)
    np.testing.assert_allclose(found["speed"], 1.2, rtol=0.02)
    np.testing.assert_allclose(found["cadence"], 120.0, rtol=0.06)
    np.testing.assert_allclose(found["lean"], np.degrees(0.2), atol=0.2)
    np.testing.assert_allclose(found["bob_cm"], 4.0, atol=0.3)


def test_strides_that_are_alike_vary_by_nothing_and_a_hand_that_wanders_by_its_deviation() -> None:
    same = gait.measure(walker(0.1))
    assert max(same["hands_vary_cm"], same["tops_vary_cm"], same["steps_vary_cm"]) < 0.2
    joints = walker(0.1)
    t = np.arange(600) / 60
    for hand in ("lw", "rw"):
        joints.points[hand][:, 1] += 0.05 * np.sin(2 * np.pi * t / 3.3)
    found = gait.measure(joints)
    np.testing.assert_allclose(found["hands_vary_cm"], 5.0 / np.sqrt(2), rtol=0.15)
    np.testing.assert_allclose(found["tops_vary_cm"], 5.0 / np.sqrt(2), rtol=0.3)
    assert found["steps_vary_cm"] < 0.2
    assert gait.measure(walker(0.1, speed=0.0)) is None
