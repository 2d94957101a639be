"""Augmentation: every edit does what its words say, and what is held out stays out."""

import json
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.assets import asset_path
from runtime.errors import FileError
from runtime.feet.ik import LEG_FEET
from runtime.measures.table import BodyMeasures, measure
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import ANKLE_HEIGHT, PART_NAMES, SPORT_SKELETON, TOE_HEIGHT
from runtime.terrain.height_map import Terrain
from tests.helpers.synthetic_clips import flat_patch, save_motion
from tests.helpers.walker import CYCLE_FRAMES, walk
from training import augmentation
from training.augmentation import recipes
from training.augmentation.build import LAYERS, build_layers
from training.augmentation.catalogue import catalogue, load_catalogue, part_edits
from training.augmentation.edits import apply
from training.augmentation.gait import left_landings, step_phase
from training.augmentation.motion import EditedMotion, keep_feet


@cache
def walker(frames: int = 300) -> EditedMotion:
    """A walk with swinging arms; edits make a motion of their own."""
    hips, local, contacts = walk(frames)
    arms = [SPORT_SKELETON.index(n) for n in ("LeftArm", "RightArm")]
    swing = 0.35 * np.sin(2 * np.pi * np.arange(frames) / CYCLE_FRAMES)
    for joint, sign in zip(arms, (1.0, -1.0), strict=True):
        down = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.full(frames, -1.4 * sign))
        forward = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), sign * swing)
        local[:, joint] = rotations.multiply(forward, down)
    hips = hips.astype(float)
    step = 2 * np.pi * np.arange(frames) / CYCLE_FRAMES
    before = EditedMotion(hips, local, contacts.astype(np.uint8), Terrain.flat(size_m=80.0))
    hips = hips + np.stack([0.02 * np.sin(step), 0.015 * np.cos(2 * step) - 0.03, 0 * step], -1)
    local[:, 0] = rotations.from_yaw(0.1 * np.cos(step))
    local[:, SPORT_SKELETON.index("Spine1")] = rotations.from_yaw(-0.15 * np.cos(step))
    local = keep_feet(EditedMotion(hips, local, before.contacts, before.ground), before)
    hips, local, contacts = hips.astype(float), local.astype(float), contacts.astype(np.uint8)
    return EditedMotion(hips, local, contacts, Terrain.flat(size_m=80.0))


def measured(motion: EditedMotion) -> BodyMeasures:
    return measure(motion.hips, motion.local, motion.contacts)


@cache
def plain() -> BodyMeasures:
    """What is measured of the walk without an edit."""
    return measured(walker())


SIGNS = {  # of the change of the measure, by the words of the edit
    1: "left_arm.overhead right_arm.on_head torso.lean_forward torso.lean_left head.down head.turned_left "
    "left_leg.high_knee legs.crouch legs.tiptoe",
    -1: "left_arm.hanging torso.lean_back_far torso.lean_right head.up head.turned_right left_leg.dragging "
    "left_leg.narrow left_leg.toes_in left_leg.stiff legs.stiff legs.heels",
}


@pytest.mark.parametrize("name", sorted(part_edits()))
def test_an_edit_moves_its_measure_by_its_words_and_keeps_the_body_whole(name: str) -> None:
    edit = part_edits()[name]
    after = apply(walker(), edit, np.random.default_rng(3))
    part, field = edit.measure
    before, now = (getattr(getattr(body, part), field) for body in (plain(), measured(after)))
    change = now - before
    assert np.isfinite(after.local).all()
    assert np.allclose(np.linalg.norm(after.local, axis=-1), 1.0, atol=1e-4)
    assert abs(change) > 0.008, f"{name}: the measure {part_edits()[name].measure} moved by {change:.4f}"
    assert all(sign * change > 0.0 for sign, names in SIGNS.items() if name in names.split())


