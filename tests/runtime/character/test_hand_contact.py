"""Hands end at the surface of the character that is shown: the mannequin, a stout one, and one of others' joints."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime import rotations
from runtime.character.character import Character, load_character
from runtime.character.hand_contact import clear_hands, touching, without_jumps
from runtime.character.skinned_mesh import skin_vertices
from runtime.formats.bvh_clip import load_clip_bvh
from runtime.formats.prepare import ExportOptions
from runtime.formats.table import save_motion
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON
from runtime.takes.clip import Clip
from tests.helpers import shipped
from tests.helpers.foreign_rigs import centimetre_rig, mixamo_rig, vrm_rig
from tests.helpers.glb_playback import play
from tests.helpers.gltf_characters import make_pose

HAND = SPORT_SKELETON.index("LeftHand")
FORE = SPORT_SKELETON.index("LeftForeArm")
ARM = SPORT_SKELETON.index("LeftArm")
REST = np.array([0.0, REST_HIPS_HEIGHT, 0.0])


@pytest.fixture(scope="module")
def mannequin() -> Character:
    return shipped.mannequin()


def stout(character: Character) -> Character:
    """Wider about the belly; the arms stay."""
    y = character.positions[:, 1]
    trunk = np.abs(character.positions[:, 0]) < 0.19
    wide = 1.0 + 0.3 * trunk * np.exp(-(((y - y[trunk].mean() - 0.1) / 0.2) ** 2))
    positions = character.positions * np.stack([wide, np.ones_like(wide), wide], 1)
    return dataclasses.replace(character, positions=positions.astype(np.float32))


def reaching(goals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hips and local rotations of frames whose left wrist is at `goals` `(T, 3)`, seen from the hips."""
    offset = SPORT_SKELETON.offsets.astype(float)
    a, b = np.linalg.norm(offset[FORE]), np.linalg.norm(offset[HAND])
    way = goals - SPORT_SKELETON.rest_positions.astype(float)[ARM]
    length = np.minimum(np.linalg.norm(way, axis=1), 0.999 * (a + b))
    along = rotations.normalize(way)
    out = np.cross(along, [0.0, 0.0, 1.0])
    out = rotations.normalize(out * np.sign(out[:, :1] + 1e-9))  # the elbow to the left
    cosine = (a * a + length**2 - b * b) / (2 * a * length)
    elbow = a * (cosine[:, None] * along + np.sqrt(1 - cosine**2)[:, None] * out)
    world = np.tile(rotations.identity((31,)).astype(float), (len(goals), 1, 1))
    x = np.broadcast_to([1.0, 0.0, 0.0], goals.shape)
    world[:, ARM] = rotations.between(x, rotations.normalize(elbow))
    below = rotations.between(x, rotations.normalize(length[:, None] * along - elbow))
    for name in ("ForeArm", "Hand", "FingerBase", "HandIndex1"):
        world[:, SPORT_SKELETON.index(f"Left{name}")] = below
    world[:, SPORT_SKELETON.index("LThumb")] = below
    return np.tile(REST, (len(goals), 1)), SPORT_SKELETON.local_rotations(world)


PLACES = {
    "hip": (0.1, 0.05, 0.03),
    "belly": (0.05, 0.15, 0.06),
    "chest": (0.04, 0.28, 0.06),
    "head": (0.1, 0.52, 0.03),
}


def depth_cm(character: Character, hips: np.ndarray, local: np.ndarray) -> float:
    """How deep the left hand's vertices are in the mesh of trunk and head: by its nearest points and their normals."""
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    pose = dataclasses.replace(make_pose(None), positions=positions, world_rotations=world)
    vertices = skin_vertices(character, character.skin_matrices(pose))
    lead = character.joint_indices[np.arange(len(vertices)), character.joint_weights.argmax(1)]
    sources = character.alignment.source[character.alignment.driver[lead]]
    names = np.array((*SPORT_SKELETON.names, ""))[sources]
    hand = vertices[np.char.startswith(names, "LeftHand")][::4]
    body = np.isin(names, ("Hips", "LHipJoint", "LowerBack", "Spine", "Spine1", "Head"))
    corners = vertices[character.triangles[body[character.triangles].all(1)]]
    middles, cross = corners.mean(1), np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = rotations.normalize(cross)
    gaps = hand[:, None] - middles
    nearest = np.argmin((gaps**2).sum(-1), axis=1)
    away = gaps[np.arange(len(hand)), nearest]
    inside = (away * normals[nearest]).sum(1) < 0.0
    far = np.linalg.norm(away, axis=1)
    return 100.0 * float(np.max(far * (inside & (far < 0.15)), initial=0.0))


