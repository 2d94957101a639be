"""Rollouts with a swapped part: what is mixed, what is left to supervise."""

import pytest

torch = pytest.importorskip("torch")

from runtime.motion.features import OUTPUT, OUTPUT_SIZE  # noqa: E402
from runtime.skeleton import PART_JOINTS, PART_NAMES, J  # noqa: E402
from training import losses  # noqa: E402
from training.part_swaps import NOTHING, SHARE, Swaps  # noqa: E402

ALWAYS = ("trajectory_positions", "trajectory_directions", "root", "contacts", "phase")


def _swaps(*parts: str) -> Swaps:
    index = [PART_NAMES.index(p) if p else NOTHING for p in parts]
    return Swaps(torch.tensor(index), torch.arange(len(parts)))


def test_only_the_swapped_part_is_told_of_the_other_clip():
    z, other = torch.zeros(3, 384), torch.ones(3, 384)
    mixed = _swaps("right_arm", "", "head").mixed(z, other).view(3, len(PART_NAMES), -1)
    assert mixed[0].mean(1).tolist() == [0, 1, 0, 0, 0, 0]
    assert mixed[1].sum() == 0
    assert mixed[2].mean(1).tolist() == [0, 0, 0, 0, 0, 1]


@pytest.mark.parametrize("part", PART_NAMES)
def test_a_swapped_part_is_not_supervised_and_what_it_does_not_carry_is(part):
    kept = _swaps(part).supervised()[0]
    assert all(kept[OUTPUT[name]].all() for name in ALWAYS)
    rotations = kept[OUTPUT["joint_rotations"]].view(J, 6)
    assert rotations[list(PART_JOINTS[part])].sum() == 0
    limbs = [p for p in ("left_arm", "right_arm", "left_leg", "right_leg") if p.split("_")[1] not in part]
    assert part == "torso" or all(rotations[list(PART_JOINTS[p])].all() for p in limbs)
    for field in ("joint_positions", "joint_velocities"):
        assert kept[OUTPUT[field]].view(J, 3)[list(PART_JOINTS[part])].sum() == 0


def test_one_arm_leaves_the_other_and_a_lean_leaves_the_legs():
    arm, torso = _swaps("left_arm", "torso").supervised()
    for field, size in (("joint_positions", 3), ("joint_velocities", 3), ("joint_rotations", 6)):
        assert arm[OUTPUT[field]].view(J, size)[list(PART_JOINTS["right_arm"])].all()
        assert torso[OUTPUT[field]].view(J, size)[list(PART_JOINTS["left_leg"])].all()


def test_without_a_swap_everything_is_supervised():
    assert Swaps.none(2, torch.device("cpu")).supervised().all()


def test_what_is_not_supervised_has_no_gradient():
    predicted = torch.zeros(1, OUTPUT_SIZE, requires_grad=True)
    losses.motion(torch.ones(1, OUTPUT_SIZE), predicted, _swaps("left_arm").supervised()).backward()
    gradient = predicted.grad[0][OUTPUT["joint_rotations"]].view(J, 6)
    assert gradient[list(PART_JOINTS["left_arm"])].abs().sum() == 0
    assert (gradient[list(PART_JOINTS["right_arm"])] != 0).all()


def test_lanes_draw_a_swap_as_often_as_stated_and_of_every_part():
    torch.manual_seed(0)
    swaps = Swaps.none(5000, torch.device("cpu"))
    swaps.draw(torch.arange(4000), torch.arange(4000) + 7)
    drawn = swaps.part[:4000]
    assert set(drawn.tolist()) == set(range(NOTHING + 1))
    assert abs(float((drawn != NOTHING).float().mean()) - SHARE) < 0.05
    assert swaps.clip[:4000].tolist() == list(range(7, 4007))
    assert (swaps.part[4000:] == NOTHING).all()
