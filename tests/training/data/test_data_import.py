"""The importer on small synthetic takes: no motion data needed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.errors import FileError
from runtime.formats.bvh import format_bvh, parse_bvh
from runtime.skeleton import ANKLE_HEIGHT, REST_HIPS_HEIGHT, SPORT_SKELETON, TOE_HEIGHT, Skeleton
from runtime.takes.footplants import stretches
from training.data import cutting, labels, relief
from training.data.clips import Patches, TrainingClip, wrapped_height
from training.data.foot_cleaning import bridge, clean_feet
from training.data.importer import import_all
from training.data.readers import read_transforms
from training.data.retarget import (
    calibrate_feet,
    load_source,
    resample_positions,
    resample_rotations,
    retarget,
    sample_times,
)
from training.data.shown import Shown
from training.data.source_skeletons import SourceJoint, SourceSkeleton, known_skeletons
from training.data.sources import (
    BY_NAME,
    DATA_SETS,
    FREE,
    DataSet,
    credits_of,
    licence_of,
    list_clips,
    recognise,
    skeleton_of,
)

# a 100STYLE-like rig, 10 % larger than ours, with longer feet; name, parent, offset in cm
RIG = [
    ("Hips", "", (0, 0, 0)),
    ("Chest", "Hips", (0, 13, 0)), ("Chest2", "Chest", (0, 10, 0)), ("Chest3", "Chest2", (0, 9, 0)),
    ("Chest4", "Chest3", (0, 9, 0)), ("Neck", "Chest4", (0, 13, 0)), ("Head", "Neck", (0, 9, 0)),
    *[
        row
        for side, s in (("Right", -1), ("Left", 1))
        for row in (
            (f"{side}Collar", "Chest4", (3 * s, 7, 0)), (f"{side}Shoulder", f"{side}Collar", (16 * s, 0, 0)),
            (f"{side}Elbow", f"{side}Shoulder", (31 * s, 0, 0)), (f"{side}Wrist", f"{side}Elbow", (25 * s, 0, 0)),
            (f"{side}Hip", "Hips", (10 * s, 0, 0)), (f"{side}Knee", f"{side}Hip", (0, -46, 0)),
            (f"{side}Ankle", f"{side}Knee", (0, -46, 0)), (f"{side}Toe", f"{side}Ankle", (0, -9, 19)),
        )
    ],
]  # fmt: skip
NAMES = [name for name, _, _ in RIG]
FRAMES = 360


def rig() -> Skeleton:
    parents = tuple(NAMES.index(p) if p else -1 for _, p, _ in RIG)
    return Skeleton(tuple(NAMES), parents, np.array([o for *_, o in RIG], np.float32) * 0.01)


def march(fps: float = 60.0, metres_per_second: float = 0.6) -> str:
    """BVH of a stiff walk along +Z: straight legs that swing in turn, left arm raised, arms else hanging."""
    t = np.arange(int(FRAMES * fps / 60.0)) / fps
    skeleton = rig()
    local = np.tile(rotations.identity((len(NAMES),)), (len(t), 1, 1)).astype(np.float64)
    swing = np.maximum(np.sin(2 * np.pi * t), 0.0), np.maximum(-np.sin(2 * np.pi * t), 0.0)
    for side, phase, s in (("Left", swing[0], 1), ("Right", swing[1], -1)):
        x = np.array([1.0, 0, 0])
        local[:, NAMES.index(f"{side}Hip")] = rotations.from_axis_angle(x, -0.6 * phase)
        local[:, NAMES.index(f"{side}Knee")] = rotations.from_axis_angle(x, 1.2 * phase)
        local[:, NAMES.index(f"{side}Ankle")] = rotations.from_axis_angle(x, -0.6 * phase)
        angle = -1.3 * s if side == "Right" else 0.5
        turn = rotations.from_axis_angle(np.array([0, 0, 1.0]), np.array(angle))
        local[:, NAMES.index(f"{side}Shoulder")] = turn
    hips = np.stack([np.zeros_like(t), np.full_like(t, 1.05), metres_per_second * t], -1)
    return format_bvh(skeleton, {0: hips}, local, fps, order="YXZ")


def retargeted(text: str):
    motion = parse_bvh(text)
    skeleton = recognise(motion, "march")
    in_place = parse_bvh(march(metres_per_second=0.0))  # stiff legs slide when they travel
    feet = calibrate_feet([load_source(in_place, skeleton)])
    result = retarget(load_source(motion, skeleton), feet, None, flex_toes=False)
    positions, world = SPORT_SKELETON.forward_kinematics(*result)
    return result, positions, world


def index(name: str) -> int:
    return SPORT_SKELETON.index(name)


def test_retarget_keeps_sides_posture_and_ground() -> None:
    _, positions, world = retargeted(march(metres_per_second=0.0))
    assert np.all(positions[:, index("LeftHand"), 0] > positions[:, index("RightHand"), 0])
    # the raised arm
    assert np.all(positions[:, index("LeftHand"), 1] > positions[:, index("LeftArm"), 1] + 0.1)
    assert np.all(positions[:, index("RightHand"), 1] < positions[:, index("RightArm"), 1] - 0.3)
    hip, knee, ankle = (positions[:, index(f"Left{name}"), 2] for name in ("UpLeg", "Leg", "Foot"))
    knee_forward = knee - 0.5 * (hip + ankle)
    assert knee_forward.min() > -0.01  # knees never bend backwards
    lowest = positions[:, [index("LeftToeBase"), index("RightToeBase")], 1].min(1)
    np.testing.assert_allclose(np.median(lowest), TOE_HEIGHT, atol=0.01)
    np.testing.assert_allclose(positions[0, index("LeftFoot"), 1], ANKLE_HEIGHT, atol=0.012)
    np.testing.assert_allclose(world[0, index("LeftFoot"), 0], 1.0, atol=0.01)  # sole level in stance
    np.testing.assert_allclose(positions[0, 0, 1], REST_HIPS_HEIGHT, atol=0.03)


def pitch(world: np.ndarray, name: str) -> np.ndarray:
    """Degrees by which a joint's +Z points above the horizon."""
    forward = rotations.rotate(world[:, index(name)], np.array([0.0, 0.0, 1.0]))
    return np.rad2deg(np.arcsin(forward[:, 1]))


