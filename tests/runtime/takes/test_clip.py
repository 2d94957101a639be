"""Clips, the recorder that is always on, and takes as BVH."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from runtime import rotations
from runtime.controls import Gait
from runtime.errors import FileError, UsageError
from runtime.formats.bvh import read_bvh
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.formats.sidecar import sidecar_path
from runtime.pose import Pose
from runtime.session.motion import Motion
from runtime.skeleton import SPORT_SKELETON, J
from runtime.takes.clip import Clip
from runtime.takes.metadata import Origin, PromptEvent, origin_of
from runtime.takes.recorder import ClipRecorder
from tests.helpers.walker import walk


def make_clip(frames=61, **changes):
    return Clip(**{"name": "take", "fps": 60.0, **dict(zip(("hips_positions", "local_rotations", "contacts"),
                walk(frames), strict=True)), **changes})  # fmt: skip


def make_pose(x):
    local = rotations.identity((J,))
    hips = np.array([x, 1.0, 0.0], np.float32)
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    return Pose(hips, local, positions, world, np.zeros(4, np.float32), hips * [1, 0, 1], 0.0)


def add(recorder, *frames):
    """Poses whose x is their number, for a range of numbers."""
    for k in range(*frames):
        recorder.add(make_pose(k))


def test_poses_are_forward_kinematics_of_their_frame():
    clip = make_clip()
    positions, world = clip.world()
    pose = clip.pose(7, ground_m=0.25)
    np.testing.assert_allclose(pose.positions, positions[7], atol=1e-6)
    np.testing.assert_allclose(pose.world_rotations, world[7], atol=1e-6)
    assert pose.root_position[1] == pytest.approx(0.25)
    assert pose.root_yaw == pytest.approx(0.0, abs=1e-6)


def test_sampling_interpolates_and_stops_at_the_ends():
    clip = make_clip()
    np.testing.assert_allclose(clip.sample(10 / 60).hips_position, clip.hips_positions[10], atol=1e-6)
    between = clip.sample(10.5 / 60).hips_position
    np.testing.assert_allclose(between, clip.hips_positions[10:12].mean(0), atol=1e-6)
    np.testing.assert_allclose(clip.sample(-1.0).hips_position, clip.hips_positions[0])
    np.testing.assert_allclose(clip.sample(99.0).hips_position, clip.hips_positions[-1])


def test_trimming_keeps_both_ends_and_the_prompt_in_force():
    clip = make_clip(prompts=(PromptEvent(0.0, "a"), PromptEvent(0.25, "b"), PromptEvent(0.75, "c")))
    part = clip.trim(30, 60)
    assert len(part) == 31
    np.testing.assert_array_equal(part.hips_positions, clip.hips_positions[30:61])
    assert part.prompts == (PromptEvent(0.0, "b"), PromptEvent(0.25, "c"))
    for first, last in ((-1, 5), (5, 4), (0, 61)):
        with pytest.raises(UsageError, match="frames 0 to 60"):
            clip.trim(first, last)


@pytest.mark.parametrize(("fps", "frames"), [(30.0, 31), (60.0, 61), (120.0, 121), (24.0, 25)])
def test_resampling_keeps_the_time(fps, frames):
    clip = make_clip()
    other = clip.resampled(fps)
    assert len(other) == frames
    assert other.seconds == pytest.approx(1.0)
    np.testing.assert_allclose(other.hips_positions[-1], clip.hips_positions[-1], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(other.local_rotations, axis=-1), 1.0, atol=1e-5)


# --- recorder
def test_a_take_is_what_was_added_between_start_and_stop():
    recorder = ClipRecorder(max_seconds=1.0)
    add(recorder, 10)
    recorder.start()
    add(recorder, 10, 15)
    assert recorder.recording
    assert recorder.take_seconds == pytest.approx(5 / 60)
    clip = recorder.stop("mine", "hills")
    assert not recorder.recording
    assert (clip.name, clip.terrain) == ("mine", "hills")
    np.testing.assert_array_equal(clip.hips_positions[:, 0], np.arange(10, 15))
    assert clip.local_rotations.shape == (5, J, 4)


def test_the_past_is_kept_for_a_while_and_a_running_take_longer():
    recorder = ClipRecorder(max_seconds=0.5)
    add(recorder, 100)
    assert recorder.seconds == pytest.approx(0.5)
    np.testing.assert_array_equal(recorder.last(0.1).hips_positions[:, 0], np.arange(94, 100))
    np.testing.assert_array_equal(recorder.last(99.0).hips_positions[:, 0], np.arange(70, 100))
    recorder.start()
    add(recorder, 100, 200)
    np.testing.assert_array_equal(recorder.stop().hips_positions[:, 0], np.arange(100, 200))
    recorder.add(make_pose(200))
    assert recorder.seconds == pytest.approx(0.5)


def test_prompts_are_placed_in_the_take():
    recorder = ClipRecorder()
    recorder.mark_prompt("calm")
    add(recorder, 30)
    recorder.start()
    for k in range(60):
        if k == 15:
            recorder.mark_prompt("drunk")
        recorder.add(make_pose(k))
    assert recorder.stop().prompts == (PromptEvent(0.0, "calm"), PromptEvent(0.25, "drunk"))


def test_prompts_that_no_kept_frame_needs_are_forgotten():
    recorder = ClipRecorder(max_seconds=1.0)
    for k in range(600):
        if k % 20 == 0:
            recorder.mark_prompt(f"style {k}", 0.5)
        recorder.add(make_pose(k))
    events = recorder.last(99.0).prompts
    assert [(event.prompt, event.seconds) for event in events] == [
        ("style 540", 0.0), ("style 560", pytest.approx(1 / 3)), ("style 580", pytest.approx(2 / 3))
    ]  # fmt: skip
    add(recorder, 30)
    # it came before the first frame that is kept, and holds there
    assert recorder.last(99.0).prompts[0].prompt == "style 560"


def test_a_slider_under_the_hand_leaves_few_events_and_where_it_came_to_rest():
    recorder = ClipRecorder()
    recorder.mark_prompt("calm", 0.8)
    recorder.add(make_pose(0))
    recorder.start()
    for k in range(120):  # two seconds, an event in every frame
        recorder.mark_prompt(f"blend {k}", 0.1)
        recorder.add(make_pose(k))
    add(recorder, 60)
    recorder.mark_prompt("drunk", 0.8)
    recorder.mark_prompt("drunk, blended", 0.1)
    recorder.add(make_pose(0))
    events = recorder.stop().prompts
    live = [event for event in events if event.prompt.startswith("blend ")]
    assert len(live) == 20  # one for each transition that a live change takes
    assert live[-1].prompt == "blend 119"
    assert max(abs(e.seconds - int(e.prompt.split()[1]) / 60) for e in live) < 0.1
    assert [event.prompt for event in events[-2:]] == ["drunk", "drunk, blended"]  # no live change before it


def test_stopping_without_a_take_is_an_error():
    recorder = ClipRecorder()
    with pytest.raises(UsageError, match="no take"):
        recorder.stop()
    with pytest.raises(UsageError, match="nothing is recorded"):
        recorder.last(1.0)


# --- BVH
@pytest.mark.parametrize(("fps", "unit", "order"), [(60, "cm", "ZYX"), (30, "m", "YXZ"), (120, "cm", "XYZ")])
def test_a_saved_clip_reads_back(tmp_path, fps, unit, order):
    clip = make_clip()
    path = save_bvh(clip, tmp_path / "new" / "take.bvh", fps, unit, order)
    back, wanted = load_clip_bvh(path), clip.resampled(fps)
    assert (back.name, back.fps, len(back)) == ("take", fps, len(wanted))
    np.testing.assert_allclose(back.world()[0], wanted.world()[0], atol=1e-4)
    np.testing.assert_allclose(back.hips_positions, wanted.hips_positions, atol=1e-5)
    assert [p.name for p in path.parent.iterdir() if p.suffix == ".bvh"] == ["take.bvh"]


def test_joint_names_and_channels_are_what_readers_expect(tmp_path):
    text = save_bvh(make_clip(), tmp_path / "take.bvh").read_text()
    joints = [line.split() for line in text.splitlines() if line.split()[0] in ("ROOT", "JOINT")]
    names = read_bvh(tmp_path / "take.bvh").skeleton.names
    assert [words[1] for words in joints] == list(names[:J])
    assert all(len(words) == 2 for words in joints)
    assert text.count("CHANNELS 6 Xposition Yposition Zposition") == 1
    assert text.count("End Site") == sum(not c for c in SPORT_SKELETON.children)


@pytest.mark.parametrize(("fps", "unit", "order"), [(0, "cm", "ZYX"), (60, "inch", "ZYX"), (60, "cm", "ZZX")])
def test_unknown_options_are_refused_before_anything_is_written(tmp_path, fps, unit, order):
    with pytest.raises(UsageError):
        save_bvh(make_clip(), tmp_path / "take.bvh", fps, unit, order)
    assert not list(tmp_path.iterdir())


REST = "JOINT LeftForeArm\n"


def at_rest(text):
    head, tail = text.split(REST, 1)
    return head + REST + tail.replace("OFFSET 28.13000 0.00000", "OFFSET 0.00000 -28.13000", 1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("T LThumb", "T Pinky").replace("T Head", "T Skull"), "joint Head, LThumb is missing"),
        (at_rest, ".*LeftForeArm rests"),
        (lambda text: text.replace("Time: 0.0166666667", "Time: 0.0005"), "2000 frames per second"),
    ],
    ids=["missing joints", "another rest pose", "a rate that no clip has"],
)  # fmt: skip
def test_what_is_no_take_of_ours_is_named(tmp_path, change, said):
    path = save_bvh(make_clip(), tmp_path / "take.bvh")
    path.write_text(change(path.read_text()))
    with pytest.raises(FileError, match=rf"take\.bvh: {said}"):
        load_clip_bvh(path)


# --- what a take was made with
PARTS = dict.fromkeys(("left_arm", "right_arm", "left_leg", "right_leg", "torso", "head"), "it swings")
ORIGIN = Origin("compact", "82" * 32, "fp32", 7, 0.5, 1.25, 0)


def made_clip(**changes):
    events = (PromptEvent(0.0, "calm"), PromptEvent(0.5, "drunk", 0.25, json.dumps(PARTS)))
    known = {"prompts": events, "terrain": "hills", "origin": ORIGIN, "gait_seconds": (("walk", 1.0),)}
    return make_clip(**{**known, **changes})


def test_a_file_tells_how_it_was_made(tmp_path):
    clip = made_clip()
    path = save_bvh(clip, tmp_path / "take.bvh", 30)
    told = json.loads(sidecar_path(path).read_text("utf-8"))
    assert told["seed"] == 7
    wanted = {"seconds": 0.5, "prompt": "drunk", "transition_seconds": 0.25, "words": PARTS, "typed": ""}
    assert told["prompts"][1] == wanted
    back = load_clip_bvh(path)
    assert (back.origin, back.prompts, back.terrain) == (ORIGIN, clip.prompts, "hills")
    text = Motion.of(back).header.describe()
    assert text == Motion.of(clip).header.describe()
    for word in ("drunk", "0.5 s", "walk 1.0 s", "compact 82828282", "seed 7", "hills"):
        assert word in text


def test_a_ground_from_a_file_goes_by_its_name_without_its_folders(tmp_path):
    path = save_bvh(made_clip(terrain="/home/somebody/secret/hill.png"), tmp_path / "take.bvh")
    assert "somebody" not in sidecar_path(path).read_text("utf-8")
    assert load_clip_bvh(path).terrain == "hill.png"


@pytest.mark.parametrize("damage", ["missing", "cut", "a list", "another", "changed bvh", "not text"])
def test_a_motion_opens_without_its_metadata(tmp_path, damage, caplog):
    path = save_bvh(made_clip(), tmp_path / "take.bvh")
    beside = sidecar_path(path)
    if damage == "missing":  # as older programs wrote it
        beside.unlink()
    elif damage == "changed bvh":
        path.write_text(path.read_text() + "\n")
    else:
        wrong = {"a list": "[1]", "another": '{"format": "x"}', "not text": "\xff"}
        wrong["cut"] = beside.read_text()[:80]
        beside.write_bytes(wrong[damage].encode("latin-1"))
    back = load_clip_bvh(path)
    assert len(back) == 61
    assert (back.origin, back.prompts, back.gait_seconds) == (Origin(), (), ())
    assert ("take.bvh.json" in caplog.text) == (damage != "missing")


def test_fields_of_another_type_or_from_another_version_are_left_out(tmp_path):
    path = save_bvh(made_clip(), tmp_path / "take.bvh")
    told = json.loads(sidecar_path(path).read_text("utf-8"))
    told |= {"seed": "7", "model": 3, "strength": float("nan"), "gait_seconds": [1]}
    told |= {"terrain": None, "new": 1}
    told["prompts"] = [5, {"seconds": "x", "prompt": "calm", "words": "x"}, {}]
    sidecar_path(path).write_text(json.dumps(told), "utf-8")
    back = load_clip_bvh(path)
    assert back.origin == Origin("", "82" * 32, "fp32", None, 0.5, None, 0)
    assert back.prompts == (PromptEvent(0.0, "calm"), PromptEvent(0.0, ""))
    assert (back.terrain, back.gait_seconds) == ("flat", ())


def test_a_cut_keeps_what_is_left_of_a_transition_and_the_gaits_of_its_frames():
    recorder = ClipRecorder()
    recorder.start()
    for k in range(60):
        if k == 12:
            recorder.mark_prompt("drunk", 0.5, json.dumps(PARTS))
        recorder.add(make_pose(k), Gait.JOG if k < 30 else Gait.WALK)
    take = recorder.stop("take", "hills", ORIGIN)
    assert (take.origin, dict(take.gait_seconds)) == (ORIGIN, {"walk": 0.5, "jog": 0.5})
    part = take.trim(24, 35)
    assert dict(part.gait_seconds) == {"walk": 0.1, "jog": 0.1}
    assert part.prompts[0].transition_seconds == pytest.approx(0.3)
    assert take.trim(50, 59).prompts == (PromptEvent(0.0, "drunk", 0.0, json.dumps(PARTS)),)
    np.testing.assert_array_equal(part.contacts, 0.0)


def test_the_origin_names_the_step_graph_that_ran():
    model = SimpleNamespace(name="m", precision="int8", metadata={"sha256": {"step": "a", "step_int8": "b"}})
    found = origin_of(SimpleNamespace(model=model, seed=3, temperature=1.0, strength=1.0), "hill.png")
    assert found == Origin("m", "b", "int8", 3, 1.0, 1.0, None)
    assert origin_of(None, "hills") == Origin(terrain_seed=0)