@pytest.mark.parametrize("place", list(PLACES))
@pytest.mark.parametrize("kind", ["mannequin", "stout"])
def test_a_hand_lies_on_the_surface(
    mannequin: Character, monkeypatch: pytest.MonkeyPatch, place: str, kind: str
) -> None:
    character = mannequin if kind == "mannequin" else stout(mannequin)
    hips, local = reaching(np.array([PLACES[place]]))
    after = depth_cm(character, hips[0], local[0])
    monkeypatch.setattr("runtime.character.character.clear_hands", lambda c, b, p, w, frames: (p, w))
    before = depth_cm(character, hips[0], local[0])
    assert before > 3.0
    assert after < 2.5
    assert after < 0.4 * before


def test_a_free_pose_stays_as_it_is(mannequin: Character) -> None:
    pose = make_pose(None)
    positions, world = clear_hands(mannequin, mannequin.body, pose.positions, pose.world_rotations)
    assert positions is pose.positions
    assert world is pose.world_rotations


def test_a_hand_that_comes_near_is_not_thrown_about(mannequin: Character) -> None:
    goals = np.linspace((0.4, 0.1, 0.25), (0.04, 0.1, 0.06), 120)
    positions, world = SPORT_SKELETON.forward_kinematics(*reaching(goals))
    shown, turned = clear_hands(mannequin, mannequin.body, positions, world)
    assert np.abs(shown - positions).max() > 0.03
    fingers = rotations.rotate(world[:, HAND, None], mannequin.body.hands[0])
    tips = [at[:, HAND, None] + fingers for at in (positions, shown)]
    ways = [np.linalg.norm(np.diff(tip, axis=0), axis=-1) for tip in tips]
    assert ways[1].max() < 1.5 * ways[0].max()
    again = SPORT_SKELETON.forward_kinematics(positions[:, 0], SPORT_SKELETON.local_rotations(turned))[0]
    assert np.allclose(again, shown, atol=1e-4), "bones keep their lengths"
    one = clear_hands(mannequin, mannequin.body, positions[80], world[80])[0]
    assert np.allclose(one, shown[80], atol=1e-6), "a clip and its frames are treated alike"


def test_a_hand_that_goes_through_the_body_keeps_its_speed(mannequin: Character) -> None:
    """From the front of the hips through them to the back: each frame alone would put it on one side or the other."""
    goals = np.linspace((0.06, 0.0, 0.3), (0.02, 0.0, -0.3), 40)
    positions, world = SPORT_SKELETON.forward_kinematics(*reaching(goals))
    cleared = (clear_hands(mannequin, mannequin.body, positions, world, frames=f)[0] for f in (False, True))
    hands = [at[:, HAND] for at in (positions, *cleared)]
    steps = [np.linalg.norm(np.diff(hand, axis=0), axis=-1).max() for hand in hands]
    assert steps[1] > 3.0 * steps[0]
    assert steps[2] < 1.3 * steps[0]


