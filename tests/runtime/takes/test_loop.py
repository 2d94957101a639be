"""Loops: a cycle whose last frame is its first one, and feet that stay where they stand."""

from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.errors import UsageError
from runtime.feet.ik import LEG_FEET, solve_legs
from runtime.formats.bvh_clip import load_clip_bvh
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.table import save_motion
from runtime.takes.clip import Clip
from runtime.takes.loop import seam_error
from runtime.takes.root import Placement
from runtime.terrain.height_map import Terrain
from tests.helpers.walker import CYCLE_FRAMES, walk

FLAT = Terrain.flat()
LOOP = ExportOptions(loop=True)


def uneven_walk(frames: int = 400) -> Clip:
    """A walk whose body sways and sinks slowly, so that no two cycles are alike; its feet keep their places."""
    hips, local, contacts = walk(frames)
    t = np.arange(frames) / 60.0
    positions, world = Clip("w", 60.0, hips, local, contacts).world()
    ankles, feet = positions[:, LEG_FEET], world[:, LEG_FEET]
    away = np.stack([0.015 * np.sin(1.1 * t), -0.05 + 0.01 * np.sin(0.7 * t), 0 * t], -1)
    hips = hips + away.astype(np.float32)
    bend = rotations.from_axis_angle(np.tile([0.0, 0.0, 1.0], (frames, 1)), 0.12 * np.sin(0.9 * t))
    for joint in (11, 15, 18, 25):
        local[:, joint] = rotations.multiply(local[:, joint], bend)
    local = solve_legs(hips, local, ankles, feet)
    return Placement(0.6, (1.0, 0.0, 2.0)).clip(Clip("w", 60.0, hips, local.astype(np.float32), contacts))


@pytest.mark.parametrize("fps", [60.0, 30.0])
def test_the_seam_closes(fps: float) -> None:
    take = prepare(uneven_walk(), ExportOptions(loop=True, fps=fps), FLAT)
    report = take.clip.loop
    assert abs(len(take.clip) - 1 - CYCLE_FRAMES * fps / 60) <= 0.06 * CYCLE_FRAMES, "one cycle, not two"
    assert report.ends_cm > 0.3, "there was something to blend"
    distance, angle = seam_error(take.clip, take.root)
    assert distance < 0.01
    assert np.rad2deg(angle) < 2.0
    assert report.seam_cm == pytest.approx(distance * 100)
    assert report.step_cm <= 1.5 * report.usual_step_cm, "no jerk at the seam"


@pytest.mark.parametrize("strides", [2, 3])
def test_a_loop_of_several_strides(strides: int) -> None:
    take = prepare(uneven_walk(), ExportOptions(loop=True, strides=strides), FLAT)
    assert abs(len(take.clip) - 1 - strides * CYCLE_FRAMES) <= 0.1 * CYCLE_FRAMES
    assert take.clip.loop.seam_cm < 0.01
    with pytest.raises(UsageError, match="loop"):
        prepare(uneven_walk(100), ExportOptions(loop=True, strides=8), FLAT)


def feet_way(positions: np.ndarray) -> np.ndarray:
    """How far each ankle goes over the ground from frame to frame `(T - 1, 2)`."""
    return np.linalg.norm(np.diff(positions[:, LEG_FEET].astype(float), axis=0)[..., [0, 2]], axis=-1)


def test_feet_slide_no_more_than_before_in_the_loop_and_over_its_seam() -> None:
    source = uneven_walk()
    take = prepare(source, LOOP, FLAT)
    clip, root, report = take.clip, take.root, take.clip.loop
    cycle = source.trim(report.first, report.last)
    turn = rotations.from_yaw(root.yaw[-1] - root.yaw[0])
    positions = clip.world()[0].astype(float)
    second = root.positions[-1] + rotations.rotate(turn, positions - root.positions[0])
    played = feet_way(np.concatenate([positions, second[1:]]))
    before = np.tile(feet_way(cycle.world()[0]), (2, 1))
    contacts = np.concatenate([cycle.contacts[:-1, ::2], cycle.contacts[:, ::2]])
    standing = (contacts[1:] > 0.5) & (contacts[:-1] > 0.5)
    assert standing.sum() > 100
    assert (played - before)[standing].max() < 0.0008, "metres a frame"
    assert np.median(played[standing]) < 1e-4


def onto_the_last(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The turn about the vertical and the way over the ground that bring the first frame's joints onto the last's."""
    first, last = positions[0], positions[-1]
    a, b = ((points - points.mean(axis=0))[:, [0, 2]] for points in (first, last))
    turn = rotations.from_yaw(np.arctan2((a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1]).sum(), (a * b).sum()))
    way = last.mean(axis=0) - rotations.rotate(turn, first.mean(axis=0))
    return turn, way * (1.0, 0.0, 1.0)


@pytest.mark.parametrize("fps", [60.0, 30.0])
@pytest.mark.parametrize("ground_root", [False, True])
def test_the_file_closes_by_what_is_read_from_it_alone(tmp_path: Path, fps: float, ground_root: bool) -> None:
    options = ExportOptions(loop=True, fps=fps, ground_root=ground_root)
    save_motion(uneven_walk(), tmp_path / "loop.bvh", options, FLAT)
    positions, world = load_clip_bvh(tmp_path / "loop.bvh").world()
    positions = positions.astype(float)
    turn, way = onto_the_last(positions)
    second = rotations.rotate(turn, positions) + way
    assert np.linalg.norm(second[0] - positions[-1], axis=-1).max() < 0.01
    angles = rotations.angle_between(rotations.multiply(turn, world[0]), world[-1])
    assert np.rad2deg(angles.max()) < 2.0
    played, n = np.concatenate([positions, second[1:]]), len(positions) - 1
    slow = feet_way(played)[n - 4 : n + 4] * fps / 60.0
    assert np.sort(slow, axis=1)[:, 0].max() < 0.002, "the foot that stands does not slide over the seam"


def test_what_does_not_walk_is_refused() -> None:
    hips, local, contacts = walk(300)
    still = Clip("still", 60.0, np.repeat(hips[:1], 300, 0), np.repeat(local[:1], 300, 0), contacts)
    with pytest.raises(UsageError, match="does not walk") as refused:
        prepare(still, LOOP, FLAT)
    assert "--" not in str(refused.value), "a window says it, too"
    with pytest.raises(UsageError, match=r"the range lasts 0\.3 s"):
        prepare(Clip("short", 60.0, *walk(20)), LOOP, FLAT)
    rng = np.random.default_rng(0)
    axis = rotations.normalize(rng.normal(size=(300, 31, 3)))
    wild = rotations.from_axis_angle(axis, rng.uniform(-1.5, 1.5, (300, 31))).astype(np.float32)
    with pytest.raises(UsageError, match="no steady walk"):
        prepare(Clip("wild", 60.0, hips, wild, contacts), LOOP, FLAT)


def test_a_loop_in_place_is_one_pose_at_both_ends(tmp_path: Path) -> None:
    options = ExportOptions(loop=True, in_place=True, at_origin=True)
    (written,) = save_motion(uneven_walk(), tmp_path / "loop.bvh", options, FLAT)
    assert "the seam is 0.0" in written
    positions = load_clip_bvh(tmp_path / "loop.bvh").world()[0]
    assert np.abs(positions[0] - positions[-1]).max() < 0.02, "but for the heading"
