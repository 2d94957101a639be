"""The network in the mirror: mirror images of what it reads and writes, and what is walked that way."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.controls import Controls
from runtime.motion.controller import Controller
from runtime.motion.features import INPUT_SIZE, OUTPUT_SIZE, C, InputParts, build_input, split_output
from runtime.motion.mirror import Mirror, Ways, mirrored_code
from runtime.motion.model import MotionModel
from runtime.motion.snapshot import Snapshot, take_snapshot
from runtime.motion.style import StyleFolder, StyleMix
from runtime.prompts.content import PromptEncoder
from runtime.prompts.prompter import Prompter
from runtime.skeleton import MIRROR_JOINTS, PART_JOINTS, SPORT_SKELETON, J
from runtime.terrain.height_map import Terrain

PHASE = np.array([-1, 1, -1, -1, 1], np.float32)
ACROSS = np.array([-1.0, 1.0, 1.0])
LEFT_HAND, RIGHT_HAND = SPORT_SKELETON.index("LeftHand"), SPORT_SKELETON.index("RightHand")


MIRROR = Mirror(PHASE)


def drawn(model: MotionModel, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random inputs and noise of some frames, and a code."""
    random = np.random.default_rng(count)
    shapes = (count, INPUT_SIZE), (count, *model.noise_shape), (6, 64)
    x, noise, z = (random.standard_normal(shape).astype(np.float32) for shape in shapes)
    return x, noise, z


@given(seed=st.integers(0, 2**31))
def test_twice_mirrored_is_what_it_was(seed: int) -> None:
    random = np.random.default_rng(seed)
    x, y = (random.standard_normal((3, size)).astype(np.float32) for size in (INPUT_SIZE, OUTPUT_SIZE))
    z = random.standard_normal((6, 64)).astype(np.float32)
    both = MIRROR
    assert np.array_equal(both.of_input(both.of_input(x)), x)
    assert np.array_equal(both.of_output(both.of_output(y)), y)
    assert np.array_equal(mirrored_code(mirrored_code(z)), z)


@given(seed=st.integers(0, 2**31))
def test_the_mirrored_input_is_the_input_of_the_mirrored_world(seed: int) -> None:
    def parts(sign: float) -> InputParts:
        drawn = np.random.default_rng(seed)
        side = np.array([sign, 1.0])
        yaw, angles = drawn.uniform(-3, 3, 1), drawn.uniform(-3, 3, (1, 12))
        joints, velocities = drawn.standard_normal((2, 1, J, 3))
        heights, phase = drawn.standard_normal((1, 12, 3)), drawn.standard_normal((1, 13, C, 2))
        if sign < 0:
            joints, velocities = (a[:, MIRROR_JOINTS] * ACROSS for a in (joints, velocities))
            heights, phase = heights[..., ::-1], phase * PHASE[:, None]
        return InputParts(
            root_position=drawn.standard_normal((1, 2)) * side,
            root_yaw=sign * yaw,
            trajectory_positions=drawn.standard_normal((1, 12, 2)) * side,
            trajectory_directions=np.stack([np.sin(sign * angles), np.cos(angles)], -1),
            heights=heights,
            gait=drawn.random((1, 12, 6)),
            phase=phase,
            joint_positions=joints,
            joint_velocities=velocities,
        )

    found, wanted = MIRROR.of_input(build_input(parts(1.0))), build_input(parts(-1.0))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=2e-6)


def test_the_code_of_mirrored_words_is_the_mirrored_code(model: MotionModel, prompter: Prompter) -> None:
    text = "limping on the left leg, right hand on the hip, head tilted to the left"
    said = prompter.expand(text).descriptions
    encoder = PromptEncoder(prompter.text_encoder, model.prompt_path)  # words as they are
    code = encoder.encode(said)
    assert np.abs(encoder.encode(said.mirrored()) - mirrored_code(code)).max() < 0.3
    assert np.abs(code - mirrored_code(code)).max() > 3.0  # so that the bar can fail


def test_limbs_are_borrowed_whole() -> None:
    y, other = np.zeros((1, OUTPUT_SIZE), np.float32), np.ones((1, OUTPUT_SIZE), np.float32)
    made = split_output(MIRROR.with_limbs(y, other, np.array([[1.0, 0.0, 0.25, 0.0]], np.float32)))
    expected = np.zeros(J)
    expected[list(PART_JOINTS["left_arm"])] = 1.0
    expected[list(PART_JOINTS["left_leg"])] = 0.25
    for name in ("joint_positions", "joint_velocities", "joint_rotations"):
        values = getattr(made, name)[0]
        np.testing.assert_array_equal(values, np.broadcast_to(expected[:, None], values.shape))
    np.testing.assert_array_equal(made.contacts[0], [0.25, 0.25, 0.0, 0.0])
    assert not made.root.any()
    assert not made.phase.any()
    assert not made.trajectory_positions.any()


