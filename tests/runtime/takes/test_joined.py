"""Takes one after the other: no jump at the seam, and feet that keep their places."""

import numpy as np
import pytest

from runtime.errors import UsageError
from runtime.feet.ik import LEG_FEET
from runtime.takes.clip import Clip
from runtime.takes.joined import joined, repeated, without
from runtime.takes.metadata import PromptEvent
from runtime.takes.root import Placement
from runtime.terrain.library import load_terrain
from tests.helpers.walker import walk


def walked(first: int, last: int, speed_share: float = 1.0) -> Clip:
    """Frames of a walk."""
    made = Clip("walk", 60.0, *walk(last + 1, speed_share=speed_share), prompts=(PromptEvent(0.0, "walk"),))
    return made.trim(first, last)


def steps(clip: Clip) -> np.ndarray:
    """How far the worst joint's step differs from the one before, centimetres."""
    positions = clip.world()[0].astype(np.float64)
    return 100.0 * np.linalg.norm(np.diff(positions, 2, axis=0), axis=-1).max(axis=1)


def sliding(clip: Clip) -> float:
    """The fastest ankle of a foot that stands, centimetres a second."""
    ankles = clip.world()[0][:, LEG_FEET].astype(np.float64)
    speed = np.linalg.norm(np.diff(ankles, axis=0)[..., [0, 2]], axis=-1) * 60.0
    stands = clip.contacts.reshape(-1, 2, 2).max(axis=-1) > 0.5
    return float(100.0 * speed[stands[1:] & stands[:-1]].max())


@pytest.mark.parametrize("phase", [0, 9, 20, 33, 50])
@pytest.mark.parametrize("speed_share", [1.0, 0.7])
def test_the_second_goes_on_where_the_first_ends(phase: int, speed_share: float) -> None:
    first = walked(10, 110)
    second = Placement(1.2, (3.0, 0.5, -2.0)).clip(walked(phase, phase + 130, speed_share))
    made = joined(first, second)
    assert len(made) == len(first) + len(second) - 1
    assert np.array_equal(made.local_rotations[: len(first)], first.local_rotations)
    assert made.local_rotations[-1, 1:] == pytest.approx(second.local_rotations[-1, 1:], abs=1e-3)
    hips = made.hips_positions
    assert hips[-1, 2] - hips[100, 2] > 0.7 * (hips[100, 2] - hips[0, 2])  # straight on
    assert abs(hips[-1, 0] - hips[0, 0]) < 0.2
    assert steps(made).max() < 2.5 * max(steps(first).max(), steps(second).max())
    assert sliding(made) < 1.2 * max(sliding(first), sliding(second))


def test_pieces_of_one_take_are_that_take_again() -> None:
    clip = walked(0, 120)
    made = joined(clip.trim(0, 50), clip.trim(50, 120))
    assert np.array_equal(made.hips_positions, clip.hips_positions)
    assert np.array_equal(made.local_rotations, clip.local_rotations)
    assert made.prompts == clip.prompts


def test_feet_are_over_the_ground_as_they_were_over_their_own() -> None:
    hills = load_terrain("hills")
    clip = Clip("walk", 60.0, *walk(161, terrain=hills))

    def over(made: Clip) -> np.ndarray:
        ankles = made.world()[0][:, LEG_FEET].astype(np.float64)
        return ankles[..., 1] - hills.height(ankles[..., 0], ankles[..., 2])

    made = repeated(clip, 2, hills)
    blended = 60  # frames in which a foot may still be on its way
    wrong = np.abs(over(made)[len(clip) - 1 :] - over(clip))[blended:]
    assert np.abs(over(repeated(clip, 2))[len(clip) - 1 :] - over(clip))[blended:].max() > 0.1
    assert wrong.max() < 0.03
    assert steps(made).max() < 2.5 * steps(clip).max()


def test_a_take_is_repeated_and_frames_are_cut_out() -> None:
    clip = walked(0, 128)
    again = repeated(clip, 3)
    assert len(again) == 3 * 128 + 1
    assert again.hips_positions[-1, 2] == pytest.approx(3 * clip.hips_positions[-1, 2], rel=0.05)
    assert len(without(clip, 40, 70)) == 129 - 30
    assert len(without(clip, 0, 70)) == 129 - 70
    with pytest.raises(UsageError, match="Nothing"):
        without(clip, 0, 128)