def test_head_lift_tilts_face_and_neck_and_nothing_else() -> None:
    motion = parse_bvh(march())
    plain = recognise(motion, "march")
    lifted = BY_NAME["100style"].of_capture(plain, "100style")
    assert (plain.head_lift_degrees, lifted.head_lift_degrees) == (0.0, 16.0)
    feet = calibrate_feet([load_source(motion, plain)])
    before, after = (retarget(load_source(motion, s), feet, None, flex_toes=False) for s in (plain, lifted))
    (_, world_before), (_, world_after) = (SPORT_SKELETON.forward_kinematics(*r) for r in (before, after))
    np.testing.assert_allclose(pitch(world_after, "Head") - pitch(world_before, "Head"), 16.0, atol=0.01)
    neck = pitch(world_after, "Neck1") - pitch(world_before, "Neck1")
    np.testing.assert_allclose(neck, 16.0 / 3, atol=0.01)
    others = [j for j in range(31) if j not in (index("Neck1"), index("Head"))]
    np.testing.assert_array_equal(after[1][:, others], before[1][:, others])
    np.testing.assert_array_equal(after[0], before[0])


def test_head_lift_is_local_so_a_turned_head_keeps_its_symmetry() -> None:
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    motion = parse_bvh(march())
    source = load_source(motion, BY_NAME["100style"].of_capture(recognise(motion, "march"), "100style"))
    feet = calibrate_feet([source])
    # neck turned left, head farther
    neck, head = (rotations.from_axis_angle(y, np.array(a)) for a in (0.5, 0.9))
    turned = dict(source.rotations)
    turned["Neck1"], turned["Head"] = (np.tile(q, (len(source.ankles), 1)) for q in (neck, head))
    result = retarget(replace(source, rotations=turned), feet, None, flex_toes=False)
    theta = np.deg2rad(16.0)
    own = rotations.from_axis_angle(y, np.array(0.4))
    for joint, local, share in (("Neck1", neck, 1 / 3), ("Head", own, 2 / 3)):
        expected = rotations.multiply(local, rotations.from_axis_angle(x, np.array(-share * theta)))
        assert rotations.angle_between(result[1][:, index(joint)], expected).max() < 1e-3


def test_head_lift_belongs_to_the_capture(tmp_path: Path) -> None:
    """Whichever archive a clip comes with: one more style of 100STYLE has the tilt of 100STYLE."""
    (tmp_path / "Angry_FW.bvh").write_text(march(), encoding="utf-8")
    (clip,), _ = BY_NAME["100style_more"].clips(tmp_path)
    assert skeleton_of(clip, parse_bvh(march())).head_lift_degrees == 16.0