@pytest.mark.parametrize("name", [n for n, e in part_edits().items() if e.slot in ("torso", "head")])
def test_the_upper_body_leaves_the_feet_where_they_are(name: str) -> None:
    before = walker(200)
    after = apply(before, part_edits()[name], np.random.default_rng(5))
    feet = [SPORT_SKELETON.forward_kinematics(m.hips, m.local)[0][:, LEG_FEET] for m in (before, after)]
    assert np.abs(feet[0] - feet[1]).max() < 0.02  # the reach of a leg may give way a little


def test_a_dragged_foot_slides_flat_over_the_ground_and_not_through_it() -> None:
    before = walker()
    after = apply(before, part_edits()["left_leg.dragging"], np.random.default_rng(3))
    ankle, toe = (SPORT_SKELETON.index(f"Left{name}") for name in ("Foot", "ToeBase"))
    high, _ = SPORT_SKELETON.forward_kinematics(before.hips, before.local)
    low, _ = SPORT_SKELETON.forward_kinematics(after.hips, after.local)
    swing = ~before.contacts[:, :2].any(1)
    for joint, rest in ((ankle, ANKLE_HEIGHT), (toe, TOE_HEIGHT)):
        over_ground, as_before = low[swing, joint, 1] - rest, high[swing, joint, 1] - rest
        assert np.median(over_ground) < 0.35 * np.median(as_before)
        assert over_ground.min() > min(as_before.min(), 0.0) - 0.01
    assert np.allclose(low[~swing][:, [ankle, toe]], high[~swing][:, [ankle, toe]], atol=0.01)


def test_an_arm_edit_touches_that_arm_alone() -> None:
    before = walker(120)
    after = apply(before, part_edits()["left_arm.on_hip"], np.random.default_rng(0))
    others = [j for j in range(31) if j not in range(17, 24)]
    assert np.array_equal(before.local[:, others], after.local[:, others])
    assert not np.allclose(before.local[:, 18], after.local[:, 18])


def test_step_phase_is_whole_where_the_left_foot_lands() -> None:
    contacts = walk(400)[2].astype(np.uint8)
    phase = step_phase(contacts)
    at = phase[left_landings(contacts)]
    assert len(at) >= 4
    assert np.allclose(at, np.round(at), atol=1e-9)
    assert (np.diff(phase) > 0).all()


def test_recipes_never_show_what_is_held_out() -> None:
    random = np.random.default_rng(1)
    drawn = [recipes.draw(random, standing=k % 4 == 0) for k in range(4000)]
    assert all(recipes.allowed(edits) for edits in drawn)
    assert not {name for edits in drawn for name in edits} & catalogue().held_out
    for a, b in catalogue().held_out_pairs.values():
        assert not any(a in edits and b in edits for edits in drawn)
    shown = {name for edits in drawn for name in edits}
    assert shown == {e.name for e in catalogue().trained}, "an edit is never drawn"
    slots = [[part_edits()[name].slot for name in edits] for edits in drawn]
    assert all(len(set(s)) == len(s) for s in slots)
    assert {sum(e.endswith("limping") for e in edits) for edits in drawn} == {0, 1}  # never on both legs
    arms = [n for k, edits in enumerate(drawn) if k % 4 for n in edits if n.startswith("left_arm.")]
    movement = [n for n in arms if part_edits()[n].measure[1] == "swing"]
    postures = [n for n in arms if part_edits()[n].measure[1] != "swing"]
    assert len(movement) / len(set(movement)) > 2.4 * len(postures) / len(set(postures))  # drawn more often


