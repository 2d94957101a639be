"""Combines several library entries into one set of six descriptions, part by part and on the intended side."""

import re
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from runtime.edits.request import PACE, USUAL_OUTWARD_M
from runtime.prompts.edit_targets import PLAIN_LEG, targets_of
from runtime.prompts.english.phrases import FIGURES, SLIGHT_STRENGTH, Element
from runtime.prompts.english.sides import OPPOSITE, SIDE, only_side
from runtime.prompts.library_data import LibraryEmbeddings, LibraryEntry
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES

WHOLE_FIGURE_PARTS = 5  # an entry that defines this many parts is a whole figure or scene
TEMPERATURE = 0.06  # of the softmax over the similarities of neighbours
# Priority of entries that define the same part: physical constraints before feelings.
_ORDER = (
    "bodies ages walks emotions minds dances sports situations weather ground injuries loads occupations posture steps "
    "arms"
)
_PRECEDENCE = {name: 1.0 + 0.03 * rank for rank, name in enumerate(_ORDER.split())}
_PAIRS = {"arms": ("left_arm", "right_arm"), "legs": ("left_leg", "right_leg")}
_GROUPS = {**_PAIRS, "torso": ("torso",), "head": ("head",)}

_IDLE_ARM = re.compile(
    r"\bbehind the back\b|\bhanging\b(?!.*\bpulled\b)|\bswinging (?:naturally|gently|little|lightly|evenly)"
)
_BUSY_LEG = re.compile(
    r"limping|dragging|trailing|hopping|springing off|off the ground|stiff and straight|low kick|hanging"
)

# statements about a part that can be combined with its figure's: step size or pace, and lean
_OF_STEPS = re.compile(r"\b(?:taking|stepping)\b(?!.*\b(?:foot|feet|knees?|toes|heavily|softly)\b)")
_OF_PACE = re.compile(r"\b(?:slow|quick|brisk|fast|hurr|short|long|tiny)")
_PACED_STEPS = re.compile(rf"^(?!.*\b(?:foot|knee|running|dragging)\b)(?=.*\bstep).*{_OF_PACE.pattern}")
_PACE_ALONE = re.compile(r"^\w+ leg stepping (slowly|quickly), steps of normal length$")
_OF_PLACE = {"outward", "toe_out"}  # targets of the feet's placement
_OF_LEAN = re.compile(r"^torso leaning\b(?!.*,)")
_SWAYS = re.compile(r"\b(?:rock|waddl|sway|bounc|bobb|roll|twist|wobbl)\w*")

Worth = Callable[[int, str], float]  # how well (up to 1) a walk shows an entry's sentence of a part


def compose_elements(
    elements: Sequence[Element],
    entries: tuple[LibraryEntry, ...],
    embeddings: LibraryEmbeddings,
    neutral: int,
    worth: Worth,
) -> dict[str, int]:
    """Return the library entry for each part's words: figures, moods, loads and grounds combined in one body.

    Each part takes the strongest entry that defines it; among equally strong ones, the sentence that the model shows
    best. Without a figure the strongest entry defines the whole body, unless it is "slightly".
    """
    chosen = _without_mentioned([e for e in elements if not e.only], entries)
    figures = [e for e in chosen if len(entries[e.entry].defines) >= WHOLE_FIGURE_PARTS]
    modifiers = [e for e in chosen if e not in figures]
    sources = dict.fromkeys(PART_NAMES, _base(modifiers, entries, neutral))
    if figures:
        sources = _of_figures(figures, entries, embeddings, neutral)
    sources |= _modified(modifiers, entries, worth)
    _show_all(sources, modifiers, entries)
    for element in elements:
        sources.update(dict.fromkeys(element.only, element.entry))
    return sources


def pace_as_stated(
    elements: Sequence[Element], read: Sequence[Element], entries: tuple[LibraryEntry, ...]
) -> tuple[list[Element], dict[str, str]]:
    """Return the elements and their statements about the legs, without entries in `read` that merely set a pace.

    They are only left out if another entry moves the legs.
    """
    paces = [e for e in read if _PACE_ALONE.search(entries[e.entry].descriptions.left_leg)]
    others = [e for e in elements if e not in paces]
    if not paces or not any("left_leg" in entries[e.entry].defines for e in others if not e.only):
        return list(elements), {}
    said = entries[paces[0].entry].descriptions.to_mapping()
    return others, {part: said[part] for part in _PAIRS["legs"]}


def with_figure(stated: Mapping[str, str], figure: Mapping[str, str]) -> dict[str, str]:
    """Return a prompt's statements about parts plus the compatible clauses of its figure: turned-out feet that trudge."""
    return {part: _with_figure(part, words, figure[part]) for part, words in stated.items()}


def _with_figure(part: str, words: str, figure: str) -> str:
    pace, plain = _PACE_ALONE.search(words), PLAIN_LEG.format(side=part.split("_")[0])
    if pace and figure != plain:  # a zombie that walks slowly still drags its feet
        return f"{figure}, walking {pace[1]}"
    return ", ".join([words, *_agreeing(part, words, figure)])


