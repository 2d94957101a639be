"""Motion matching: features, spring and search by their equations, and a character that walks by a database of clips."""

import dataclasses
import json
import tomllib
from importlib.metadata import EntryPoint, EntryPoints

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime import rotations
from runtime.assets import PROJECT_ROOT, model_folder
from runtime.controls import Controls, Gait
from runtime.errors import ModelError
from runtime.motion import features
from runtime.motion.controller import Controller
from runtime.motion.frame import MAX_OUTPUT
from runtime.motion.model import MotionModel, load_model
from runtime.skeleton import SPORT_SKELETON, J
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import make_terrain
from tests.helpers.synthetic_clips import save_motion
from tests.helpers.walker import walk
from training.baselines import matching
from training.baselines.matching import STEP, Database, MatchingModel, Playing, feature_vectors
from training.baselines.motion_matching import build, clip_rows, export, standing
from training.frames import clip_frames

FRAMES = 360


def save_clip(folder, name, style, speed_share=1.0, turn=0.0, still=False):
    hips, local, contacts = walk(FRAMES, speed_share=speed_share)
    if still:
        hips, local = np.repeat(hips[:1], FRAMES, 0), np.repeat(local[:1], FRAMES, 0)
        contacts = np.ones_like(contacts)
    if turn:  # along an arc, a little further in every frame
        yaw = turn * np.arange(FRAMES) / 60.0
        steps = features.to_world(np.diff(hips[:, [0, 2]], axis=0, prepend=hips[:1, [0, 2]]), yaw)
        hips[:, [0, 2]] = np.cumsum(steps, axis=0)
        local[:, 0] = rotations.multiply(rotations.from_yaw(yaw), local[:, 0].astype(np.float64))
    save_motion(folder, name, (hips, local, contacts), Gait.STAND if still else Gait.WALK, style=style)


@pytest.fixture(scope="module")
def base(tmp_path_factory) -> Database:
    folder = tmp_path_factory.mktemp("clips")
    for number, turn in enumerate((0.0, 0.6, -0.6)):
        save_clip(folder, f"a_{number}", "neutral", turn=turn)
    save_clip(folder, "b", "neutral", still=True)
    save_clip(folder, "c", "old", 0.5)
    codes = {"neutral": [np.zeros((6, 64))], "old": [np.ones((6, 64)), 2.0 * np.ones((6, 64))]}
    return build([clip_rows(clip_frames(p)) for p in sorted(folder.glob("*.npz"))], codes)


@pytest.fixture
def model(base, tmp_path) -> MatchingModel:
    config = {"config": {"output_size": features.OUTPUT_SIZE}, "name": "matching"}
    start = {"output": [0.0] * features.OUTPUT_SIZE, "phase": [0.0] * 130}
    made = MatchingModel(tmp_path, config | {"start": start}, base)
    start["output"] = standing(made)
    return made


