"""Clauses that say what a part does: what is understood, and that it is said in the words of the training."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.assets import asset_path
from runtime.prompts.english.clauses import parse_clauses
from runtime.prompts.english.grammar import Grammar
from runtime.prompts.english.segments import with_commas
from runtime.prompts.english.words import continuous
from runtime.skeleton import PART_NAMES
from tests.helpers.counting import bounded
from training.augmentation.catalogue import part_edits


@pytest.mark.parametrize(
    ("prompt", "rest", "expected"),
    [
        (
            "an exhausted soldier, left arm hanging",
            "an exhausted soldier",
            {"left_arm": "left arm hanging limp"},
        ),
        ("an old pirate limping on his right leg", "an old pirate", {"right_leg": "right leg"}),
        ("a person limping with the left foot", "a person", {"left_leg": "limping on the left leg"}),
        ("limping badly on my right leg", "", {"right_leg": "limping"}),
        ("a spy looking down", "a spy", {"head": "looking at the ground"}),
        ("a cook with crossed arms", "a cook", {"left_arm": "folded across", "right_arm": "folded across"}),
        ("someone looking left and right", "someone", {"head": "turning left and right"}),
        ("Left arm spinning like a propeller", "", {"left_arm": "left arm spinning like a propeller"}),
        (
            "hunched, on tiptoes with bent knees",
            "",
            {"torso": "rounded", "left_leg": "knee bent", "right_leg": "tiptoe"},
        ),
        (
            "left and right hand behind the back",
            "",
            {"left_arm": "behind the back", "right_arm": "behind the back"},
        ),
        (
            "left hand on the head, limping on the right leg, looking down",
            "",
            {"left_arm": "on the head", "right_leg": "limping", "head": "down"},
        ),
        (
            "one hand on the hip and the other on the head",
            "",
            {"right_arm": "on the hip", "left_arm": "on the head"},
        ),
        ("left hand raised, the other behind the back", "", {"left_arm": "overhead", "right_arm": "behind"}),
        (
            "arms and legs stiff",
            "",
            {part: "st" for part in ("left_arm", "right_arm", "left_leg", "right_leg")},
        ),
        ("a nurse that lets the left arm dangle", "a nurse", {"left_arm": "hanging limp"}),
        ("elbows out", "", {"left_arm": "like a wing", "right_arm": "like a wing"}),
        ("a zombie whose arms hang down", "a zombie", {"left_arm": "hanging", "right_arm": "hanging"}),
        # words of parts that say nothing about a part
        ("head teacher", "head teacher", {}),
        ("an arms dealer", "an arms dealer", {}),
        ("a man with a cane", "a man with a cane", {}),
        ("feeling down", "feeling down", {}),
        ("hand in hand", "hand in hand", {}),
        ("head over heels in love", "head over heels in love", {}),
        ("back to school kid", "back to school kid", {}),
        ("arms like a robot", "arms like a robot", {}),
    ],
)
def test_clauses(prompt: str, rest: str, expected: dict[str, str]) -> None:
    parsed = parse_clauses(prompt)
    assert parsed.rest == rest
    assert set(parsed.parts) == set(expected)
    for part, words in expected.items():
        assert words in parsed.parts[part]


@pytest.mark.parametrize(
    ("prompt", "edits"),
    [
        ("hands on hips", "left_arm.on_hip right_arm.on_hip"),
        ("right hand on the hip", "right_arm.on_hip"),
        ("both arms raised overhead", "left_arm.overhead right_arm.overhead"),
        ("raising the left hand", "left_arm.overhead"),
        ("hands in pockets", "left_arm.in_pocket right_arm.in_pocket"),
        ("arms crossed", "left_arm.folded right_arm.folded"),
        ("hands clasped behind his back", "left_arm.behind_back right_arm.behind_back"),
        ("both hands behind the head", "left_arm.behind_head right_arm.behind_head"),
        ("left hand on the head", "left_arm.on_head"),
        ("right hand at the ear", "right_arm.at_ear"),
        ("hands in front of the face", "left_arm.before_face right_arm.before_face"),
        ("one hand on each hip", "left_arm.on_hip right_arm.on_hip"),
        ("right hand scratching the back of his head", "right_arm.behind_head"),
        ("twisting the upper body to the left and right", "torso.twist"),
        ("right arm shielding the eyes", "right_arm.before_face"),
        ("arms held out wide from the body", "left_arm.side_low right_arm.side_low"),
        ("right hand holding the belly", "right_arm.on_belly"),
        ("left hand on the heart", "left_arm.on_chest"),
        ("arms stretched out in front", "left_arm.forward right_arm.forward"),
        ("right arm slightly raised to the side", "right_arm.side_low"),
        ("arms spread like wings", "left_arm.side right_arm.side"),
        ("left arm stretched backward", "left_arm.backward"),
        ("right hand waving", "right_arm.waving"),
        ("arms flapping", "left_arm.flapping right_arm.flapping"),
        ("left fist punching", "left_arm.punching"),
        ("arms swinging widely", "left_arm.swing_wide right_arm.swing_wide"),
        ("arms hardly swinging", "left_arm.swing_little right_arm.swing_little"),
        ("no arm swing", "left_arm.hanging right_arm.hanging"),
        ("without swinging the arms", "left_arm.hanging right_arm.hanging"),
        ("arms not swinging", "left_arm.hanging right_arm.hanging"),
        ("neither hand raised", "left_arm.hanging right_arm.hanging"),
        ("knees lifted high", "left_leg.high_knee right_leg.high_knee"),
        ("dragging the left foot", "left_leg.dragging"),
        ("limping on the right leg", "right_leg.limping"),
        ("toes turned out", "left_leg.toes_out right_leg.toes_out"),
        ("pigeon-toed", "left_leg.toes_in right_leg.toes_in"),
        ("wide stance", "left_leg.wide right_leg.wide"),
        ("feet very far apart", "legs.very_wide"),
        ("feet together", "left_leg.narrow right_leg.narrow"),
        ("on tiptoe", "legs.tiptoe"),
        ("knees slightly bent", "legs.crouch_little"),
        ("crouching", "legs.crouch"),
        ("deep crouch", "legs.crouch_deep"),
        ("with very bent knees", "legs.crouch_deep"),
        ("slightly bent knees", "legs.crouch_little"),
        ("leaning slightly forward", "torso.lean_forward_little"),
        ("torso leaning forward", "torso.lean_forward"),
        ("leaning very far forward", "torso.lean_forward_far"),
        ("leaning slightly back", "torso.lean_back_little"),
        ("leaning far back", "torso.lean_back_far"),
        ("slightly leaning forward", "torso.lean_forward_little"),
        ("torso leaning to the left", "torso.lean_left"),
        ("leaning far to the right", "torso.lean_right_far"),
        ("shoulders hunched", "torso.slump"),
        ("chest out", "torso.chest_out"),
        ("shoulders twisting", "torso.twist"),
        ("looking down", "head.down"),
        ("head slightly lowered", "head.down_little"),
        ("head hanging low", "head.down_far"),
        ("head up", "head.up"),
        ("looking up at the sky", "head.up_far"),
        ("gazing up at the clouds", "head.up_far"),
        ("leaning back a lot", "torso.lean_back_far"),
        ("head turned to the left", "head.turned_left"),
        ("looking right", "head.turned_right"),
        ("head tilted to the right", "head.tilted_right"),
        ("looking around", "head.looking_around"),
        ("shaking his head", "head.shaking"),
        ("nodding", "head.nodding"),
    ],
)
def test_clauses_are_said_as_the_networks_were_told(prompt: str, edits: str) -> None:
    told = {part: phrases for edit in edits.split() for part, phrases in part_edits()[edit].phrases.items()}
    parsed = parse_clauses(prompt)
    assert parsed.rest == ""
    if "limping" in edits:  # the other leg is the library's
        told = {part: told[part] for part in parsed.parts}
    assert set(parsed.parts) == set(told)
    for part, phrases in told.items():
        assert any(parsed.parts[part].startswith(phrase) for phrase in phrases), parsed.parts[part]


def test_a_raised_chin_or_look_is_told_by_words_that_show_beside_others() -> None:
    """Of "head raised, chin up" little is left beside folded arms or bent knees."""
    for prompt in ("chin up", "arms crossed, chin raised", "gazing upwards"):
        assert parse_clauses(prompt).parts["head"] == "head tilted back, chin raised, held still"
    assert parse_clauses("chin slightly up").parts["head"] == "head slightly raised"
    assert parse_clauses("looking straight up").parts["head"] == "head thrown back, looking at the sky"


@pytest.mark.parametrize(
    ("prompt", "rest", "part", "words"),
    [
        ("a man not looking down", "a man", "head", "looking straight ahead"),
        ("without moving the head", "", "head", "still"),
        ("not limping", "", "left_leg", "stepping evenly"),
        ("walks without bending the knees", "walks", "right_leg", "stiff and straight"),
        ("never lifting the feet", "", "left_leg", "dragging"),
        ("a king, not leaning forward", "a king", "torso", "upright"),
        ("with no hands on hips", "", "right_arm", "hanging at the side"),
        ("neither arm moving", "", "left_arm", "not swinging"),
        ("don't swing your arms", "", "right_arm", "not swinging"),
        ("a butler who never looks up", "a butler", "head", "slightly lowered"),
        ("no bouncing", "", "torso", "gliding level"),
        ("a sailor, less hip sway", "a sailor", "torso", "held still"),
        ("don't lift your heels off the ground", "", "left_leg", "dragging"),
        # instructions
        ("swing your arms a lot more", "", "left_arm", "swinging widely"),
        ("swing the arms less", "", "left_arm", "swinging very little"),
        ("turn the right foot out", "", "right_leg", "right foot turned outward"),
        ("please keep the torso upright", "", "torso", "back straight"),
        ("keep the trunk upright", "", "torso", "back straight"),
        ("pushes the hips forward", "", "torso", "belly forward"),
        ("lower your shoulders", "", "torso", "loose and level"),
        ("bend forward 20 degrees", "", "torso", "torso leaning forward"),
        ("bend forward by 70 degrees", "", "torso", "leaning far forward"),
        ("lift the feet less", "", "left_leg", "lifted barely"),
        ("pull in your belly", "", "torso", "upright"),
    ],
)
def test_denials_and_instructions_say_what_is_there(prompt: str, rest: str, part: str, words: str) -> None:
    parsed = parse_clauses(prompt)
    assert parsed.rest == rest
    assert words in parsed.parts[part]


def test_what_is_denied_adds_nothing_to_what_is_said() -> None:
    assert parse_clauses("head down, never looking up").parts == parse_clauses("head down").parts
    assert parse_clauses("never looking up, head down").parts == parse_clauses("head down").parts


@pytest.mark.parametrize(
    "prompt", ["hold back the tears", "an elephant's trunk", "turn back home", "swing hip hop"]
)
def test_orders_need_a_body_part(prompt: str) -> None:
    assert parse_clauses(prompt).parts == {}


def test_the_order_of_rules_never_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    file = tomllib.loads(asset_path("prompts/clauses.toml").read_text("utf-8"))
    groups = [
        file[group][kind] for group in ("arm", "leg", "torso", "head") for kind in ("actions", "denied")
    ]
    for rules in (*groups, file["phrases"]["rules"], *file["relations"].values()):
        rules.reverse()
    lines = Path(__file__).with_name("side_sentences.txt").read_text("utf-8").splitlines()
    prompts = [line.partition(" | ")[0] for line in lines if line and not line.startswith("#")]
    parsed = [parse_clauses(prompt) for prompt in prompts]
    turned = Grammar(file)
    for module in ("clauses", "sides"):
        monkeypatch.setattr(f"runtime.prompts.english.{module}.grammar", lambda: turned)
    assert [parse_clauses(prompt) for prompt in prompts] == parsed


# gestures of a hand at a part


@pytest.mark.parametrize(
    ("prompt", "rest", "part", "words"),
    [
        ("mopping the brow with his left hand", "", "left_arm", "in front of the face"),
        ("an old man clutching his chest", "an old man", "right_arm", "on the chest"),
        ("rubs her left ear", "", "left_arm", "to the ear"),
        ("squeezing her right elbow", "", "left_arm", "folded across"),
        ("wiping tears from the cheeks with both hands", "", "left_arm", "to the ear"),
        ("a cook scratching his head", "a cook", "right_arm", "on the head"),
    ],
)
def test_a_hand_goes_where_a_gesture_says(prompt: str, rest: str, part: str, words: str) -> None:
    parsed = parse_clauses(prompt)
    assert parsed.rest == rest
    assert words in parsed.parts[part]
    assert len(parsed.parts) == (2 if "both" in prompt else 1)


@pytest.mark.parametrize(
    "prompt", ["not touching the face", "a press officer", "pressing the knees together"]
)
def test_no_gesture_is_made_of_other_words(prompt: str) -> None:
    assert "right_arm" not in parse_clauses(prompt).parts


@given(st.text(max_size=300))
@settings(max_examples=150, deadline=None)
def test_any_text_parses_to_usable_descriptions(text: str) -> None:
    for part, description in parse_clauses(text).parts.items():
        assert part in PART_NAMES
        assert 0 < len(description) <= 300


def test_the_longest_prompt_parses_quickly() -> None:
    with bounded():
        for word in (
            "left ",
            "looking ",
            "arms and ",
            "the his her ",
            "raised the left ",
            "hands and feet up ",
        ):
            parse_clauses((word * 1000)[:1000])


@pytest.mark.parametrize(
    ("prompt", "plain"),
    [
        ("hips swaying with each stride", "hips swaying"),
        ("head bobbing on every step", "head bobbing"),
        ("leaning forward into each step", "leaning forward"),
        ("arms swinging in time with the steps", "arms swinging"),
        ("shoulders rolling with the rhythm of the walk", "shoulders rolling"),
        ("stomping with every single step", "stomping"),
    ],
)
def test_when_something_is_done_is_no_way_of_stepping(prompt: str, plain: str) -> None:
    assert parse_clauses(prompt) == parse_clauses(plain)


@pytest.mark.parametrize(
    "prompt", ["pausing at every step", "walks up the steps", "short steps", "on the steps"]
)
def test_steps_that_are_spoken_of_stay(prompt: str) -> None:
    parsed = parse_clauses(prompt)
    assert parsed.rest.endswith(("step", "steps")) or parsed.parts


@pytest.mark.parametrize(
    ("prompt", "way"),
    [
        ("he trudges home", "he trudging"),
        ("a thief creeps along the wall", "a thief creeping along the wall"),
        ("she hurries", "she hurrying"),
        ("waddle like a duck", "waddling like a duck"),
        ("he crouches", "he crouching"),
        ("someone in a hurry", "someone in a hurry"),
        ("the charge of a knight", "the charge of a knight"),
        ("a slow creep", "a slow creeping"),
    ],
)
def test_verbs_are_read_as_the_library_has_them(prompt: str, way: str) -> None:
    assert parse_clauses(prompt) == parse_clauses(way)
    assert continuous(prompt.replace(" home", "")) == way


@pytest.mark.parametrize(
    ("prompt", "parts"),
    [
        ("his left hand never leaves his pocket", {"left_arm": "in the pocket"}),
        ("shifting the weight from one foot to the other", {"torso": "rocking from side to side"}),
        ("weight moving heavily from leg to leg", {"torso": "rocking from side to side"}),
        ("picks his feet up high", {"left_leg": "lifted high", "right_leg": "lifted high"}),
        ("swinging a bucket in her left hand, humming", {"left_arm": "swinging widely"}),
        ("scanning the ground for a lost coin", {"head": "looking at the ground"}),
        ("weight back on the heels", {"torso": "leaning back"}),
        ("sagging knees", {"left_leg": "knee slightly bent", "right_leg": "knee slightly bent"}),
        ("a drunk weaves from side to side", {"torso": "rocking from side to side"}),
        ("wringing her hands", {"left_arm": "in front", "right_arm": "in front"}),
    ],
)
def test_idioms_are_clauses(prompt: str, parts: dict[str, str]) -> None:
    found = parse_clauses(prompt).parts
    assert found.keys() == parts.keys()
    assert all(words in found[part] for part, words in parts.items()), found


@pytest.mark.parametrize(
    ("prompt", "clauses"),
    [
        ("chin up chest out arms swinging long strides", "chin up|chest out|arms swinging|long strides"),
        ("a tired man head down dragging his left foot", "a tired man|head down|dragging his left foot"),
        ("head turned right arms crossed", "head turned right|arms crossed"),
        ("left hand holding the right elbow up", "left hand holding the right elbow up"),
        ("toes turned in leaning forward", "toes turned in|leaning forward"),
        ("head down and turned to the left", "head down|head turned to the left"),
        ("arms bent and not swinging", "arms bent|arms not swinging"),
        ("arms swinging back and forth", "arms swinging back and forth"),
    ],
)
def test_clauses_begin_without_a_comma(prompt: str, clauses: str) -> None:
    assert with_commas(prompt).replace("\n", "|") == clauses


@pytest.mark.parametrize(
    ("prompt", "part", "words"),
    [
        ("feet barely leave the floor", "left_leg", "dragging"),
        ("the knees hardly bend", "right_leg", "hardly bending"),
        ("barely bent knees", "right_leg", "slightly bent"),
        ("bent over almost horizontally", "torso", "far forward"),
        ("bent forward at a right angle", "torso", "far forward"),
        ("walks with no bend in the right knee", "right_leg", "stiff"),
        ("long lazy strides", "left_leg", "very long slow"),
        ("teeny weeny steps", "left_leg", "very short"),
        ("slow short steps", "left_leg", "slowly in short"),
        ("long fast strides", "left_leg", "long quick"),
        ("toes slightly out", "right_leg", "slightly outward"),
        ("torso turned a little to the left", "torso", "slightly to the left"),
        ("arms swinging like mad", "left_arm", "widely"),
        ("bow legged", "left_leg", "wide"),
        ("thumb hooked in the belt", "right_arm", "on the hip"),
        ("collar held shut with one hand", "right_arm", "chin"),
        ("head balanced with both hands", "left_arm", "on the head"),
        ("left hand on his right shoulder", "left_arm", "other shoulder"),
        ("broken arm in a sling, right arm swinging", "left_arm", "forearm across"),
        ("the toes of the right foot turned in", "right_leg", "inward"),
        ("looking down to the left", "head", "looking at the ground"),
        ("doesn't bend his knees and doesn't swing his arms", "left_arm", "not swinging"),
    ],
)
def test_hedges_degrees_and_denials(prompt: str, part: str, words: str) -> None:
    assert words in parse_clauses(prompt).parts[part]