def _agreeing(part: str, words: str, figure: str) -> list[str]:
    """Return the clauses of a figure's sentence for a part that do not contradict the statement."""
    clauses = figure.split(", ")
    if part == "torso":
        swaying = [c for c in clauses if _SWAYS.search(c) and "lean" not in c]
        return swaying[:1] if _OF_LEAN.search(words) else []
    if part not in _PAIRS["legs"] or figure == PLAIN_LEG.format(side=part.split("_")[0]):
        return []
    return _agreeing_of_leg(part, words, clauses)


def _agreeing_of_leg(part: str, words: str, clauses: Sequence[str]) -> list[str]:
    targets = targets_of(part, words)
    asked = targets.keys() - {PACE}
    shown = {c: targets_of(part, c).keys() - {PACE} for c in clauses}  # shown by an edit, besides its speed
    free = [c for c in clauses if shown[c].isdisjoint(asked)]
    by_edits = list(filter(shown.get, free))
    narrow = targets.get("outward", (USUAL_OUTWARD_M,))[0] < USUAL_OUTWARD_M
    if narrow and by_edits[:1] != free[:1]:
        return []  # on a line feet balance in plain steps, if they do not shuffle
    if _OF_STEPS.search(words):
        return [c for c in by_edits if not _OF_STEPS.search(c)][:1]
    return _agreeing_in_pace(words, asked, free)


def _agreeing_in_pace(words: str, asked: Set[str], free: list[str]) -> list[str]:
    paced = _OF_PACE.search(words) is not None
    if asked and asked <= _OF_PLACE:  # foot placement says nothing about the step
        return [c for c in free if not (paced and _PACED_STEPS.search(c))]
    plain = asked or "lifted" in words  # without a gait of its own such as limping or stomping
    return list(filter(_PACED_STEPS.search, free))[:1] if plain and not paced else []


def _base(modifiers: Sequence[Element], entries: tuple[LibraryEntry, ...], neutral: int) -> int:
    strongest = max(modifiers, key=lambda e: _strength(e, entries), default=None)
    return neutral if strongest is None or strongest.degree <= SLIGHT_STRENGTH else strongest.entry


def _modified(
    modifiers: Sequence[Element], entries: tuple[LibraryEntry, ...], worth: Worth
) -> dict[str, int]:
    """Return, for each part, the strongest of the moods, loads and the like that define it."""
    strongest = {}
    for part in PART_NAMES:
        telling = [e for e in modifiers if part in entries[e.entry].defines]
        if telling:
            best = max(telling, key=lambda e: _strength(e, entries) * worth(e.entry, part))
            strongest[part] = best.entry
    return strongest


def _show_all(
    sources: dict[str, int], modifiers: Sequence[Element], entries: tuple[LibraryEntry, ...]
) -> None:
    """Give an entry that lost all its parts the one least missed: "a happy drunk" keeps a happy head."""
    for element in modifiers:
        if element.entry in sources.values():
            continue
        for name in ("head", "torso", "arms", "legs"):
            parts = _GROUPS[name]
            owner = sources[parts[0]]
            elsewhere = any(sources[p] == owner for p in PART_NAMES if p not in parts)
            if elsewhere and set(parts) <= set(entries[element.entry].defines):
                sources.update(dict.fromkeys(parts, element.entry))
                break


def _of_figures(
    figures: Sequence[Element], entries: tuple[LibraryEntry, ...], embeddings: LibraryEmbeddings, neutral: int
) -> dict[str, int]:
    sources = _figure_parts(figures, entries, embeddings, neutral)
    for i in {e.entry for e in figures} - {neutral}:  # hurrying shows in the legs of any figure
        if entries[i].category == "walks" and entries[i].defines == PART_NAMES:
            sources.update(dict.fromkeys(_GROUPS["legs"], i))
    return sources


def _figure_parts(
    figures: Sequence[Element], entries: tuple[LibraryEntry, ...], embeddings: LibraryEmbeddings, neutral: int
) -> dict[str, int]:
    """Return which figure defines each part: the two strongest divide arms, legs, torso and head by distinctiveness."""
    ranked = sorted(figures, key=lambda e: -_figure_strength(e, entries))
    sources = dict.fromkeys(PART_NAMES, ranked[0].entry)
    others = [e for e in ranked if e.entry != ranked[0].entry]
    if not others:
        return sources
    second = others[0].entry
    unusual = 1.0 - np.einsum("npd,pd->np", embeddings.parts, embeddings.parts[neutral])
    more = unusual[second] - unusual[ranked[0].entry]
    gains = {
        name: float(more[[PART_NAMES.index(part) for part in parts]].mean())
        for name, parts in _GROUPS.items()
        if set(parts) <= set(entries[second].defines)
    }
    order = sorted(gains, key=lambda name: -gains[name])
    # each of the two must be visible
    given = order[:1] + [name for name in order[1 : len(_GROUPS) - 1] if gains[name] > 0]
    for name in given:
        sources.update(dict.fromkeys(_GROUPS[name], second))
    return sources