def test_features_are_those_of_the_paper():
    """Holden 2020, Sec. 3: future positions and directions, feet with their velocities, the hips' velocity."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=features.INPUT_SIZE)
    joints, velocities = rng.normal(size=(2, J, 3))
    found = feature_vectors(x, joints, velocities)
    path = x[features.INPUT["trajectory_positions"]].reshape(12, 2)
    np.testing.assert_allclose(found[:4], path[[8, 10]].ravel(), rtol=1e-5)  # 20 and 40 frames on
    np.testing.assert_allclose(found[4:6], 2 * path[11] - path[10], rtol=1e-5)  # 60 frames on
    assert np.linalg.norm(found[10:12]) == pytest.approx(1.0, rel=1e-5)
    left, right = SPORT_SKELETON.index("LeftFoot"), SPORT_SKELETON.index("RightFoot")
    np.testing.assert_allclose(found[12:18], joints[[left, right]].ravel(), rtol=1e-5)
    np.testing.assert_allclose(found[18:24], velocities[[left, right]].ravel(), rtol=1e-5)
    np.testing.assert_allclose(found[24:27], velocities[0], rtol=1e-5)
    np.testing.assert_allclose(found[27:], x[features.INPUT["gait"]].reshape(12, 6)[6], rtol=1e-5)


def test_columns_of_a_group_share_their_scale(base):
    mean, scale = matching.scales(base.features)
    np.testing.assert_allclose(mean, base.features.mean(0), atol=1e-4)
    for columns, weight in matching.GROUPS.values():
        expected = weight / base.features[:, columns].std(0).mean()
        np.testing.assert_allclose(scale[columns], expected, rtol=1e-3)


def test_the_search_finds_what_trying_all_rows_finds(model, base):
    rng = np.random.default_rng(1)
    mean, scale = matching.scales(base.features)
    for label in range(len(base.styles)):
        rows = np.flatnonzero((base.style == label) & (base.last - np.arange(len(base.last)) >= 2))
        for _ in range(20):
            query = ((base.features[rng.integers(len(base.features))] - mean) * scale) + rng.normal(size=33)
            away = np.square((base.features[rows] - mean) * scale - query).sum(1)
            assert model._nearest(query.astype(np.float32), label) in rows[away <= away.min() * (1 + 1e-5)]


LAST_PLACE = STEP * matching.MAX_ROWS - 1


@given(
    st.integers(0, LAST_PLACE),
    st.integers(0, 5),
    st.lists(st.tuples(*[st.integers(0, LAST_PLACE)] * 2, st.integers(0, 60)), max_size=matching.CHANGES),
)
def test_what_is_played_travels_in_the_phases(place, since, changes):
    """Also where the controller turns the vectors on, as it does for feet that stall."""
    playing = Playing(place, since, tuple(changes))
    samples = playing.packed()
    assert np.abs(samples).max() < MAX_OUTPUT  # or the frame takes it for a fault
    angle = 0.7
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    window = np.concatenate([np.ones((6, features.C, 2)), samples @ turn]).astype(np.float32)
    assert Playing.unpacked(window) == playing
    assert Playing.unpacked(np.zeros((13, features.C, 2))).place == -1


def run(model, controls, seconds=3.0, terrain=None, style=None, seen=None):
    controller = Controller(model, terrain or Terrain.flat(size_m=100.0))
    if style is not None:
        controller.set_style(style, 0.0)
    poses = []
    for k in range(round(60 * seconds)):
        poses.append(controller.step(controls(k / 60)))
        if seen is not None:
            seen.append(controller.unlocked)
    return poses


def test_a_character_walks_where_the_stick_points(model):
    poses = run(model, lambda t: Controls((0.0, 1.0)))
    speed = np.linalg.norm(poses[-1].root_position - poses[60].root_position) / 2.0 - 0.0
    assert poses[-1].root_position[2] > 1.5
    assert abs(poses[-1].root_position[0]) < 0.4
    assert speed == pytest.approx(1.125, rel=0.2)  # that of the walker's neutral clips
    feet = np.stack([p.positions[[4, 9]] for p in poses[60:]])
    assert np.ptp(feet[:, 0, 2] - feet[:, 1, 2]) > 0.5  # its legs step
    turned = run(model, lambda t: Controls((1.0, 0.0) if t > 0.5 else (0.0, 1.0)), 3.5)
    assert turned[-1].root_position[0] > 1.0


def test_poses_do_not_jump_at_a_change_of_frame(model):
    """Every search may choose another clip; joints turn hardly faster than those of the clips themselves."""
    seen = []
    run(model, lambda t: Controls((np.sin(2 * t), np.cos(2 * t))), 3.0, seen=seen)
    hips, turns = (np.stack(values) for values in zip(*seen, strict=True))
    moved = np.linalg.norm(np.diff(hips, axis=0), axis=1)
    spun = rotations.angle_between(turns[1:, 1:], turns[:-1, 1:])
    clip = walk(FRAMES)[1].astype(np.float64)
    fastest = rotations.angle_between(clip[1:, 1:], clip[:-1, 1:]).max()
    assert moved.max() < 0.05
    assert spun.max() < 1.5 * fastest


def test_styles_are_labels(model, base):
    assert base.styles == ("neutral", "old")
    near = model.fold_style(np.full((6, 64), 1.6, np.float32))
    assert near.front_bias.tolist() == [0.0, 1.0]
    assert near.walk_speed < 0.7 * model.fold_style(np.zeros((6, 64), np.float32)).walk_speed
    seen = []
    output = model._output
    model._output = lambda *given: (seen.append(given[3].place), output(*given))[1]
    run(model, lambda t: Controls((0.0, 1.0)), 1.0, style=np.ones((6, 64), np.float32))
    assert {base.styles[base.style[place // STEP]] for place in seen} == {"old"}
    with pytest.raises(ModelError, match="shape"):
        model.fold_style(np.zeros((2, 64), np.float32))


def test_a_database_answers_all_that_a_model_is_asked_for(model):
    """What a weakened walk asks for is not asked on level ground in most styles."""
    asked = {name for name in dir(MotionModel) if not name.startswith("_")} - {"swings"}  # fitted to networks
    assert all(hasattr(model, name) for name in asked)
    assert [model.neutral_style(mirrored).mirrored for mirrored in (False, True)] == [False, True]


def test_feet_stay_on_hills_and_equal_runs_are_equal(model):
    runs = [run(model, lambda t: Controls((0.0, 1.0)), 2.0, make_terrain("hills", 0)) for _ in range(2)]
    assert all(np.array_equal(a.positions, b.positions) for a, b in zip(*runs, strict=True))
    ground = make_terrain("hills", 0)
    toes = np.stack([p.positions[[5, 10]] for p in runs[0]])
    assert (toes[..., 1] - ground.height(toes[..., 0], toes[..., 2])).min() > -0.03


def test_a_database_is_kept_and_a_damaged_one_is_named(base, tmp_path):
    base.save(tmp_path / matching.DATABASE)
    again = Database.load(tmp_path / matching.DATABASE)
    assert again.styles == base.styles
    assert np.array_equal(again.last, base.last)
    assert np.array_equal(again.contacts, base.contacts)
    np.testing.assert_allclose(again.features, base.features, atol=2e-3, rtol=1e-3)
    dataclasses.replace(base, last=base.last + 10_000).save(tmp_path / "wrong.npz")
    (tmp_path / "cut.npz").write_bytes((tmp_path / matching.DATABASE).read_bytes()[:500])
    for name in ("wrong.npz", "cut.npz", "none.npz"):
        with pytest.raises(ModelError, match=name):
            Database.load(tmp_path / name)


def test_a_folder_of_another_kind_is_opened_by_its_entry_point(base, tmp_path, monkeypatch):
    folder = export(base, model_folder(), tmp_path / "database")
    project = tomllib.loads((PROJECT_ROOT / "pyproject.toml").read_text())
    groups = project["project"]["entry-points"].items()
    points = [EntryPoint(name, value, group) for group, named in groups for name, value in named.items()]
    monkeypatch.setattr("runtime.motion.model.entry_points", EntryPoints(points).select)
    assert isinstance(load_model(folder), MatchingModel)
    metadata = json.loads((folder / "metadata.json").read_text())
    (folder / "metadata.json").write_text(json.dumps(metadata | {"kind": "clockwork"}))
    with pytest.raises(ModelError, match="clockwork"):
        load_model(folder)