def test_a_data_set_is_added_by_one_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What CONTRIBUTING shows: its files are listed, credited, read by its reader, and left out where it is bound."""
    skeleton = SourceSkeleton("mine", frozenset({"MyRoot"}), {"Hips": SourceJoint("MyRoot")})

    def shows(path: Path) -> Shown | str:
        return "no walk" if path.stem == "sit" else Shown("neutral", "walk forward")

    record = DataSet("mine", "Me (MIT)", shows, free=False, files="*.txt", first_frame=2)
    monkeypatch.setattr("training.data.sources.DATA_SETS", (*DATA_SETS, record))
    monkeypatch.setattr("training.data.sources.known_skeletons", lambda: (skeleton,))
    monkeypatch.setitem(BY_NAME, "mine", record)
    (tmp_path / "mine").mkdir()
    for name in ("walk", "sit"):
        (tmp_path / "mine" / f"{name}.txt").write_text("", encoding="utf-8")
    found, left_out = list_clips(tmp_path)
    assert [(clip.name, clip.capture) for clip in found] == [("mine_walk", "mine")]
    assert ("mine_sit", "no walk") in [(one.name, one.reason) for one in left_out]
    assert credits_of({"mine"}) == ["Me (MIT)"]
    root = Skeleton(("MyRoot",), (-1,), np.zeros((1, 3), np.float32))
    motion = parse_bvh(format_bvh(root, {0: np.zeros((2, 3))}, rotations.identity((2, 1)), 60))
    assert skeleton_of(found[0], motion).name == "mine"
    with pytest.raises(FileError, match="none of"):
        list_clips(tmp_path, free_only=True)


def test_transforms_are_read_as_a_hierarchy(tmp_path: Path) -> None:
    """Global transforms of a take come back as they are, by way of bones and local rotations."""
    random = np.random.default_rng(0)
    frames, parents = 4, [-1, 0, 1]
    world = rotations.normalize(random.normal(size=(frames, 3, 4)))
    bones = random.normal(size=(3, 3))
    positions = random.normal(size=(frames, 3, 3))
    for joint in (1, 2):
        positions[:, joint] = positions[:, joint - 1] + rotations.rotate(world[:, joint - 1], bones[joint])
    np.savez(
        tmp_path / "take.npz", positions=positions, quaternions=world[..., [1, 2, 3, 0]], bone_names=np.array(["a", "b", "c"]),
        parent_indices=np.array(parents), framerate=60.0,
    )  # fmt: skip
    motion = read_transforms(tmp_path / "take.npz")
    found, turned = motion.world()
    np.testing.assert_allclose(found, positions, atol=1e-9)
    assert rotations.angle_between(turned, world).max() < 1e-6
    np.testing.assert_allclose(motion.skeleton.offsets[1:], bones[1:], atol=1e-9)
    (tmp_path / "none.npz").write_bytes(b"")
    with pytest.raises(FileError, match=r"none\.npz"):
        read_transforms(tmp_path / "none.npz")


def test_root_travel_scales_with_leg_length() -> None:
    _, positions, _ = retargeted(march())
    travelled = positions[-1, 0, 2] - positions[0, 0, 2]
    np.testing.assert_allclose(travelled, 0.6 * (FRAMES - 1) / 60 * (0.8351 / 0.92), rtol=0.02)


def test_thirty_fps_is_resampled_to_the_same_motion() -> None:
    a, b = retargeted(march(60.0))[1], retargeted(march(30.0))[1]
    assert len(b) == len(a) - 1
    assert np.abs(a[: len(b)] - b).max() < 0.03


def test_resampling_hits_source_frames() -> None:
    times = sample_times(11, 30.0)
    p = np.random.default_rng(0).normal(size=(11, 3)).cumsum(0)
    q = rotations.normalize(np.random.default_rng(1).normal(size=(11, 2, 4)))
    assert len(times) == 21
    np.testing.assert_allclose(resample_positions(p, times)[::2], p, atol=1e-9)
    assert rotations.angle_between(resample_rotations(q, times)[::2], q).max() < 1e-6


def test_every_axis_map_is_a_rotation() -> None:
    motion = parse_bvh(march())
    for skeleton in known_skeletons():
        for target, joint in skeleton.joints.items():
            assert target in SPORT_SKELETON.names
            if joint.axes:
                c = skeleton.corrections(motion)[target] if skeleton.name == "100style" else None
                assert c is None or np.isclose(np.linalg.norm(c), 1.0)
                words = joint.axes.split()
                x, y, z = (np.eye(3)["XYZ".index(w[1])] * (1 if w[0] == "+" else -1) for w in words)
                np.testing.assert_allclose(np.cross(x, y), z, err_msg=f"{skeleton.name} {target}")


def test_unknown_skeleton_is_named() -> None:
    root = Skeleton(("a",), (-1,), np.zeros((1, 3), np.float32))
    text = format_bvh(root, {0: np.zeros((2, 3))}, rotations.identity((2, 1)), 60)
    with pytest.raises(FileError, match=r"odd\.bvh: unknown skeleton.*skeletons\.toml"):
        recognise(parse_bvh(text), "odd.bvh")


def standing(frames: int, slide: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    hips = np.tile([0.0, REST_HIPS_HEIGHT, 0.0], (frames, 1)).astype(np.float32)
    hips[:, 2] += slide * np.arange(frames) / 60
    return hips, np.tile(rotations.identity((31,)), (frames, 1, 1))


def test_clean_feet_stops_sliding_and_follows_a_slope() -> None:
    hips, local = standing(90, slide=0.1)
    contacts = np.ones((90, 4), np.uint8)
    slope = 0.2
    hips, local = clean_feet(hips, local, contacts, lambda x, z: slope * z)
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    for joint, rest in ((4, ANKLE_HEIGHT), (5, TOE_HEIGHT), (9, ANKLE_HEIGHT), (10, TOE_HEIGHT)):
        p = positions[:, joint]
        assert np.ptp(p[:, [0, 2]], axis=0).max() < 0.005
        np.testing.assert_allclose(p[:, 1], slope * p[:, 2] + rest, atol=0.006)


def test_clean_feet_lifts_a_sunk_foot() -> None:
    hips, local = standing(60)
    hips[:, 1] -= 0.1
    hips, local = clean_feet(hips, local, np.ones((60, 4), np.uint8), lambda x, z: np.zeros_like(x))
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    np.testing.assert_allclose(positions[:, [5, 10], 1], TOE_HEIGHT, atol=0.003)


def test_bridge_holds_ends_and_joins_smoothly() -> None:
    values = np.array([[1.0], [1.0], [0], [0], [0], [3.0], [3.0], [0]])
    known = np.array([1, 1, 0, 0, 0, 1, 1, 0], bool)
    filled = bridge(values, known, hold_slope=True)[:, 0]
    assert stretches(known) == [(0, 2), (5, 7)]
    np.testing.assert_allclose(filled[3], 2.0)
    assert np.all(np.diff(filled) >= 0)
    assert filled[-1] == 3.0


def test_contacts_and_gait_of_standing_and_running() -> None:
    hips, local = standing(120)
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    level = np.zeros((120, 4))
    assert labels.foot_contacts(positions, level).all()
    moving = positions + np.array([0, 0, 3.0]) * (np.arange(120) / 60)[:, None, None]
    assert not labels.foot_contacts(moving, level).any()
    raised = positions + np.array([0, 0.2, 0])
    assert not labels.foot_contacts(raised, level).any()
    stand = labels.label_gait(hips, np.ones((120, 4)), np.zeros(120), "idle")
    np.testing.assert_allclose(stand[:, 0], 1.0)
    jog = labels.label_gait(moving[:, 0], np.zeros((120, 4)), np.zeros(120), "run forward")
    assert np.argmax(jog, 1).tolist() == [2] * 120
    np.testing.assert_allclose(jog.sum(1), 1.0, rtol=1e-6)


def test_spikes_split_a_clip() -> None:
    hips, local = standing(400)
    hips[200:, 0] += 2.0
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    parts = cutting.segments(0, 400, cutting.spikes(hips, local, positions, "exact"))
    assert len(parts) == 2
    assert parts[0][1] < 200 < parts[1][0]
    assert cutting.segments(0, 60, np.zeros(400, bool)) == []


def test_held_out_is_stable_and_never_the_only_example() -> None:
    clips = [(f"c{i}", f"style{i % 5}", "walk") for i in range(100)] + [("only", "style0", "run")]
    held = cutting.held_out_names(clips)
    assert held == cutting.held_out_names(clips[::-1])
    assert "only" not in held
    assert {f"style{i}" for i in range(5)} == {style for name, style, _ in clips if name in held}
    train, tail = cutting.tail_split(100, 2000)
    assert tail[0] - train[1] == cutting.GAP_S * 60
    assert (train[2], tail[2]) == ("train", "held_out")


def test_relief_meets_footsteps() -> None:
    hips, local = standing(30)
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    contacts = np.ones((30, 4), np.uint8)
    patches = relief.fit_around_steps(positions, contacts, np.random.default_rng(3))
    feet = positions[:, labels.FOOT_JOINTS]
    assert patches.heights[0].any() == np.False_
    for k in (1, 2):
        assert np.abs(patches.terrain(k).height(feet[..., 0], feet[..., 2])).max() < 1e-6
        assert np.abs(patches.heights[k]).max() > 0.03


def test_mirror_is_an_involution_and_moves_the_ground() -> None:
    generator = np.random.default_rng(5)
    patches = Patches(generator.normal(size=(2, 4, 3)), (1.0, -2.0), 0.5)
    local = rotations.continuous(rotations.normalize(generator.normal(size=(8, 31, 4)).astype(np.float32)))
    clip = TrainingClip(
        "a", generator.normal(size=(8, 3)).astype(np.float32), local, generator.integers(0, 2, (8, 4), np.uint8),
        np.eye(6)[np.zeros(8, int)], "s", "walk", "cmu", "train", "exact", patches,
    )  # fmt: skip
    mirrored = clip.mirror()
    assert mirrored.mirrored
    x, z = np.array([1.2, 2.1]), np.array([-1.9, -1.3])
    for k in range(2):
        heights = mirrored.patches.terrain(k).height(-x, z), patches.terrain(k).height(x, z)
        np.testing.assert_allclose(*heights, atol=1e-5)
    twice = mirrored.mirror()
    assert rotations.angle_between(twice.local, clip.local).max() < 1e-3
    np.testing.assert_array_equal(twice.contacts, clip.contacts)
    np.testing.assert_allclose(twice.hips, clip.hips)


def test_wrapped_height_repeats() -> None:
    heights = np.random.default_rng(2).normal(size=(8, 6))
    x, z = np.array([0.13, -0.4]), np.array([0.2, 0.05])
    other = wrapped_height(heights, 0.1, x + 0.8, z - 0.6)
    np.testing.assert_allclose(wrapped_height(heights, 0.1, x, z), other)
    np.testing.assert_allclose(wrapped_height(heights, 0.1, np.zeros(1), np.zeros(1)), heights[4, 3])


def test_import_writes_the_contract(tmp_path: Path) -> None:
    folder = tmp_path / "data" / "100style" / "original"
    folder.mkdir(parents=True)
    (folder / "Angry_FW.bvh").write_text(march(), encoding="utf-8")
    (folder / "Angry_ID.bvh").write_text("not a BVH", encoding="utf-8")
    report = import_all(tmp_path / "data", tmp_path / "out", workers=1)
    names = sorted(p.stem for p in (tmp_path / "out" / "clips").iterdir())
    assert names == [f"100style_Angry_FW{part}" for part in ("", "_m", "_t", "_t_m")]
    with np.load(tmp_path / "out" / "clips" / "100style_Angry_FW.npz", allow_pickle=False) as clip:
        frames = len(clip["hips_positions"])
        assert frames > 200
        assert clip["local_rotations"].shape == (frames, 31, 4)
        assert clip["contacts"].shape == (frames, 4)
        assert clip["contacts"].dtype == np.uint8
        assert clip["gait"].shape == (frames, 6)
        assert (str(clip["style"]), str(clip["content"])) == ("angry", "walk forward")
        assert clip["patch_heights"].dtype == np.float16
        _, world = SPORT_SKELETON.forward_kinematics(clip["hips_positions"], clip["local_rotations"])
        np.testing.assert_allclose(pitch(world, "Head"), 16.0, atol=0.1)  # the rig looks straight ahead
        assert np.all(np.sum(clip["local_rotations"][1:] * clip["local_rotations"][:-1], -1) > 0)
    assert any("Angry_ID" in r.name and "HIERARCHY" in r.reason for r in report.refused)
    assert "| angry |" in report.markdown()
    written = json.loads((tmp_path / "out" / "report.json").read_text("utf-8"))
    assert [clip["name"] for clip in written["clips"]] == [clip["name"] for clip in report.clips]


def test_an_import_for_the_open_model_leaves_bound_archives_out(tmp_path: Path) -> None:
    for archive, name in (("100style", "Angry_FW"), ("pfnn", "LocomotionFlat01_000")):
        (tmp_path / archive).mkdir()
        (tmp_path / archive / f"{name}.bvh").write_text(march(), encoding="utf-8")
    every, _ = list_clips(tmp_path)
    free, refused = list_clips(tmp_path, free_only=True)
    assert {clip.source for clip in every} == {"100style", "pfnn"}
    assert {clip.source for clip in free} == {"100style"}
    assert ("pfnn", "licence is non-commercial") in {(r.name, r.reason) for r in refused}
    assert licence_of({"100style", "o3de"}) == FREE != licence_of({"100style", "pfnn"})
    assert credits_of({"100style", "100style_more"}) == ["The 100STYLE Dataset - Ian Mason (CC BY 4.0)"]


def test_import_without_data_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="--data"):
        import_all(tmp_path, tmp_path / "out")
