"""Parts of other clips on a base: joints, velocities, words, contacts and root, and what is never drawn."""

import dataclasses
import itertools

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import rotations
from runtime.motion.features import FPS, OUTPUT
from runtime.skeleton import PART_JOINTS, PART_NAMES, SPORT_SKELETON, J
from tests.helpers.synthetic_clips import flat_patch, save_motion
from tests.helpers.walker import walk
from training.augmentation.catalogue import catalogue, part_edits
from training.batches import FrameTensors
from training.composition import PARTS, Composer, CompositionPlan, acts_on_base
from training.frames import FIRST_OF_UPPER, LAYERED, FrameTable, load_frames
from training.kinematics import shown_joints
from training.sampling import moments, sampling_weights, sprint_starts
from training.styles import StyleTexts

pytestmark = pytest.mark.needs_torch

# (name, style, content, held out, first frame of the walk, keys of parts that an edit changes)
CLIPS = (
    ("base", "neutral", "walk forward", False, 0, {}),
    ("proud", "proud", "walk forward", False, 23, {}),
    ("secret", "proud", "walk forward", True, 9, {}),
    ("left", "neutral", LAYERED, False, 11, {"left_arm": "left_arm.on_hip"}),
    ("right", "neutral", LAYERED, False, 30, {"right_arm": "right_arm.on_hip"}),
    ("bobbing", "neutral", LAYERED, False, 5, {"torso": "torso.bob"}),
)
FRAMES = 330