def test_bases_show_edits_of_legs_on_their_own_and_together_and_nothing_that_is_held_out() -> None:
    random = np.random.default_rng(2)
    drawn = [recipes.draw_base(random, standing=k % 4 == 0) for k in range(4000)]
    assert all(recipes.allowed(edits) for edits in drawn)
    edits = part_edits()
    legs = {e.name for e in catalogue().trained if "leg" in e.slot}
    assert {n for names in drawn for n in names if "leg" in edits[n].slot} == legs
    parts = {part for names in drawn for n in names for part in edits[n].phrases}
    assert parts == {"left_leg", "right_leg", "torso"}
    legs = [{edits[n].measure[1] for n in names if edits[n].slot == "legs"} for names in drawn]
    together = [measures for measures in legs if len(measures) > 1]
    assert len({frozenset(n) for n in together}) > 15
    assert {"width", "foot_pitch"} in together  # on tiptoes along a line
    assert {"knee_bend", "cadence"} in together


def test_phrases_are_usable_descriptions() -> None:
    for edit in part_edits().values():
        for part, phrases in edit.phrases.items():
            assert part in PART_NAMES
            assert len(phrases) >= 2
            for phrase in phrases:
                assert "{" not in phrase
                PartDescriptions(**dict.fromkeys(PART_NAMES, phrase))


def test_layered_clips_are_written_with_their_words(tmp_path) -> None:
    for k, style in enumerate(("neutral", "angry", "proud")):
        motion = walker(420)
        flat = flat_patch(SPORT_SKELETON.forward_kinematics(motion.hips, motion.local)[0])
        save_motion(
            tmp_path, f"c{k}", (motion.hips, motion.local, motion.contacts), style=style,
            content="walk forward", source="cmu", patches=flat,
        )  # fmt: skip
    build_layers(tmp_path, tmp_path, 12, seed=2)
    entries = json.loads((tmp_path / LAYERS).read_text())
    assert len(entries) == 12
    for name, entry in entries.items():
        with np.load(tmp_path / f"{name}.npz") as clip:
            assert str(clip["content"]) == "layered"
            assert np.isfinite(clip["local_rotations"]).all()
        for edit in entry["edits"]:
            for part, phrases in part_edits()[edit].phrases.items():
                said = [d[part] for d in entry["descriptions"]]
                short = [p.removeprefix(part.replace("_", " ") + " ") for p in phrases]
                assert all(any(p in text for p in short) for text in said)
    again = tmp_path / "again"
    build_layers(tmp_path, again, 5, seed=2)
    (again / LAYERS).unlink()  # a build that was killed: five lines, and a sixth cut off
    lines = [json.dumps([name, entries[name]]) for name in sorted(entries)[:5]]
    (again / "layers.jsonl").write_text("\n".join([*lines, '["layer_00']))
    assert build_layers(tmp_path, again, 12, seed=2) == entries


EDITS_FILE = Path(augmentation.__file__).with_name("edits.toml")


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('kind = "swing"', 'kind = "wing"', "wing is missing"),
        ("parameters = { drag = 0.9 }", "parameters = { drop = 0.9 }", "left_leg.dragging: leg has no drop"),
        ('measure = "knee_bend"', 'measure = "knee_band"', "legs.crouch_little: left_leg has no measure"),
        ('"torso.lean_back_far", ', '"torso.lean_back_most", ', "torso.lean_back_most is no edit"),
        ("[head.down]", "[head.down", "TOML|Expected"),
    ],
)
def test_a_wrong_catalogue_is_refused_with_its_entry(tmp_path, old: str, new: str, problem: str) -> None:
    text = EDITS_FILE.read_text("utf-8")
    assert old in text
    (tmp_path / "edits.toml").write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(FileError, match=problem):
        load_catalogue(tmp_path / "edits.toml")


def test_the_sentences_of_the_clause_rules_are_those_of_the_edits() -> None:
    sentences = tomllib.loads(asset_path("prompts/clauses.toml").read_text("utf-8"))["sentences"]
    for name, text in sentences.items():
        edit = name.rstrip("_23456789")
        edit = edit if edit in part_edits() else f"left_{edit}"
        phrases = {phrase for known in part_edits()[edit].phrases.values() for phrase in known}
        assert text.replace("{s}", "left") in phrases, name