@given(st.integers(2, 40), st.integers(0, 2**32 - 1))
def test_values_without_jumps_differ_by_no_more_than_they_may(frames: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values, steps = rng.normal(size=(frames, 2, 3)), rng.uniform(0.01, 2.0, (frames, 2))
    found = without_jumps(values, steps)
    assert np.all(np.linalg.norm(np.diff(found, axis=0), axis=-1) <= steps[:-1] + 1e-9)
    assert np.array_equal(without_jumps(values, np.full((frames, 2), 100.0)), values)


def test_glb_has_the_hand_on_the_surface_and_bvh_the_motion_as_it_is(
    mannequin: Character, tmp_path: Path
) -> None:
    hips, local = reaching(np.tile(PLACES["hip"], (8, 1)))
    clip = Clip("hip", 60.0, hips.astype(np.float32), local.astype(np.float32), np.ones((8, 4), np.float32))
    save_motion(clip, tmp_path / "hip.glb", ExportOptions())
    save_motion(clip, tmp_path / "hip.bvh", ExportOptions())
    positions, world = clip.world()
    shown = clear_hands(mannequin, mannequin.body, positions.astype(float), world.astype(float))[0]
    exported = play(tmp_path / "hip.glb").joints()["LeftHand"][:, :3, 3]
    assert np.abs(exported - shown[:, HAND]).max() < 1e-3
    assert np.abs(shown - positions).max() > 0.03
    assert np.abs(load_clip_bvh(tmp_path / "hip.bvh").world()[0] - positions).max() < 1e-3


@pytest.mark.parametrize("rig", [mixamo_rig, vrm_rig, centimetre_rig])
def test_joints_of_others_are_led_too(tmp_path: Path, rig: Callable[[Path], Path]) -> None:
    character = load_character(rig(tmp_path / "rig.glb"))
    assert character.body is not None
    goals = np.linspace((0.3, 0.05, 0.03), (0.02, 0.05, 0.0), 20)
    positions, world = SPORT_SKELETON.forward_kinematics(*reaching(goals))
    hand = int(np.flatnonzero(character.sport_joints == HAND)[0])
    before = character.joint_transforms(positions, world)[0][:, hand]
    after = character.joint_transforms(*clear_hands(character, character.body, positions, world))[0][:, hand]
    assert np.allclose(before[0], after[0])
    assert np.linalg.norm(after - before, axis=-1).max() > 0.02
    assert np.abs(after[:, 0]).min() > np.abs(before[:, 0]).min()


def test_fingers_that_point_into_the_waist_lie_along_it(mannequin: Character) -> None:
    # the elbow is outside, the hand would go right in
    goals = np.linspace((0.3, 0.05, 0.02), (0.2, 0.05, 0.02), 60)
    positions, world = SPORT_SKELETON.forward_kinematics(*reaching(goals))
    shown, turned = clear_hands(mannequin, mannequin.body, positions, world)
    turns = rotations.angle_between(world[:, HAND], turned[:, HAND])
    assert 0.3 < turns.max() <= 1.2 + 1e-6
    assert np.abs(np.diff(turns)).max() < 0.15
    away = np.linalg.norm(shown[:, HAND] - positions[:, HAND], axis=1)
    assert away.max() < 0.06, "the wrist stays at the hip"


def test_a_hand_on_the_hip_is_there_on_a_character_of_other_proportions(tmp_path: Path) -> None:
    character = load_character(mixamo_rig(tmp_path / "rig.glb"))
    positions, world = SPORT_SKELETON.forward_kinematics(*reaching(np.array([(0.19, 0.05, 0.04)])))
    hand, hips = (int(np.flatnonzero(character.sport_joints == j)[0]) for j in (HAND, 0))

    def off(pose: tuple[np.ndarray, np.ndarray]) -> float:
        pivots = character.joint_transforms(*pose)[0][0]
        return float(np.linalg.norm(pivots[hand] - pivots[hips] - (positions[0, HAND] - positions[0, 0])))

    assert off((positions, world)) > 0.05
    assert off(clear_hands(character, character.body, positions, world)) < 0.6 * off((positions, world))


def test_arms_that_hang_or_are_held_away_touch_nothing() -> None:
    places = np.array([(0.2, -0.2, 0.05), (0.45, 0.3, 0.1), (0.2, 0.2, 0.45)])
    positions, world = SPORT_SKELETON.forward_kinematics(*reaching(places))
    assert not touching(positions, world, (ARM, FORE, HAND)).any()
    positions, world = SPORT_SKELETON.forward_kinematics(*reaching(np.array([PLACES["belly"]])))
    assert touching(positions, world, (ARM, FORE, HAND)) == pytest.approx(1.0)
