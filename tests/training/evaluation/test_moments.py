"""`python -m training.evaluation moments`: what it finds in motion whose answers are known, and its table."""

from pathlib import Path

import numpy as np
import pytest

from runtime.formats.bvh_clip import save_bvh
from runtime.generate import clip_of
from runtime.motion.control_scripts import parse_stick
from runtime.pose import Pose
from runtime.rotations import identity
from runtime.skeleton import SPORT_SKELETON
from training.evaluation import on_moments as m
from training.evaluation.metrics import moments
from training.evaluation.metrics.moments import FPS, Points

JOINTS = {  # of a body at rest that faces +Z, legs of 0.82 m
    "hips": (0, 0.9, 0), "neck": (0, 1.45, 0), "head": (0, 1.55, 0),
    "lh": (0.1, 0.88, 0), "lk": (0.1, 0.47, 0), "la": (0.1, 0.06, 0), "lt": (0.1, 0.02, 0.12),
    "rh": (-0.1, 0.88, 0), "rk": (-0.1, 0.47, 0), "ra": (-0.1, 0.06, 0), "rt": (-0.1, 0.02, 0.12),
    "ls": (0.2, 1.4, 0), "le": (0.2, 1.1, 0), "lw": (0.2, 0.85, 0),
    "rs": (-0.2, 1.4, 0), "re": (-0.2, 1.1, 0), "rw": (-0.2, 0.85, 0),
}  # fmt: skip


def puppet(z: np.ndarray, yaw: np.ndarray | float = 0.0) -> Points:
    """A stiff body that is pushed along Z (metres a frame) and turned."""
    yaw = np.broadcast_to(yaw, len(z))
    result = {}
    for key, (x, y, ahead) in JOINTS.items():
        c, s = np.cos(yaw), np.sin(yaw)
        result[key] = np.stack([c * x + s * ahead, np.full(len(z), y), c * ahead - s * x + z], -1)
    return result


def pushed(speeds: np.ndarray) -> Points:
    return puppet(np.concatenate([[0.0], np.cumsum(speeds[:-1]) / FPS]))


def ramp(*stretches: tuple[float, float]) -> np.ndarray:
    """Speeds that go linearly to a value within seconds, one stretch after the other."""
    speeds = [0.0]
    for value, seconds in stretches:
        speeds += np.linspace(speeds[-1], value, round(seconds * FPS) + 1)[1:].tolist()
    return np.array(speeds[1:])


def figures(points: Points, script: str, kind: str) -> dict[str, float]:
    return next(one["figures"] for one in moments.moments(points, parse_stick(script)) if one["kind"] == kind)


def test_a_start_and_a_stop_take_the_time_that_they_take() -> None:
    speeds = ramp((0.0, 2.0), (1.4, 1.0), (1.2, 0.4), (1.2, 1.6), (0.0, 1.2), (0.0, 2.0))
    points = pushed(speeds)
    script = "stand 2; walk 3; stand 3.2"
    start, stop = figures(points, script, "start"), figures(points, script, "stop")
    assert start["reached_s"] == pytest.approx(0.9 * 1.2 / 1.4, abs=0.05)
    assert start["peak_ratio"] == pytest.approx(1.4 / 1.2, abs=0.06)
    assert stop["stop_s"] == pytest.approx(1.2 * (1 - moments.STANDING_SPEED_M_PER_S / 1.2), abs=0.05)
    assert stop["calm_after_s"] == 0.0  # no limb moves against the hips


def test_an_arm_that_swings_on_is_not_calm_and_faster_than_before() -> None:
    points = pushed(ramp((1.2, 0.1), (1.2, 2.9), (0.0, 1.0), (0.0, 2.0)))
    t = np.arange(len(points["hips"])) / FPS
    swing = np.where(t < 3.0, 0.1, np.where(t < 5.0, 0.2, 0.0)) * np.sin(2 * np.pi * t)
    points["lw"][:, 2] += swing  # 0.63 m/s walking, 1.26 m/s until a second after the stop
    stop = figures(points, "walk 3; stand 3", "stop")
    assert stop["stop_s"] + stop["calm_after_s"] == pytest.approx(2.0, abs=0.05)
    assert stop["wrists_ratio"] == pytest.approx(2.0, rel=0.05)


