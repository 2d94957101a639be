"""Options of an export: where a take stands, what is left of its way, and that nothing of it is lost on the way back."""

import json
from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.errors import UsageError
from runtime.formats.bvh import read_bvh
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.formats.prepare import ExportOptions, on_its_ground, prepare
from runtime.formats.sidecar import sidecar_path
from runtime.formats.table import save_motion
from runtime.motion import features
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent, title
from runtime.takes.root import Placement, root_track
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import load_terrain
from sport.commands.export import parse_range
from tests.helpers.walker import walk

FLAT, HILLS = Terrain.flat(), load_terrain("hills")


def moved_walk(frames: int = 240, yaw: float = 0.7, at: tuple[float, float] = (3.0, -2.0)) -> Clip:
    """A straight walk that begins somewhere, in some direction."""
    clip = Clip("walk", 60.0, *walk(frames), prompts=(PromptEvent(0.0, "calm"), PromptEvent(2.0, "drunk", 0.5)),
                gaits=np.repeat([1, 2], frames // 2).astype(np.int8), terrain="flat")  # fmt: skip
    return Placement(yaw, (at[0], 0.0, at[1])).clip(clip)


def test_plain_options_write_the_same_bvh_as_ever(tmp_path: Path) -> None:
    clip = moved_walk()
    save_bvh(clip, tmp_path / "a.bvh", 60)
    save_motion(clip, tmp_path / "b.bvh", ExportOptions(), FLAT)
    assert (tmp_path / "a.bvh").read_bytes() == (tmp_path / "b.bvh").read_bytes()
    sides = [json.loads(sidecar_path(tmp_path / name).read_text()) for name in ("a.bvh", "b.bvh")]
    assert sides[0] == sides[1]


def test_the_root_goes_smoothly_where_the_character_goes() -> None:
    clip = moved_walk()
    track = root_track(clip, FLAT)
    away = np.linalg.norm(track.positions[:, [0, 2]] - clip.hips_positions[:, [0, 2]], axis=1)
    assert away.max() < 0.05
    assert np.abs(track.yaw - 0.7).max() < 0.05
    assert np.abs(track.positions[:, 1]).max() < 1e-6
    speed = np.linalg.norm(np.diff(track.positions, axis=0), axis=1) * 60
    assert np.ptp(speed) < 0.02, "a walk at one pace"
    assert np.abs(root_track(clip).positions[:, 1]).max() < 0.02, "without a ground, the lowest sole"


def test_a_take_at_the_origin_faces_forward() -> None:
    take = prepare(moved_walk(), ExportOptions(at_origin=True), FLAT)
    assert np.allclose(take.root.positions[0], 0.0, atol=1e-6)
    assert take.root.yaw[0] == pytest.approx(0.0, abs=1e-6)
    assert take.clip.hips_positions[-1, 2] > 3.0
    assert abs(take.clip.hips_positions[-1, 0]) < 0.2
    assert np.allclose(take.placement.points(np.array([3.0, 0.0, -2.0])), 0.0, atol=0.05)


def test_in_place_the_way_is_gone_and_the_steps_stay() -> None:
    clip = moved_walk()
    take = prepare(clip, ExportOptions(in_place=True, at_origin=True), FLAT)
    assert np.abs(take.clip.hips_positions[:, [0, 2]]).max() < 0.06
    assert np.array_equal(take.clip.local_rotations[:, 1:], clip.local_rotations[:, 1:])
    assert take.clip.placed is None


def test_a_take_in_place_keeps_its_root_still_when_it_is_written_again(tmp_path: Path) -> None:
    save_motion(moved_walk(), tmp_path / "a.bvh", ExportOptions(in_place=True, ground_root=True))
    again = load_clip_bvh(tmp_path / "a.bvh")
    save_motion(again, tmp_path / "b.bvh", ExportOptions(ground_root=True))
    assert np.abs(read_bvh(tmp_path / "b.bvh").positions[:, 0]).max() < 1e-3
    assert np.abs(load_clip_bvh(tmp_path / "b.bvh").world()[0] - again.world()[0]).max() < 1e-3


def test_in_place_on_a_hill_stays_on_one_level() -> None:
    hips, local, contacts = walk(700, terrain=HILLS)
    clip = Clip("up", 60.0, hips, local, contacts, terrain="hills")
    take = prepare(clip, ExportOptions(in_place=True), HILLS)
    assert np.ptp(hips[:, 1]) > 0.25
    assert np.ptp(take.clip.hips_positions[:, 1]) < 0.6 * np.ptp(hips[:, 1])


def test_a_range_is_cut_with_its_prompts() -> None:
    take = prepare(moved_walk(), ExportOptions(start_s=1.0, end_s=3.0), FLAT)
    assert len(take.clip) == 121
    assert [event.seconds for event in take.clip.prompts] == [0.0, 1.0]
    with pytest.raises(UsageError, match=r"start_s 9: the clip lasts 4\.0 s"):
        prepare(moved_walk(), ExportOptions(start_s=9.0), FLAT)


@pytest.mark.parametrize(
    ("text", "wanted"), [("2:6.5", (2.0, 6.5)), ("2:", (2.0, None)), (":6", (0.0, 6.0)), (":", (0.0, None))]
)
def test_ranges_are_read(text: str, wanted: tuple) -> None:
    assert parse_range(text) == wanted


def test_options_that_cannot_be_are_named() -> None:
    for bad, message in ((ExportOptions(fps=0), "fps 0"), (ExportOptions(unit="inch"), "unit inch"),
                         (ExportOptions(start_s=3, end_s=2), "start_s 3:2"),
                         (ExportOptions(in_place=True, with_ground=True), "in_place")):  # fmt: skip
        with pytest.raises(UsageError, match=message):
            bad.check()
    with pytest.raises(UsageError, match="range two"):
        parse_range("two")


@pytest.mark.parametrize("unit", ["cm", "m"])
def test_a_bvh_with_a_root_on_the_ground_is_the_same_motion(tmp_path: Path, unit: str) -> None:
    clip = moved_walk()
    save_motion(clip, tmp_path / "rooted.bvh", ExportOptions(ground_root=True, unit=unit), FLAT)
    motion = read_bvh(tmp_path / "rooted.bvh")
    assert motion.skeleton.names[:2] == ("Root", "Hips")
    scale = {"cm": 0.01, "m": 1.0}[unit]
    positions, _ = motion.world()
    assert np.abs(positions[:, 0, 1]).max() * scale < 1e-4, "the root is on the ground"
    assert np.allclose(positions[:, 1:] * scale, clip.world()[0], atol=1e-4)
    facing = features.facing_yaw(clip.world()[0])
    turn = rotations.rotate(motion.local_rotations[:, 0], np.array([0.0, 0, 1]))
    assert np.abs(np.arctan2(turn[:, 0], turn[:, 2]) - facing).max() < 0.2
    back = load_clip_bvh(tmp_path / "rooted.bvh")
    assert np.allclose(back.world()[0], clip.world()[0], atol=1e-4)


def test_the_rest_pose_is_the_first_frame(tmp_path: Path) -> None:
    save_motion(moved_walk(), tmp_path / "rest.bvh", ExportOptions(rest_frame=True, at_origin=True), FLAT)
    back = load_clip_bvh(tmp_path / "rest.bvh")
    assert len(back) == 241
    rest = SPORT_SKELETON.rest_positions
    positions = back.world()[0][0]
    assert np.allclose(positions - positions[0], rest, atol=1e-4)
    assert back.prompts[1].seconds == pytest.approx(2.0 + 1 / 60, abs=1e-3)


def test_a_take_that_was_moved_finds_its_ground_again(tmp_path: Path) -> None:
    hips, local, contacts = walk(500, terrain=HILLS)
    clip = Clip("up", 60.0, hips, local, contacts, terrain="hills").trim(250, 499)
    save_motion(clip, tmp_path / "moved.bvh", ExportOptions(at_origin=True), HILLS)
    moved = load_clip_bvh(tmp_path / "moved.bvh")
    assert moved.placed != (0.0, 0.0, 0.0, 0.0)
    assert np.allclose(on_its_ground(moved).world()[0], clip.world()[0], atol=1e-3)
    again = prepare(moved, ExportOptions(), HILLS)
    # it stays where it was exported to
    assert np.allclose(again.clip.world()[0], moved.world()[0], atol=1e-3)


def test_gaits_and_typed_prompts_come_back(tmp_path: Path) -> None:
    parts = json.dumps({"left_arm": "hangs"})
    clip = Clip("walk", 60.0, *walk(60), prompts=(PromptEvent(0.0, "x", 0.0, parts, "a proud queen"),),
                gaits=np.repeat([1, 0, 3], 20).astype(np.int8))  # fmt: skip
    save_bvh(clip, tmp_path / "take.bvh", 30)
    back = load_clip_bvh(tmp_path / "take.bvh")
    assert back.gaits is not None
    assert np.array_equal(back.gaits, np.repeat([1, 0, 3], 10))
    assert back.prompts[0].typed == "a proud queen"
    assert title(back.prompts[0]) == "a proud queen (edited)"


@pytest.mark.parametrize("damage", [{"gaits": [["x", 1], [1.0, "fly"], 3]}, {"gaits": 5}, {"placed": [1, 2]},
                                    {"placed": "here"}, {"placed": [0, 0, None, 0]}])  # fmt: skip
def test_damaged_fields_are_left_out(tmp_path: Path, damage: dict) -> None:
    path = save_bvh(Clip("walk", 60.0, *walk(60)), tmp_path / "take.bvh")
    value = json.loads(sidecar_path(path).read_text())
    sidecar_path(path).write_text(json.dumps(value | damage))
    back = load_clip_bvh(path)
    assert back.gaits is None
    assert back.placed == (0.0, 0.0, 0.0, 0.0)