def _clip(number: int, start: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A walk with an upper body of its own that swings with the steps."""
    hips, local, contacts = (v[start:] for v in walk(FRAMES + start))
    random = np.random.default_rng(number)
    local = local.astype(float)
    swing = 0.2 * np.sin(2 * np.pi * (np.arange(FRAMES) + start) / 64)
    for joint in range(FIRST_OF_UPPER, J):
        fixed = rotations.from_axis_angle(rotations.normalize(random.normal(size=3)), 0.4 * random.random())
        moving = rotations.from_axis_angle(np.array([1.0, 0, 0]), swing * random.random())
        local[:, joint] = rotations.multiply(fixed[None], moving)
    return hips.astype(float), local, contacts


@pytest.fixture(scope="module")
def table(tmp_path_factory) -> FrameTable:
    folder = tmp_path_factory.mktemp("composition")
    for number, (name, style, content, held_out, start, _) in enumerate(CLIPS):
        hips, local, contacts = _clip(number, start)
        save_motion(
            folder, name, (hips, local, contacts.astype(np.uint8)), style=style, content=content, source="jlpm",
            split="held_out" if held_out else "train",
            patches=flat_patch(SPORT_SKELETON.forward_kinematics(hips, local)[0]),
        )  # fmt: skip
    return load_frames(folder, folder / "frames")


@pytest.fixture(scope="module")
def texts(table) -> StyleTexts:
    edits = {name: keys for name, *_, keys in CLIPS}
    named = zip(table.names, table.styles, strict=True)
    rows = [[edits[name].get(part, style) for part in PART_NAMES] for name, style in named]
    names = sorted({key for row in rows for key in row})
    keys = np.array([[names.index(key) for key in row] for row in rows])
    return StyleTexts([[]] * 6, [np.zeros((0, 4))] * 6, np.zeros((len(rows), 8, 6), int), keys, names)


@pytest.fixture(scope="module")
def frames(table, texts) -> FrameTensors:
    made = FrameTensors.of(table, np.zeros((len(table), 5, 2), np.float32), torch.device("cpu"))
    made.composer = Composer(table, texts, made.y, moments(table), torch.device("cpu"))
    return made


def clip_number(table: FrameTable, name: str) -> int:
    return table.names.index(name)


def drawn(frames: FrameTensors, seed: int, count: int = 400) -> tuple[torch.Tensor, CompositionPlan]:
    """Base frames of training clips and a plan for each."""
    torch.manual_seed(seed)
    table_rows = torch.nonzero(frames.composer.clip != 5)[:, 0]
    rows = table_rows[torch.randint(len(table_rows), (count,))]
    rows = torch.maximum(rows, frames.first[rows] + 2)
    return rows, frames.composer.draw(rows)


def test_joints_are_forward_kinematics_of_the_composed_rotations(frames):
    rows, plan = drawn(frames, 1)
    y = frames.outputs(rows, torch.zeros_like(rows), plan)
    assert plan.changed.any(1).float().mean() > 0.3
    stated = y[:, OUTPUT["joint_positions"]].view(-1, J, 3)
    assert (shown_joints(y) - stated).abs().max() < 4e-3  # half floats of the base's legs


def test_contacts_root_path_and_legs_are_the_base_s(frames):
    rows, plan = drawn(frames, 2)
    patch = torch.zeros_like(rows)
    base, composed = frames.outputs(rows, patch), frames.outputs(rows, patch, plan)
    for name in ("contacts", "root", "trajectory_positions", "trajectory_directions", "phase"):
        assert torch.equal(base[:, OUTPUT[name]], composed[:, OUTPUT[name]])
    for name, size in (("joint_positions", 3), ("joint_velocities", 3), ("joint_rotations", 6)):
        lower = slice(OUTPUT[name].start, OUTPUT[name].start + size * FIRST_OF_UPPER)
        assert torch.equal(base[:, lower], composed[:, lower])
    assert not torch.allclose(base, composed)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 1000))
def test_velocities_are_finite_differences_over_the_window(frames, seed):
    rows, plan = drawn(frames, seed, 40)
    rows = torch.minimum(rows, frames.last[rows] - 6)
    path = [frames.outputs(rows + k, torch.zeros_like(rows), plan) for k in range(5)]
    for before, after in itertools.pairwise(path):
        root = before[:, OUTPUT["root"]] / FPS
        joints = [y[:, OUTPUT["joint_positions"]].view(-1, J, 3) for y in (before, after)]
        ahead = torch.stack([root[:, 0], 0 * root[:, 0], root[:, 1]], -1)
        c, s = root[:, 2:].cos(), root[:, 2:].sin()
        x, y, z = (joints[0] - ahead[:, None]).unbind(-1)
        found = (joints[1] - torch.stack([c * x - s * z, y, s * x + c * z], -1)) * FPS
        stated = after[:, OUTPUT["joint_velocities"]].view(-1, J, 3)
        assert (found - stated)[:, FIRST_OF_UPPER:].abs().max() < 0.13  # 1 mm of a stored height is 0.06 m/s


def test_inputs_hold_the_composed_pose_of_the_frame_before(frames):
    rows, plan = drawn(frames, 4)
    rows = torch.maximum(rows, frames.first[rows] + 3)
    patch = torch.zeros_like(rows)
    x, y = frames.pairs(rows, patch, plan)
    before = frames.outputs(rows - 1, patch, plan)
    size = 6 * J
    own = torch.cat([before[:, OUTPUT["joint_positions"]], before[:, OUTPUT["joint_velocities"]]], 1)
    start = 12 * 2 * 2 + 36
    assert torch.allclose(x[:, start : start + size], own, atol=2e-3)
    assert torch.allclose(y, frames.outputs(rows, patch, plan), atol=1e-4)


@pytest.mark.parametrize("part", PARTS)
def test_a_part_is_its_clip_s_at_matching_phase_and_so_are_its_words(frames, table, part):
    """In step with the base, the part hangs on what it hangs on as in its own clip."""
    base, giver = clip_number(table, "base"), clip_number(table, "proud")
    rows = frames.composer.first[base] + torch.arange(80, 140)
    torch.manual_seed(0)
    column = PARTS.index(part)
    plan = CompositionPlan.nothing(len(rows), rows.device)
    plan.changed[:, column] = True
    plan.clips[:] = giver
    plan = frames.composer._matched(rows, plan, 0)
    assert plan.changed[:, column].all()
    assert set(plan.words(frames.clip[rows])[:, PART_NAMES.index(part)].tolist()) == {giver}
    others = [k for k in range(6) if PART_NAMES[k] != part]
    assert set(plan.words(frames.clip[rows])[:, others].flatten().tolist()) == {base}
    composed = frames.composer.rotations(rows, plan)
    # both walks have a cycle of 64 frames; the giver's begins 23 frames later
    same_step = frames.composer.first[giver] + torch.arange(80, 140) - 23
    alone = frames.composer.rotations(same_step, CompositionPlan.nothing(len(rows), rows.device))
    joints = [j - FIRST_OF_UPPER for j in PART_JOINTS[part] if j >= FIRST_OF_UPPER]
    chest = SPORT_SKELETON.index("Spine1") - FIRST_OF_UPPER
    turns = [(r[:, joints], r[:, chest, None].transpose(-1, -2)) for r in (composed, alone)]
    hung = [own if part == "torso" else back @ own for own, back in turns]
    assert (hung[0] - hung[1]).abs().max() < 0.02


def test_nothing_that_is_held_out_is_drawn(frames, table, texts):
    rows, plan = drawn(frames, 6, 4000)
    assert not (plan.clips[plan.changed] == clip_number(table, "secret")).any()
    words = plan.words(frames.clip[rows])
    name = np.array(texts.names)[texts.keys]
    shown = [[name[c, k] for k, c in enumerate(row)] for row in words.tolist()]
    for one, other in catalogue().held_out_pairs.values():
        assert not any(one in row and other in row for row in shown)
    assert any("left_arm.on_hip" in row for row in shown)
    assert any("right_arm.on_hip" in row for row in shown)


def test_a_torso_whose_edit_moves_the_hips_stays_with_them(frames, table):
    rows, plan = drawn(frames, 7, 4000)
    torso, bobbing = PARTS.index("torso"), clip_number(table, "bobbing")
    assert plan.changed[:, torso].any()
    assert not (plan.clips[plan.changed[:, torso], torso] == bobbing).any()
    assert not plan.changed[frames.clip[rows] == bobbing, torso].any()
    assert acts_on_base(part_edits()["torso.bob"])
    assert not acts_on_base(part_edits()["torso.lean_left"])


def test_clips_whose_steps_do_not_match_give_nothing(frames, table):
    composer = frames.composer
    giver = clip_number(table, "proud")
    quick = dataclasses.replace(composer.upper, cadence=composer.upper.cadence.clone())
    quick.cadence[giver] *= 2.0
    rows = composer.first[clip_number(table, "base")] + torch.arange(80, 120)
    plan = CompositionPlan.nothing(len(rows), rows.device)
    plan.changed[:], plan.clips[:] = True, giver
    kept, composer.upper = composer.upper, quick
    try:
        assert not composer._matched(rows, plan, 0).changed.any()
    finally:
        composer.upper = kept


def test_sprint_starts_weigh_nothing_and_moments_more(table):
    own = {"x": table.x.copy(), "y": table.y.copy(), "sources": ["accad"] * len(table.sources)}
    leaning = dataclasses.replace(table, **own)
    gait = leaning.x[:, 48 + 36 + 186 : 48 + 36 + 186 + 72].reshape(len(table), 12, 6)
    frames = slice(100, 160)
    gait[frames] = 0.0
    gait[frames, :6, 0] = 1.0
    gait[frames, 6:, 2] = 1.0
    ahead = np.arange(-6, 6)[:, None] * np.array([0.0, 3.0 / 6])
    leaning.x[frames, :24] = ahead.reshape(-1)
    neck = OUTPUT["joint_positions"].start + 3 * SPORT_SKELETON.index("Neck")
    leaning.y[frames, neck + 2] = 0.5
    found = sprint_starts(leaning)
    assert found[frames].all()
    assert found.sum() == 60
    assert sampling_weights(leaning)[frames].sum() == 0
    assert moments(leaning)[frames].all()