def test_turns_are_found_by_the_hips() -> None:
    yaw = np.radians(np.interp(np.arange(300) / FPS, [2.0, 2.5], [0.0, 90.0]))
    points = puppet(np.zeros(300), yaw)
    assert figures(points, "stand 2; walk*0>90 3", "spin")["turn"] == pytest.approx(180.0, rel=0.03)
    assert figures(points, "walk 2; walk@90 3", "turn")["turn"] == pytest.approx(180.0, rel=0.03)
    assert moments.raw_turns(points)["turn"] == pytest.approx(180.0, rel=0.03)


def test_a_knee_that_bends_in_one_frame_pops_once() -> None:
    points = puppet(np.zeros(600))
    for frame, shift in ((200, 0.1), (400, 0.01)):  # 14 degrees, and 1.4
        points["lk"][frame:, 2] += shift
    knees, elbows = moments.joint_pops(points)
    assert len(knees) == 1
    assert abs(knees[0] - 200) <= 1
    assert len(elbows) == 0
    whole = moments.whole_clip(points, parse_stick("stand 10"))
    assert whole["knee_pops"] == pytest.approx(6.0)


def test_pops_of_jumps_are_counted_apart() -> None:
    points = puppet(np.zeros(600))
    points["lk"][400:, 2] += 0.1
    assert moments.raw_jumps(points) == {"knee_pops_in_jumps": pytest.approx(6.0), "elbow_pops_in_jumps": 0.0}
    whole = moments.whole_clip(points, parse_stick("stand 5; jump 5"))
    assert whole["knee_pops"] == 0.0
    assert whole["knee_pops_in_jumps"] == pytest.approx(12.0)


def test_toes_that_slide_near_the_ground_are_found_and_lifted_ones_are_not() -> None:
    points = puppet(np.zeros(360))
    step = np.interp(np.arange(360), [130, 160], [0.0, 0.3])
    points["lt"][:, 2] += step
    script = "stand 2; walk 4"
    assert figures(points, script, "start")["toe_path_cm"] == pytest.approx(0.9 * 30.0, abs=3.0)
    points["lt"][130:161, 1] += 0.05
    assert figures(points, script, "start")["toe_path_cm"] < 2.0
    points["rt"][200:203, 1] -= 0.03  # of 360 frames
    assert moments.whole_clip(points, parse_stick(script))["toe_under_cm"] == pytest.approx(-3.0, abs=0.5)


def test_jumping() -> None:
    points = puppet(np.zeros(480))
    t = np.arange(480) / FPS
    hop = np.clip(0.3 * np.sin(np.pi * (t - 4.25) / 0.5), 0, None) * (t < 4.75) * (t > 4.25)
    for joint in points.values():
        joint[:, 1] += hop
    jump = figures(points, "stand 4; jump 4", "jump")
    assert jump["take_off_s"] == pytest.approx(0.28, abs=0.04)
    assert jump["rise_cm"] == pytest.approx(30.0, abs=1.0)


def test_raw_takes_are_measured_by_themselves() -> None:
    start = moments.raw_start(pushed(ramp((0.0, 1.0), (1.2, 1.0), (1.2, 2.0))))
    assert start["reached_s"] == pytest.approx(0.9 - moments.STANDING_SPEED_M_PER_S / 1.2, abs=0.06)
    stop = moments.raw_stop(pushed(ramp((1.2, 0.1), (1.2, 2.0), (0.0, 1.0), (0.0, 1.0))))
    assert stop["stop_s"] == pytest.approx(0.9 - moments.STANDING_SPEED_M_PER_S / 1.2, abs=0.06)


def test_an_exported_file_is_measured_and_shown(tmp_path: Path) -> None:
    local = identity((len(SPORT_SKELETON),)).astype(np.float32)
    positions = SPORT_SKELETON.forward_kinematics(np.array([[0.0, 1.0, 0.0]]), local[None].astype(float))[0]
    about = (local, np.ones(4), np.zeros(3), 0.0)
    poses = [Pose(np.array([0.0, 1.0, 0.0], np.float32), local, positions[0], *about) for _ in range(240)]
    path = tmp_path / "still.bvh"
    save_bvh(clip_of(poses, "still", (), "flat"), path)
    table = m.moment_table({"prompts": {"still": [m.measure(path, "stand 4")]}, "raw": {}})
    assert "| knee pops a minute | – | at most 1 | 0.0 |" in table
    assert "| start of a walk, 90 % after, s | – | 0.6 to 1.5 | – |" in table


def test_what_is_out_of_the_range_is_bold() -> None:
    row = m.Row("stop_s", "", ("stop",), "walk", 0.7, 1.6)
    assert row.shown([0.8, 1.2]) == "0.80 to 1.20"
    assert row.shown([0.5, 1.2]) == "**0.50 to 1.20**"
