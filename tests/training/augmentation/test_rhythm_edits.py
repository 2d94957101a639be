"""Edits of rhythm and weight: each changes its measure by its factor and not the others, and feet stay planted."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from runtime.measures.table import BodyMeasures, measure
from runtime.skeleton import SPORT_SKELETON
from tests.training.augmentation.test_augmentation import walker
from training.augmentation.catalogue import PartEdit, part_edits
from training.augmentation.edits import apply
from training.augmentation.gait import cycle_frames, cycle_mean
from training.augmentation.motion import EditedMotion
from training.data.labels import FOOT_JOINTS

RHYTHM = sorted(name for name, edit in part_edits().items() if edit.does.of_steps)


class Plain:
    """A generator without variation: an edit is exactly what its numbers say."""

    def normal(self, mean: float = 0.0, deviation: float = 1.0, size: int | None = None):
        return mean if size is None else np.full(size, mean)

    def uniform(self, low: float, high: float) -> float:
        return 0.5 * (low + high)

    def random(self, size: int | None = None):
        return 0.5 if size is None else np.full(size, 0.5)


def measured(motion: EditedMotion) -> BodyMeasures:
    """Without the ends, where averages over a cycle know half of it."""
    own = slice(40, -40)
    return measure(motion.hips[own], motion.local[own], motion.contacts[own])


@cache
def edited(name: str, frames: int = 600) -> tuple[EditedMotion, EditedMotion]:
    before = walker(frames)
    return before, apply(before, part_edits()[name], Plain())  # type: ignore[arg-type]


def feet(motion: EditedMotion) -> np.ndarray:
    positions, _ = SPORT_SKELETON.forward_kinematics(motion.hips, motion.local.astype(float))
    return positions[:, FOOT_JOINTS]


def slide(motion: EditedMotion) -> float:
    """Metres per second, 95th percentile, of heels and toes in contact."""
    down = motion.contacts[1:].astype(bool) & motion.contacts[:-1].astype(bool)
    speed = np.linalg.norm(np.diff(feet(motion)[..., [0, 2]], axis=0), axis=-1) * 60
    return float(np.percentile(speed[down], 95))


@pytest.mark.parametrize("name", RHYTHM)
def test_planted_feet_stay_planted_and_frames_contacts_and_gait_go_together(name: str) -> None:
    before = replace(walker(400), gait=np.eye(6)[np.ones(400, int)])
    after = apply(before, part_edits()[name], Plain())  # type: ignore[arg-type]
    assert slide(after) < 1.6 * slide(before) + 0.005
    assert feet(after)[..., 1].min() > feet(before)[..., 1].min() - 0.012
    assert len(after.hips) == len(after.local) == len(after.contacts) == len(after.gait)
    assert np.isfinite(after.hips).all()
    assert np.linalg.norm(np.diff(after.local, axis=0), axis=-1).max() < 0.25, "a joint jumps"


@pytest.mark.parametrize("name", [n for n in RHYTHM if part_edits()[n].kind == "steps"])
def test_steps_are_as_long_and_as_quick_as_the_edit_says(name: str) -> None:
    before, after = edited(name)
    length = part_edits()[name].parameters.get("length", 1.0)
    cadence = part_edits()[name].parameters.get("cadence", 1.0)
    a, b = measured(before).left_leg, measured(after).left_leg
    assert b.step_length / a.step_length == pytest.approx(length, rel=0.04)
    assert b.cadence / a.cadence == pytest.approx(cadence, rel=0.04)
    assert b.speed / a.speed == pytest.approx(length * cadence, rel=0.05)
    assert b.width == pytest.approx(a.width, abs=0.015)
    assert b.stance_lead == pytest.approx(a.stance_lead, abs=0.15)


CYCLED = {  # measure of the torso and parameter of the edits that scale it
    ("bounce", "scale"): "level bob_little bob",
    ("sway", "sideways"): "hips_sway_little hips_sway hips_sway_far",
    ("pelvis_yaw_range", "yaw"): "hips_still hips_swing hips_swing_far",
    ("shoulder_yaw_range", "yaw"): "shoulders_still shoulders_turn_little shoulders_turn",
}


@pytest.mark.parametrize(
    ("name", "field", "parameter"),
    [(f"torso.{n}", *of) for of, names in CYCLED.items() for n in names.split()],
)
def test_what_moves_in_a_cycle_is_scaled_by_the_factor(name: str, field: str, parameter: str) -> None:
    before, after = edited(name)
    a, b = measured(before), measured(after)
    factor = part_edits()[name].parameters[parameter]
    assert getattr(b.torso, field) / getattr(a.torso, field) == pytest.approx(factor, rel=0.1, abs=0.1)
    for other in ("cadence", "step_length", "speed", "stance_lead"):
        assert getattr(b.left_leg, other) == pytest.approx(getattr(a.left_leg, other), rel=0.03, abs=0.03)


@pytest.mark.parametrize("name", [n for n in RHYTHM if part_edits()[n].kind == "stance"])
def test_a_limp_is_unequal_time_on_either_foot(name: str) -> None:
    before, after = edited(name)
    side = part_edits()[name].slot
    wanted = part_edits()[name].parameters["uneven"]
    borne = [(m.contacts[:, :2].any(1), m.contacts[:, 2:].any(1)) for m in (before, after)]
    alone = [(left & ~right).sum() / (right & ~left).sum() for left, right in borne]
    ratio = alone[1] / alone[0]
    ratio = ratio if side == "left_leg" else 1.0 / ratio
    assert np.log(ratio) / np.log(wanted) == pytest.approx(1.0, abs=0.25)
    steps = [abs(getattr(measured(m), side).speed) for m in (before, after)]
    assert steps[1] > 0.7 * steps[0]


@pytest.mark.parametrize("name", ["legs.pausing", "legs.pausing_little"])
def test_every_step_is_followed_by_a_pause(name: str) -> None:
    before, after = edited(name)
    steps = 2 * len(before.hips) / cycle_frames(before.contacts)
    longer = (len(after.hips) - len(before.hips)) / 60.0
    assert longer / steps == pytest.approx(part_edits()[name].parameters["pause"], rel=0.12)
    assert feet(after)[-1, 0, 2] == pytest.approx(feet(before)[-1, 0, 2], abs=0.05)


@pytest.mark.parametrize("name", [n for n in RHYTHM if part_edits()[n].kind == "line"])
def test_feet_are_set_down_where_the_edit_says(name: str) -> None:
    _, after = edited(name)
    path = cycle_mean(after.hips, cycle_frames(after.contacts))
    for column, sign in ((0, 1.0), (2, -1.0)):
        standing = after.contacts[:, column].astype(bool)
        out = sign * (feet(after)[:, column, 0] - path[:, 0])[standing]
        assert np.median(out) == pytest.approx(part_edits()[name].parameters["outward"], abs=0.012)


def test_a_stomp_lands_hard_and_a_soft_step_does_not() -> None:
    names = ("legs.soft", "legs.stomping", "legs.stomping_hard")
    speeds = {name: measured(edited(name)[1]).left_leg.landing for name in names}
    plain = measured(walker(600)).left_leg.landing
    assert speeds["legs.soft"] < plain < speeds["legs.stomping"] < speeds["legs.stomping_hard"]
    assert speeds["legs.stomping"] > plain + 0.2


@pytest.mark.parametrize("name", ["legs.short", "legs.short_little", "legs.hurried"])
def test_short_steps_do_not_bend_the_knees(name: str) -> None:
    before, after = edited(name)
    assert measured(after).left_leg.knee_bend < measured(before).left_leg.knee_bend + 3.0
    assert np.median(after.hips[:, 1]) > np.median(before.hips[:, 1])


def test_who_staggers_leaves_the_line_by_as_much_as_is_said() -> None:
    before, after = edited("legs.staggering")
    sideways = after.hips[:, 0] - np.interp(after.hips[:, 2], before.hips[:, 2], before.hips[:, 0])
    assert 0.7 * 0.24 < np.abs(sideways).max() < 1.3 * 0.24


def test_sentences_of_different_edits_differ() -> None:
    told: dict[tuple[str, str], str] = {}
    for name in RHYTHM:
        edit: PartEdit = part_edits()[name]
        for part, phrases in edit.phrases.items():
            if part != edit.slot and edit.kind == "stance":
                continue  # the other leg's
            for phrase in phrases:
                assert told.setdefault((part, phrase), name) == name
