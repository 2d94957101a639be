"""A character that walks at obstacles crosses them: leaps, climbs, stops where nothing helps, and goes on."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from runtime.assets import model_folder
from runtime.controls import Controls, Gait
from runtime.errors import ModelError
from runtime.feet.skating import SOLE_HEIGHTS, SOLE_POINTS
from runtime.motion.controller import Controller, Crowd
from runtime.motion.model import MotionModel, load_model
from runtime.motion.snapshot import Snapshot, take_snapshot
from runtime.terrain.courses import Obstacle, raise_obstacles
from runtime.terrain.height_map import Terrain
from training.evaluation.metrics import traversal

FORWARD = Controls((0.0, 1.0))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> MotionModel:
    """The shipped networks, of which it is not known what they cross by themselves: every obstacle is keyed."""
    folder = shutil.copytree(model_folder(), tmp_path_factory.mktemp("model") / "compact")
    metadata = json.loads((folder / "metadata.json").read_text("utf-8"))
    (folder / "metadata.json").write_text(json.dumps(metadata | {"crosses": {}}))
    return load_model(folder)


def ground(*obstacles: Obstacle) -> Terrain:
    x, z = np.meshgrid(np.arange(-4.0, 4.01, 0.05), np.arange(-2.0, 14.01, 0.05), indexing="ij")
    return Terrain("test", raise_obstacles(x, z, obstacles).astype(np.float32), 0.05, (-4.0, -2.0))


def walked(
    controller: Controller, until_z: float, seconds: float, controls: Controls = FORWARD
) -> tuple[np.ndarray, list[str]]:
    """Positions `(T, 31, 3)` until the root has come so far, and the kinds of crossings on the way."""
    positions, kinds = [], []
    for _ in range(round(seconds * 60)):
        pose = controller.step(controls)
        positions.append(pose.positions)
        if controller.traversal and (not kinds or kinds[-1] != controller.traversal):
            kinds.append(controller.traversal)
        if pose.root_position[2] > until_z:
            break
    return np.array(positions), kinds


@pytest.mark.parametrize(("top", "gait"), [(0.3, Gait.WALK), (0.5, Gait.JOG)])
def test_a_bar_is_leapt_over_without_touching_it(model: MotionModel, top: float, gait: Gait) -> None:
    controller = Controller(model, ground(Obstacle(2.2, 2.3, top, 4.0)))
    positions, kinds = walked(controller, 3.7, 8.0, Controls((0.0, 1.0), gait=gait))
    assert kinds == ["bar"]
    assert positions[-1, 0, 2] > 3.5
    soles = positions[:, SOLE_POINTS] - np.array(SOLE_HEIGHTS)[:, None] * np.array([0.0, 1.0, 0.0])
    over = (soles[..., 2] > 2.15) & (soles[..., 2] < 2.35)
    assert over.any()
    assert soles[..., 1][over].min() > top
    # nothing jumps where it begins and ends
    assert np.linalg.norm(np.diff(positions, axis=0), axis=-1).max() < 0.35


def test_a_wall_is_climbed_and_left_again(model: MotionModel) -> None:
    wall = Obstacle(1.8, 3.0, 1.0, 4.0)
    controller = Controller(model, ground(wall))
    positions, kinds = walked(controller, 3.9, 14.0)
    assert kinds == ["climb", "descend"]
    assert positions[:, 0, 1].max() == pytest.approx(1.93, abs=0.15)
    assert positions[-1, 0, 1] == pytest.approx(0.93, abs=0.1)
    depths = traversal.depths(positions, controller.terrain, np.ones(len(positions), bool))
    assert depths["sole_p99"] < 0.5
    assert depths["joint_deep"] <= 0.01
    assert traversal.hands_on_edge(positions, [wall])[0] > 0.5
    assert np.linalg.norm(np.diff(positions, axis=0), axis=-1).max() < 0.25


@pytest.mark.parametrize(
    ("obstacle", "words"),
    [(Obstacle(1.7, 1.8, 1.0, 4.0), "bar of 1.0 m"), (Obstacle(1.7, 4.2, 2.0, 4.0), "step up of 2.0 m")],
)
def test_what_nobody_crosses_stops_the_walker_who_says_so(
    model: MotionModel, obstacle: Obstacle, words: str
) -> None:
    controller = Controller(model, ground(obstacle))
    positions, kinds = walked(controller, 3.2, 2.7)
    assert kinds == []
    assert positions[-1, 0, 2] < 1.7
    assert controller.blocked is not None
    assert words in controller.blocked


def test_a_snapshot_in_a_leap_goes_on_alike(model: MotionModel) -> None:
    terrain = ground(Obstacle(1.5, 1.6, 0.4, 4.0))
    controller = Controller(model, terrain)
    for _ in range(600):
        controller.step(FORWARD)
        if controller.traversal:
            break
    assert controller.traversal == "bar"
    for _ in range(12):
        controller.step(FORWARD)
    data = take_snapshot(controller).to_bytes()
    other = Controller(model, terrain, seed=4)
    Snapshot.from_bytes(data).restore(other)
    assert other.traversal == "bar"
    other.set_terrain(Terrain.flat())
    assert other.traversal == ""  # another ground ends it
    other.set_terrain(terrain)
    Snapshot.from_bytes(data).restore(other)
    for _ in range(75):
        assert np.array_equal(controller.step(FORWARD).positions, other.step(FORWARD).positions)
    assert controller.traversal == ""


def test_a_crowd_crosses_as_each_would_alone(model: MotionModel) -> None:
    terrain = ground(Obstacle(1.5, 1.6, 0.3, 4.0), Obstacle(3.1, 4.3, 0.8, 4.0))

    def members() -> list[Controller]:
        made = [Controller(model, terrain, seed) for seed in range(2)]
        for k, member in enumerate(made):
            member.reset(0.8 * k, 1.7 * k)  # one comes to the bar first, the other to the wall
        return made

    alone, crowd = members(), Crowd(members())
    seen = set()
    for _ in range(200):
        together = crowd.step(FORWARD)
        for one, pose in zip(alone, together, strict=True):
            assert np.array_equal(one.step(FORWARD).positions, pose.positions)
            seen.add(one.traversal)
        if {"bar", "climb"} <= seen:
            break
    crowd.close()
    assert {"bar", "climb"} <= seen


def test_what_the_network_crosses_itself_is_not_keyed(model: MotionModel, tmp_path: Path) -> None:
    """A model says up to which size it crosses obstacles of a kind; what is higher is keyed."""
    folder = shutil.copytree(model.folder, tmp_path / "model")
    metadata = json.loads((folder / "metadata.json").read_text("utf-8"))
    for size, expected in ((0.25, []), (0.15, ["bar"])):
        (folder / "metadata.json").write_text(json.dumps(metadata | {"crosses": {"bar": size}}))
        controller = Controller(load_model(folder), ground(Obstacle(1.1, 1.2, 0.2, 4.0)))
        positions, kinds = walked(controller, 2.3, 8.0)
        assert kinds == expected
        assert positions[-1, 0, 2] > 2.1
    (folder / "metadata.json").write_text(json.dumps(metadata | {"crosses": {"bar": 0.5}}))
    controller = Controller(load_model(folder), ground(Obstacle(1.1, 1.2, 0.45, 4.0)))
    _, kinds = walked(controller, 2.3, 8.0)
    assert kinds == []  # on its top, the way down is not a drop to be keyed
    (folder / "metadata.json").write_text(json.dumps(metadata | {"crosses": {"moat": 0.3}}))
    with pytest.raises(ModelError, match="crosses"):
        load_model(folder)


@pytest.mark.parametrize(("tops", "gait"), [((0.6, 0.3), Gait.WALK), ((0.2, 0.5), Gait.JOG)])
def test_the_hips_do_not_jump_where_a_leap_begins_or_ends(
    model: MotionModel, tops: tuple[float, float], gait: Gait
) -> None:
    """Also where bars behind come out of what the network sees, and where a leap begins late."""
    bars = [Obstacle(z, z + 0.1, top, 4.0) for z, top in zip((2.0, 4.6), tops, strict=True)]
    controller = Controller(model, ground(*bars))
    positions, kinds = walked(controller, 7.2, 12.0, Controls((0.0, 1.0), gait=gait))
    assert kinds == ["bar"]  # twice running
    hips = positions[:, 0, 1].astype(np.float64)
    assert np.abs(np.diff(hips)).max() < 0.045
    assert np.abs(np.diff(hips, 2)).max() * 3600.0 < 90.0  # m/s^2: 2.5 cm from one frame to the next