def compose_neighbours(
    ranked: Sequence[tuple[int, float]], embeddings: LibraryEmbeddings, worth: Worth
) -> dict[str, int]:
    """Return, for each part, the neighbour (entry, similarity) that the others agree with most, weighted by similarity and worth.

    Both arms come from one neighbour, and both legs too, since their motions are coordinated.
    """
    indices = [i for i, _ in ranked]
    weights = softmax(np.array([s for _, s in ranked], np.float32) / TEMPERATURE)
    vectors = embeddings.parts[indices]  # (k, 6, D)
    scores = {}
    for p, part in enumerate(PART_NAMES):
        agreement = weights * (vectors[:, p] @ (vectors[:, p].T @ weights))
        scores[part] = agreement * np.array([worth(i, part) for i in indices])
    sources = {}
    for parts in _GROUPS.values():
        best = int(np.argmax(sum(scores[part] for part in parts)))
        sources.update(dict.fromkeys(parts, indices[best]))
    return sources


def sources_note(
    sources: dict[str, int], entries: tuple[LibraryEntry, ...], similarity: dict[int, float]
) -> str:
    """Return a note of which parts come from which entry: "arms, legs: “robot” (100%); torso, head: “depressed person” (96%)"."""
    words = []
    for entry in dict.fromkeys(sources.values()):
        parts = [part for part in PART_NAMES if sources[part] == entry]
        for pair, sides in _PAIRS.items():
            if set(sides) <= set(parts):
                parts = [pair if part == sides[0] else part for part in parts if part != sides[1]]
        near = f" ({similarity[entry]:.0%})" if entry in similarity else ""
        words.append(f"{', '.join(parts).replace('_', ' ')}: “{entries[entry].prompt}”{near}")
    return "; ".join(words)


def softmax(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the softmax over the last axis."""
    e = np.exp(x - x.max(axis=-1, keepdims=True))
    return np.asarray(e / e.sum(axis=-1, keepdims=True), np.float32)


def _without_mentioned(elements: Sequence[Element], entries: tuple[LibraryEntry, ...]) -> list[Element]:
    """Return the elements without figures that are only mentioned: a second figure must be compared or joined."""
    chosen: list[Element] = []
    figures = 0
    for element in elements:
        figure = entries[element.entry].category in FIGURES
        if not (figure and figures) or element.after_like or element.joined:
            chosen.append(element)
            figures += figure
    return chosen


def _strength(element: Element, entries: tuple[LibraryEntry, ...]) -> float:
    return element.similarity * element.degree * _PRECEDENCE.get(entries[element.entry].category, 1.0)


def _figure_strength(element: Element, entries: tuple[LibraryEntry, ...]) -> float:
    # "walks like a penguin" is about the penguin; a figure outranks a scene
    figure = 1.1 if entries[element.entry].category in FIGURES else 1.0
    return element.similarity * element.degree * figure * (1.3 if element.after_like else 1.0)


def words_of_parts(sources: dict[str, int], entries: tuple[LibraryEntry, ...]) -> PartDescriptions:
    """Return six descriptions, each taken from the library entry of its part."""
    return PartDescriptions(**{part: getattr(entries[i].descriptions, part) for part, i in sources.items()})


def entry_side(entry: LibraryEntry) -> str:
    """Return the side on which an entry acts, or "" if both sides do the same.

    The entry's name decides ("limping on the left leg"), else the only leg it defines, else the limb that is not idle.
    """
    legs = [part.removesuffix("_leg") for part in entry.defines if part.endswith("_leg")]
    spoken = SIDE.findall(entry.prompt) or (legs if len(legs) == 1 else [])
    if spoken:
        return only_side(spoken)
    said = entry.descriptions.to_mapping()
    return lame_leg(said) or only_side(side for side in OPPOSITE if not is_idle(said[f"{side}_arm"]))


def is_idle(arm: str) -> bool:
    """Return whether a sentence says only that an arm hangs or swings."""
    return _IDLE_ARM.search(arm) is not None


def lame_leg(said: Mapping[str, str]) -> str:
    """Return the side of the only leg that limps, drags, hops or is stiff, else ""."""
    return only_side(side for side in OPPOSITE if _BUSY_LEG.search(said.get(f"{side}_leg", "")))


def lame_on(entry: LibraryEntry, side: str) -> LibraryEntry:
    """Return the entry, mirrored if it limps on the other side: a pirate dragging the left leg has no wooden right one."""
    return on_side(entry, side) if lame_leg(entry.descriptions.to_mapping()) else entry


def on_side(entry: LibraryEntry, side: str) -> LibraryEntry:
    """Return the entry, mirrored if it acts on the other side."""
    own = entry_side(entry)
    if not side or not own or own == side:
        return entry
    mirrored = {
        part: text.replace("left angle", "right angle")
        for part, text in entry.descriptions.mirrored().to_mapping().items()
    }
    return replace(entry, descriptions=PartDescriptions(**mirrored), defines=_mirrored(entry.defines))


def _mirrored(parts: tuple[str, ...]) -> tuple[str, ...]:
    swapped = {f"{OPPOSITE[p.split('_')[0]]}_{p.split('_')[1]}" if "_" in p else p for p in parts}
    return tuple(part for part in PART_NAMES if part in swapped)
