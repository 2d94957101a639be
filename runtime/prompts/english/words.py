"""A prompt as words: those that name a movement, and function words."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache


def word_set(text: str) -> frozenset[str]:
    """Return the words of a text, as a set."""
    return frozenset(text.split())


ARTICLES = word_set("a an the his her hers their theirs its my your our some this these that those")
PERSONS = word_set(
    "person persons people someone somebody one man men woman women human humans character figure guy guys girl boy lady "
    "fellow he she they i you we me him them us whoever passer passerby pedestrian individual"
)
_ANYBODY = word_set("person people someone somebody one")
PREPOSITIONS = word_set(
    "in on at of to from with by through over under across along against into onto toward towards near for after before "
    "during between around beside behind past about upon off within among up down out"
)
LINKS = word_set("and but while when who whose that which as like or then because so if than")
# words that a prompt may contain without naming a movement
FILLER = frozenset(
    ARTICLES
    | PERSONS
    | LINKS
    | word_set(
        "it who walking walk walks walked moving move moves standing stand stands running run runs going goes go normally "
        "normal please make is are was were be being been am has have having had does do doing did just both very style "
        "manner way gait kind sort type crossing making getting gets got trying tries take takes taking coming comes putting "
        "ordinary regular plain average usual typical neutral default unremarkable using looks seems feels feeling looking "
        "keeps keep stays staying can could would will there here dressed wearing wears wear carrying holding"
    )
)
SLIGHT = word_set("slightly somewhat mildly little bit faintly half almost vaguely barely hardly kinda")
STRONG = word_set(
    "very extremely totally completely really utterly incredibly so too terribly deeply absolutely super mostly mainly "
    "awfully insanely overly"
)
DEGREES = SLIGHT | STRONG | word_set("rather quite fairly pretty")
# names of body parts, and the parts they mean: "arms like a robot", "penguin legs"
PART_WORDS = {
    **dict.fromkeys(("arm", "hand", "elbow"), ("left_arm", "right_arm")),
    **dict.fromkeys(("leg", "foot", "feet", "knee", "step"), ("left_leg", "right_leg")),
    **dict.fromkeys(("torso", "body", "chest", "shoulder", "hip", "back", "posture"), ("torso",)),
    **dict.fromkeys(("head", "face", "neck", "eye"), ("head",)),
}
SIDES = word_set("left right upper lower both other")
# words of places on a body, which name no movement: "the right side", "ankle-deep"
PLACES = frozenset(PART_WORDS) | SIDES | word_set("side ankle thigh heel toe wrist finger waist forearm")
NEGATIONS = word_set("not never isn't aren't wasn't doesn't don't didn't neither nor")
# deny only what the library knows: "no energy" is a kind of tiredness
ABSENCES = word_set("no without minus less stop stops avoid avoids avoiding hardly")
_SPELLINGS = dict(armor="armour", armored="armoured", plow="plough", mommy="mum", pajamas="pyjamas")
# verbs that the library has only in their -ing form, and that are not common nouns
_VERBS = (
    "amble ascend blush bounce brood bumble charge cheer cower creep crouch descend despair flee flutter fume grieve hurry "
    "implore lumber lurch mince mourn nod plod prowl saunter scheme shuffle slither slouch sneak stagger stalk starve stroll "
    "stumble swagger tiptoe totter trot trudge twirl twitch waddle wade waver weave wobble yawn yearn"
)
_WORD = re.compile(r"[^\W_]+(?:'[^\W_]+)?")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_PART_DOES_NOT = re.compile(
    r"\b(arms?|hands?|elbows?|legs?|knees?|foot|feet|heels?|head|chin|torso|shoulders?|hips?|back|body) "
    r"(?:(?:do|does|did|can|will|would) not|cannot|can't|won't|don't|doesn't|didn't)\b",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Word:
    """One word of a prompt: as written in lower case, its stem, and the number of the clause it stands in."""

    text: str
    stem: str
    clause: int

    @property
    def says(self) -> bool:
        """Whether the word can name a movement."""
        held = self.text in FILLER or self.text in PREPOSITIONS or self.text in DEGREES
        return not held and not self.text.isdigit()


def words_of(text: str) -> list[Word]:
    """Return the words of a prompt without articles; commas and full stops begin a new clause."""
    clauses = re.split(r"[,.;:!?()\n]+", plain(text))
    return [
        Word(word, stem(word), number)
        for number, clause in enumerate(clauses)
        for word in _WORD.findall(clause)
        if word not in ARTICLES
    ]


def plain(text: str) -> str:
    """Return the text in lower case with straight quotes; camel case such as "ArmsAboveHead" is split."""
    if " " not in text.strip():
        text = _CAMEL.sub(" ", text)
    return text.lower().replace("’", "'")


def plain_denials(text: str) -> str:
    """Return "the arms never swing" for "the arms do not swing", which has the word order of "arms swing"."""
    return _PART_DOES_NOT.sub(r"\1 never", text.replace("’", "'"))


def continuous(text: str) -> str:
    """Return a lower-case prompt with verbs in the library's form: "trudging home" for "he trudges home"."""
    return _FINITE.sub(lambda found: finite_forms()[found[0]], text)


@cache
def finite_forms() -> dict[str, str]:
    """Return the library's form "trudging" for "trudge" and "trudges", for all of its verbs."""
    forms: dict[str, str] = {}
    for verb in _VERBS.split():
        bare = verb[:-1] if verb.endswith("e") and not verb.endswith(("ee", "oe")) else verb
        if verb in ("nod", "plod", "trot"):
            bare += verb[-1]
        ending = "es" if verb.endswith(("ch", "sh")) else "s"
        third = f"{verb[:-1]}ies" if verb.endswith("y") else verb + ending
        forms |= {verb: f"{bare}ing", third: f"{bare}ing"}
    return forms


# not "a charge", "in his hurry", which are nouns
_FINITE = re.compile(
    rf"(?<!\ba )(?<!\ban )(?<!\bthe )(?<!\bhis )(?<!\bher )(?<!\bno )\b(?:{'|'.join(finite_forms())})\b"
)


@cache
def stem(word: str) -> str:
    """Return a word without plural or possessive s, in British spelling."""
    word = word.removesuffix("'s")
    word = _SPELLINGS.get(word, word)
    if len(word) > 4 and word.endswith("ies"):
        return word[:-3] + "y"
    if len(word) > 3 and word.endswith("s") and not word.endswith(("ss", "us", "is", "does")):
        return word[:-1]
    return word


def key(words: Sequence[Word]) -> str:
    """Return the stems of a phrase joined without spaces, equal for its spelling variants."""
    return "".join(word.stem for word in words).replace("'", "")


def without_person(words: Sequence[Word]) -> Sequence[Word]:
    """Return a phrase without the person: "walking calmly" for "someone walking calmly"."""
    return words[1:] if len(words) > 1 and words[0].text in _ANYBODY else words


def distinct_words(texts: Sequence[str]) -> frozenset[str]:
    """Return all words of some texts, articles too."""
    return frozenset(_WORD.findall(plain(" . ".join(texts))))