def test_a_mirrored_style_sees_the_mirror_image(model: MotionModel) -> None:
    x, noise, z = drawn(model, 2)
    folder = StyleFolder(model.fold_style, 1.0, model.calibration)
    plain, mirrored = folder.fold(mirrored_code(z), Ways(False, False)), folder.fold(z, Ways(True, False))
    assert mirrored.mirrored
    assert np.array_equal(mirrored.z, z)
    expected, _ = model.step(MIRROR.of_input(x), noise, plain)
    got, _ = model.step(x, noise, mirrored)
    np.testing.assert_allclose(got, MIRROR.of_output(expected), rtol=0, atol=1e-6)


def test_blends_are_the_same_ways_round_at_both_ends(model: MotionModel, prompter: Prompter) -> None:
    controller = Controller(model, Terrain.flat(), 0)
    neutral, one = prompter("a person walking normally"), prompter("left hand behind the back")
    two = prompter("both hands behind the back")
    for goal, ways in (
        (one, Ways(True, False)),
        (neutral, Ways(False, False)),
        (two, Ways(False, True)),
        (one, Ways(True, True)),  # from two hands to one
    ):
        controller.set_style(goal, 1.0)
        for _ in range(30):
            controller.step(Controls(move=(0.0, 1.0)))
            (blend,) = controller.state.styles
            assert {end.ways for end in (*blend.ends, controller.style)} == {ways}
    controller.set_style(one, 0.0)
    assert controller.style.ways == Ways(True, False)
    controller.set_style(StyleMix((0.2, 0.8), (one, neutral)), 0.0)
    assert not controller.style.mirrored  # a little of it only


def test_a_snapshot_within_a_blend_keeps_both_ways(model: MotionModel, prompter: Prompter) -> None:
    controller = Controller(model, Terrain.flat(), 0)
    for prompt in ("both hands behind the back", "an old man", "left hand behind the back"):
        controller.set_style(prompter(prompt), 1.0)
        for _ in range(20):
            controller.step(Controls(move=(0.0, 1.0)))
    kept = Snapshot.from_bytes(take_snapshot(controller).to_bytes())
    again = Controller(model, Terrain.flat(), 0)
    kept.restore(again)
    for _ in range(5):
        poses = [each.step(Controls(move=(0.0, 1.0))) for each in (controller, again)]
        assert np.array_equal(poses[0].local_rotations, poses[1].local_rotations)


@pytest.mark.parametrize("prompt", ["left hand", "both hands"])
def test_what_was_trained_on_one_side_is_shown_on_both(
    prompt: str, model: MotionModel, prompter: Prompter
) -> None:
    """A hand behind the back was trained on the right alone."""
    controller = Controller(model, Terrain.flat(), 0)
    controller.set_style(prompter(f"{prompt} behind the back"), 0.5)
    hands = [hand for side, hand in (("left", LEFT_HAND), ("right", RIGHT_HAND)) if side in prompt]
    places = []
    for _ in range(170):
        pose = controller.step(Controls(move=(0.0, 1.0)))
        places.append(pose.positions[hands or [LEFT_HAND, RIGHT_HAND]] - pose.hips_position)
    held = np.median(places[110:], axis=0)
    assert (held[:, 2] < -0.08).all()
    assert (np.abs(held[:, 0]) < 0.2).all()


def test_going_into_the_mirror_and_out_of_it_is_smooth(model: MotionModel, prompter: Prompter) -> None:
    controller = Controller(model, Terrain.flat(), 0)
    neutral, held = prompter("a person walking normally"), prompter("left hand behind the back")
    positions = []
    for frame in range(320):
        if frame >= 200 and frame % 100 == 0:
            controller.set_style(held if frame % 200 else neutral, 0.8)
        pose = controller.step(Controls(move=(0.0, 1.0)))
        positions.append(SPORT_SKELETON.forward_kinematics(pose.hips_position, pose.local_rotations)[0])
    jumps = np.linalg.norm(np.diff(positions, n=2, axis=0), axis=-1).max(1)[100:]
    at = np.arange(198 - 100, len(jumps), 100)
    near = np.max([jumps[at + k] for k in range(4)], axis=0)
    assert near.max() < 1.5 * np.percentile(jumps, 99)
