"""The text evaluation: retrieval, part edits and independence, on motions and codes whose answers are known."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import rotations
from runtime.errors import FileError, UsageError
from runtime.prompts.expander import Expansion
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.prompter import Prompter
from runtime.skeleton import PART_NAMES, SPORT_SKELETON
from tests.helpers.synthetic_clips import save_motion
from tests.helpers.walker import WalkerModel, walk
from training.augmentation.catalogue import catalogue, part_edits
from training.augmentation.edits import apply
from training.augmentation.measured_edits import (
    CapturedReference,
    Summary,
    load_reference,
    rotation_change,
    summarise,
    targets,
)
from training.augmentation.motion import EditedMotion
from training.evaluation.experiment import Setting, run
from training.evaluation.text import command as text_main
from training.evaluation.text import edits, retrieval
from training.evaluation.text import walks as text_walks
from training.evaluation.text.command import TEXT, bars, markdown
from training.evaluation.text.edits import (
    Case,
    by_slot,
    catalogue_cases,
    independence,
    own_and_others,
    part_changes,
    score,
    seed_changes,
)
from training.evaluation.text.retrieval import codes_of, first_ranks, held_out_clips, recall
from training.evaluation.text.walks import Walker

NEUTRAL = PartDescriptions(**{part: f"{part} as always" for part in PART_NAMES})
FRAMES = 300


def write_clip(folder: Path, name: str, frames: int = FRAMES, **changes: str) -> None:
    hips, local, contacts = walk(frames)
    for side, sign in (("Left", -1.0), ("Right", 1.0)):  # the skeleton rests with its arms spread
        down = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(sign * 1.3))
        local[:, SPORT_SKELETON.index(f"{side}Arm")] = down
    save_motion(folder, name, (hips, local, contacts), **{"source": "cmu", **changes})


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clips")
    write_clip(folder, "cmu_01")
    write_clip(folder, "cmu_02", 280)
    write_clip(folder, "cmu_03", 60)  # too short to measure on
    write_clip(folder, "cmu_04", style="angry")
    for name in ("cmu_05", "cmu_05_m", "cmu_05_t"):
        write_clip(folder, name, split="held_out")
    write_clip(folder, "layer_00000", split="held_out", tier="layered")
    write_clip(folder, "rollout_1", split="held_out", source="pfnn_rollouts", content="mixed locomotion")
    return folder


@pytest.fixture(scope="module")
def reference(clips: Path) -> CapturedReference:
    return load_reference(clips)


# --- part edits
def test_every_held_out_edit_and_pair_is_asked_for_in_all_its_phrases() -> None:
    cases = {c.name: c for c in catalogue_cases(NEUTRAL)}
    zero_shot = [c for c in cases.values() if c.kind in ("held out", "pair", "held-out rhythm")]
    assert {c.name for c in zero_shot} == catalogue().held_out | set(catalogue().held_out_pairs)
    assert len(cases) == len(part_edits()) + len(catalogue().held_out_pairs)
    for case in zero_shot:
        assert len(case.variants) >= 3
        assert set(case.seeds) == {0, 1, 2}
        for name in case.edits:
            for part, phrases in part_edits()[name].phrases.items():
                assert {getattr(v, part) for v in case.variants} == set(phrases)
        for part in set(PART_NAMES) - set(case.parts):
            assert {getattr(v, part) for v in case.variants} == {getattr(NEUTRAL, part)}
    assert len(catalogue_cases(NEUTRAL, trained=False)) == len(zero_shot)


def test_the_reference_takes_neutral_walks_that_are_long_enough(reference: CapturedReference) -> None:
    assert [name for name, _, _ in reference.walks] == ["cmu_01", "cmu_02", "cmu_05"]


def test_a_folder_without_neutral_walks_is_named(tmp_path: Path) -> None:
    write_clip(tmp_path, "cmu_04", style="angry")
    with pytest.raises(FileError, match="neutral"):
        load_reference(tmp_path)


@pytest.mark.parametrize("name", ["left_arm.overhead", "head.down_far", "torso.lean_back_far", "legs.crouch"])
def test_described_amounts_are_those_of_the_edit(reference: CapturedReference, name: str) -> None:
    described = reference.described(reference.edited((name,)), (name,))
    assert list(described) == targets((name,))
    (part, field), amount = next(iter(described.items()))
    least = {"hand_level": 2.0, "pitch": 40.0 if part == "head" else -15.0, "knee_bend": 10.0}[field]
    assert amount / least > 1.0


def test_a_measure_that_walks_disagree_about_describes_nothing(reference: CapturedReference) -> None:
    (before, after), *_ = reference.edited(("head.up",))
    assert reference.described([(before, after), (after, before)], ("head.up",)) == {}


def edited(motion: EditedMotion, *names: str, share: float = 1.0) -> Summary:
    """A motion with edits, or in between."""
    changed = motion
    for name in names:
        changed = apply(changed, part_edits()[name], np.random.default_rng(0))
    local = rotations.slerp(motion.local, changed.local, np.array(share)) if share != 1.0 else changed.local
    return summarise(changed.hips, local, changed.contacts)


@pytest.mark.parametrize(
    ("made", "share", "right_way", "enough"),
    [("head.down_far", 1.0, True, True), ("head.down_far", 0.3, True, False), ("head.up_far", 1.0, False, False),
     ("torso.sway", 0.0, False, False)],
)  # fmt: skip
def test_scores_follow_direction_and_amount(
    reference: CapturedReference, made: str, share: float, right_way: bool, enough: bool
) -> None:
    name = "head.down_far"
    _, motion, plain = reference.walks[0]
    described = reference.described(reference.edited((name,)), (name,))
    case = Case(name, "held out", (name,), (NEUTRAL,), (0,))
    row = score(case, [edited(motion, made, share=share)], {0: plain}, described)
    assert (row["right_way"], row["enough"]) == (right_way, enough)
    if made == name:
        assert row["worst_fraction"] == pytest.approx(share, abs=0.15)
    json.dumps(row)


def test_a_pair_needs_both_of_its_parts(reference: CapturedReference) -> None:
    pair = catalogue().held_out_pairs["both arms stretched out in front"]
    _, motion, plain = reference.walks[0]
    described = reference.described(reference.edited(pair), pair)
    case = Case("both", "pair", pair, (NEUTRAL,), (0,))
    assert score(case, [edited(motion, *pair)], {0: plain}, described)["enough"]
    assert not score(case, [edited(motion, pair[0])], {0: plain}, described)["right_way"]


def test_the_median_of_the_walks_counts(reference: CapturedReference) -> None:
    name = "left_arm.overhead"
    _, motion, plain = reference.walks[0]
    described = reference.described(reference.edited((name,)), (name,))
    case = Case(name, "held out", (name,), (NEUTRAL,) * 3, (0, 0, 0))
    done = edited(motion, name)
    row = score(case, [done, plain, done], {0: plain}, described)
    assert row["enough"]
    assert row["runs_enough"] == pytest.approx(2 / 3)
    assert edits.totals([row, {**row, "right_way": False}])["right_way"] == 0.5


# --- retrieval
def test_codes_compare_as_equation_2_does() -> None:
    mean, log_variance = np.random.default_rng(0).standard_normal((2, 4, 6, 64))
    codes = codes_of(mean, log_variance)
    both = np.concatenate([mean, np.exp(log_variance / 2)], -1).reshape(4, -1)
    cosine = both[0] @ both[1] / np.linalg.norm(both[0]) / np.linalg.norm(both[1])
    assert codes[0] @ codes[1] == pytest.approx(cosine)
    np.testing.assert_allclose(np.linalg.norm(codes, axis=1), 1.0)


def test_ranks_count_the_nearest_relevant_entry_and_ties_against_it() -> None:
    similarity = np.array([[0.9, 0.8, 0.7, 0.1], [0.1, 0.5, 0.5, 0.2], [0.1, 0.2, 0.3, 0.4]])
    relevant = np.array([[0, 1, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], bool)
    assert first_ranks(similarity, relevant).tolist() == [2, 2, 1]
    found = recall(similarity, relevant, ["a", "a", "b"])
    assert (found["r1"], found["r3"], found["median_rank"]) == (pytest.approx(1 / 3), 1.0, 2.0)
    assert found["r1_by_style"] == 0.5  # of a no query, of b every one
    assert found["chance_r1"] == pytest.approx((2 / 4 + 1 / 4 + 1 / 4) / 3)


def test_chance_is_what_random_similarities_give() -> None:
    random = np.random.default_rng(1)
    relevant = np.arange(30) % 6 == np.zeros((4000, 1))
    found = recall(random.random((4000, 30)), relevant, ["a"] * 4000)
    assert found["r1"] == pytest.approx(found["chance_r1"], abs=0.03)
    assert found["r3"] == pytest.approx(found["chance_r3"], abs=0.03)
    assert abs(found["median_rank"] - found["chance_rank"]) <= 1
    small = recall(np.ones((1, 1)), np.ones((1, 1), bool), ["a"])
    assert (small["r1"], small["chance_r3"]) == (1.0, 1.0)


def _codes(*numbers: int) -> np.ndarray:
    """Codes that are alike where the numbers are."""
    mean = np.stack([np.random.default_rng(n).standard_normal((6, 64)) for n in numbers])
    return codes_of(mean, np.zeros_like(mean))


def test_scores_count_what_is_found_first() -> None:
    styles = ["angry", "angry", "happy", "neutral_bn"]
    numbers = {"angry": (0, 0), "happy": (1,), "neutral": (2,), "neutral_bn": (3,), "old": (4,)}
    texts = {style: _codes(*known) for style, known in numbers.items()}
    # the happy clip moves as the angry ones
    found = retrieval.scores(styles, list(_codes(0, 0, 0, 2)), texts)
    assert found["motion_to_text"]["r1"] == 0.5
    assert found["motion_to_text_alike"]["r1"] == 0.75  # a neutral walk of another data set is one
    assert found["text_to_motion"]["queries"] == 4  # no held-out clip is old, so it is not queried


def test_only_held_out_captured_clips_of_described_styles_are_in_the_gallery(clips: Path) -> None:
    assert [c.path.stem for c in held_out_clips(clips, ["neutral"])] == ["cmu_05"]
    with pytest.raises(FileError, match="no held-out clips"):
        held_out_clips(clips, ["angry"])


# --- part independence
def test_a_walk_out_of_step_or_turned_differs_little_from_itself() -> None:
    hips, local, contacts = walk(64 * 6)
    early, late = (summarise(x[0], x[1], x[2]) for x in (
        (hips[:256], local[:256], contacts[:256]), (hips[32:288], local[32:288], contacts[32:288])
    ))  # fmt: skip
    assert np.degrees(rotation_change(early, late)).max() < 0.6
    turn = rotations.from_yaw(np.array(1.0))
    turned = local.copy()
    turned[:, 0] = rotations.multiply(turn, local[:, 0])
    other = summarise(rotations.rotate(turn, hips)[:256], turned[:256], contacts[:256])
    assert np.degrees(rotation_change(early, other)).max() < 0.1


def test_a_nodding_head_changes_though_its_mean_does_not(reference: CapturedReference) -> None:
    _, motion, plain = reference.walks[0]
    changes = part_changes(plain, edited(motion, "head.nodding"))
    assert changes["head"] > 2.0
    assert own_and_others(changes, ["head"])[1] < 0.01


def test_an_edit_of_one_part_leaves_the_others_alone(reference: CapturedReference) -> None:
    _, motion, plain = reference.walks[0]
    case = Case("left_arm.side", "trained", ("left_arm.side",), (NEUTRAL,), (0,))
    both = edited(motion, "left_arm.side", "right_arm.side")
    alone = independence(case, [edited(motion, "left_arm.side")], {0: plain}, reference.edited(case.edits))
    leaky = independence(case, [both], {0: plain}, reference.edited(case.edits))
    assert alone["own"] > 20.0
    assert alone["others"] < 0.01
    assert leaky["parts"]["right_arm"] > 20.0
    slots = by_slot([alone, leaky])
    assert slots["left_arm"]["within"] == slots["all"]["within"] == 1.0
    assert slots["all"]["edit_ratio"] < 1e-3
    # the whole other arm went along: few of all the joints, but all of one part
    assert leaky["most"] == pytest.approx(leaky["own"], rel=0.2)
    assert slots["all"]["most_ratio"] > 0.4
    assert by_slot([alone, {**leaky, "others": 0.3 * leaky["own"]}])["all"]["within"] == 0.5
    assert alone["seed_others"] == 0.0  # one seed
    found = seed_changes({0: plain, 1: edited(motion, "left_arm.side"), 2: plain})
    assert found["left_arm"] == pytest.approx(2 / 3 * alone["own"], rel=0.2)
    assert found["head"] < 0.01


# --- walks and the whole
def test_a_walk_is_made_once_and_always_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(text_walks, "LEAD_SECONDS", 0.25)
    monkeypatch.setattr(text_walks, "TOGETHER", 1)  # the stand-in counts its frames
    monkeypatch.setattr(text_walks, "_loaded", lambda folder: made.append(folder) or WalkerModel())
    walker = Walker(Path("model"), seconds=0.5)
    asked = [np.full((6, 64), tilt) for tilt in (0.0, 0.3, 0.0)]
    first, tilted, again = walker.make(asked)
    assert first is again
    assert walker.make(asked[1:])[0] is tilted
    assert len(made) == 1
    assert abs(tilted.body.head.roll - first.body.head.roll) > 5.0
    other = Walker(Path("model"), seconds=0.5).make(asked[:1])[0]
    assert np.array_equal(first.mean, other.mean)


def test_a_walk_in_the_store_is_not_made_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(text_walks, "LEAD_SECONDS", 0.25)
    monkeypatch.setattr(text_walks, "_loaded", lambda folder: WalkerModel())
    asked = [np.full((6, 64), 0.3)]
    (first,) = Walker(Path("model"), seconds=0.5, store=tmp_path / "walks").make(asked)
    monkeypatch.delattr(text_walks, "_loaded")
    (again,) = Walker(Path("model"), seconds=0.5, store=tmp_path / "walks").make(asked)
    assert np.array_equal(first.mean, again.mean)


class StandIn(Prompter):
    """In place of a model's way from words to Z^t: a raised word tilts the head."""

    def __init__(self, model: WalkerModel, text_encoder: Path | None) -> None:
        self.text_encoder = text_encoder

    def expand(self, prompt: str) -> Expansion:
        return Expansion(NEUTRAL.replace("head", prompt), "library", note="made up")

    def __call__(self, words: str | PartDescriptions) -> np.ndarray:
        descriptions = self.expand(words).descriptions if isinstance(words, str) else words
        return np.full((6, 64), 0.3 if "tilted" in descriptions.head else 0.0, np.float32)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few cases and short walks of the synthetic walker."""
    monkeypatch.setattr(text_main, "load_model", lambda folder: WalkerModel())
    monkeypatch.setattr(text_main, "Prompter", StandIn)
    monkeypatch.setattr(text_walks, "_loaded", lambda folder: WalkerModel())
    monkeypatch.setattr(edits, "free_prompts", lambda: {"cocked, tilted left": ("head.tilted_left",)})
    monkeypatch.setattr(text_main, "WALK_S", 0.5)
    monkeypatch.setattr(text_walks, "LEAD_SECONDS", 0.25)
    monkeypatch.setattr(text_walks, "TOGETHER", 1)  # the stand-in counts its frames
    kept = ("head.tilted_left", "head.turned_right", "hands on hips", "torso.twist", "torso.bob_little")
    every = edits.catalogue_cases
    monkeypatch.setattr(
        edits, "catalogue_cases", lambda *a, **k: [c for c in every(*a, **k) if c.name in kept]
    )


def arguments(clips: Path, *more: str) -> list[str]:
    return ["--clips", str(clips), "--model", "./no_such_model", "--workers", "1", *more]


def measured(arguments: list[str]) -> dict[str, Any]:
    return TEXT.figures(Setting(TEXT.parser("text").parse_args(arguments)))


def test_from_clips_to_tables(small: None, clips: Path) -> None:
    results = measured(arguments(clips, "--only", "edits"))
    rows = {r["name"]: r for r in results["edits"]["rows"]}
    # the synthetic model tilts the head for "tilted", whatever else is said, and does nothing for other words
    assert abs(rows["head.tilted_left"]["worst_fraction"]) > 0.5
    assert rows["hands on hips"]["worst_fraction"] == pytest.approx(0.0, abs=0.05)
    assert abs(rows["cocked, tilted left"]["worst_fraction"]) > 0.5
    assert results["edits"]["summary"]["zero-shot"]["cases"] == 3
    assert results["edits"]["summary"]["held-out rhythm"]["cases"] == 1
    assert results["independence"]["by_slot"]["all"]["edits"] == 3
    assert "hands on hips (" in markdown(results)  # which the walk does not show
    assert len(bars(results)) == 5
    assert "**no**" in markdown(results)
    assert markdown(results).count("### Part edits") == 1
    assert str(clips) not in markdown(results)


def test_a_number_of_workers_that_makes_no_sense_is_named(small: None, clips: Path) -> None:
    with pytest.raises(UsageError, match="--workers 0"):
        run(TEXT, arguments(clips, "--workers", "0"), "text")
