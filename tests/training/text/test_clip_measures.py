"""What clips do as numbers, and the directions of codes that they are read off."""

import numpy as np
import pytest
import torch

from runtime.measures.table import measure, measures_of
from runtime.skeleton import PART_NAMES
from tests.helpers.walker import CYCLE_FRAMES, STRIDE_M, walk
from training.networks.content import PARTS, MeasuresReader, odd_codes
from training.text.clip_measures import MAX_DEVIATIONS, _standardised, signs_of

pytestmark = pytest.mark.needs_torch

LEFT, RIGHT, TORSO = (PART_NAMES.index(n) for n in ("left_leg", "right_leg", "torso"))


def reader() -> MeasuresReader:
    torch.manual_seed(0)
    return MeasuresReader([signs_of(name) for name in PART_NAMES], one_sided=True)


def test_values_are_of_unit_spread_and_what_has_a_side_keeps_its_sign():
    values = np.random.default_rng(0).normal(3.0, 5.0, (400, len(measures_of("torso"))))
    values[0] = 1e6  # a clip that spins
    found = _standardised(values, "torso")
    assert np.abs(found).max() <= MAX_DEVIATIONS
    roll = list(measures_of("torso")).index("roll")
    assert np.array_equal(np.sign(found[:, roll]), np.sign(values[:, roll]).astype(np.float32))
    assert np.median(np.delete(found, roll, axis=1), axis=0) == pytest.approx(0.0, abs=1e-5)


def test_no_weight_enlarges_what_a_code_hardly_says():
    read = reader()
    z = torch.randn(1, PARTS, 64)
    before = read(z)[TORSO]
    for part in read.parts:
        part.weight.data *= 1000.0
    assert torch.allclose(read(z)[TORSO], before, atol=1e-5)
    moved = z + 1.0 * torch.nn.functional.normalize(torch.randn(1, PARTS, 64), dim=-1)
    assert (read(moved)[TORSO] - before).abs().max() <= MeasuresReader.GAIN + 1e-5


def test_mirrored_codes_are_read_as_the_mirrored_motion():
    read = reader()
    z = torch.randn(2, PARTS, 64)
    mirrored = (z * (1.0 - 2.0 * odd_codes()))[:, [PART_NAMES.index(_other(n)) for n in PART_NAMES]]
    plain, other = read(z), read(mirrored)
    assert torch.allclose(plain[LEFT], other[RIGHT], atol=1e-6)
    signs = torch.tensor(signs_of("torso"))
    assert torch.allclose(plain[TORSO] * signs, other[TORSO], atol=1e-5)


@pytest.mark.parametrize("after", [12, 20])  # frames of the swing
def test_a_foot_that_brushes_the_ground_in_its_swing_makes_no_step(after):
    hips, local, contacts = walk(400)
    contacts = contacts.copy()
    for off in np.flatnonzero(np.diff(contacts[:, 0]) < 0):
        contacts[off + after : off + after + 4, :2] = 1.0
    leg = measure(hips, local, contacts).left_leg
    assert leg.step_length == pytest.approx(STRIDE_M / 2, rel=0.05)
    assert leg.cadence == pytest.approx(2 * 60 / CYCLE_FRAMES, rel=0.05)


def _other(part: str) -> str:
    if part.startswith("left_"):
        return part.replace("left_", "right_")
    return part.replace("right_", "left_")
