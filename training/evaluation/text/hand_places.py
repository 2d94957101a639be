"""Where hands are that words put somewhere: beside the exact edit, for the left hand, the right one and both.

    python -m training.evaluation hands --model compact --model open --markdown docs/results/hands.md

Each place of the catalogue (hip, pocket, head, behind the back, ...) is asked for in its first words on an otherwise neutral walk. The exact
edit of the model's own neutral walk says where the hand and the elbow belong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.prompts.parts import PartDescriptions
from training.evaluation.experiment import Experiment, Setting
from training.evaluation.motion.subject import Subject
from training.evaluation.text.command import PLAIN_PROMPT
from training.evaluation.text.phrase_shares import hand_place, neutral_motion
from training.evaluation.text.walks import Walk, Walker
from training.layering.apply import apply
from training.layering.catalog import EDITS, HELD_OUT
from training.layering.catalog_arms import ARM
from training.layering.measured_edits import Summary, summarise
from training.markdown import number, table

SECONDS = 4.0
NEAR_CM, BENT_DEGREES = (
    15.0,
    30.0,
)  # a hand that is farther from its place, an elbow that is bent otherwise, is counted
SIDES = ("left", "right")
PLACES = tuple(name for name, (parameters, *_) in ARM.items() if "wave" not in parameters)


@dataclass(frozen=True)
class Missed:
    """Of one arm: how far the hand is from where the edit puts it (cm), and the elbow's difference in bend (degrees)."""

    hand: float
    elbow: float

    @property
    def near(self) -> bool:
        """Whether it counts as there."""
        return self.hand <= NEAR_CM and abs(self.elbow) <= BENT_DEGREES


def missed(side: str, walked: Summary, edited: Summary) -> Missed:
    """Of a walk under words, against the exact edit of the neutral walk."""
    arm = f"{side}_arm"
    away: Array = hand_place(walked, arm) - hand_place(edited, arm)
    bend = getattr(walked.body, arm).elbow_bend - getattr(edited.body, arm).elbow_bend
    return Missed(100.0 * float(np.linalg.norm(away)), float(bend))


def asked_for(place: str, sides: tuple[str, ...], neutral: PartDescriptions) -> PartDescriptions:
    """The neutral words with one or both hands at a place."""
    words = neutral
    for side in sides:
        arm = f"{side}_arm"
        words = words.replace(arm, EDITS[f"{arm}.{place}"].phrases[arm][0])
    return words


def hands(setting: Setting) -> dict[str, Any]:
    """Of every model, by place: what each hand misses alone, and with the other."""
    return {subject.name: _measured(subject) for subject in setting.subjects}


def _measured(subject: Subject) -> dict[str, Any]:
    neutral = subject.prompter.expand(PLAIN_PROMPT).descriptions
    motion = neutral_motion(subject.model, subject.prompter(neutral))
    walker = Walker(subject.folder, seconds=SECONDS)
    result: dict[str, Any] = {}
    for place in PLACES:
        edited = {}
        for side in SIDES:
            changed = apply(motion, EDITS[f"{side}_arm.{place}"], np.random.default_rng(0))
            edited[side] = summarise(changed.hips, changed.local, changed.contacts)
        words = [asked_for(place, sides, neutral) for sides in (("left",), ("right",), SIDES)]
        left, right, both = walker.make([Walk.of(subject.prompter(w), 0) for w in words])
        found = {
            "left": missed("left", left, edited["left"]),
            "right": missed("right", right, edited["right"]),
            "left of both": missed("left", both, edited["left"]),
            "right of both": missed("right", both, edited["right"]),
        }
        result[place] = {name: vars(one) for name, one in found.items()}
    return result


COLUMNS = ("left", "right", "left of both", "right of both")


def hands_table(results: dict[str, Any]) -> str:
    """A row for each place, and how many hands are there."""
    lines: list[str] = []
    for model, places in results.items():
        rows, near = [], dict.fromkeys(COLUMNS, 0)
        for place, found in places.items():
            held_out = [s for s in SIDES if f"{s}_arm.{place}" in HELD_OUT]
            mark = f" ({', '.join(held_out)} never trained)" if held_out else ""
            rows.append([place.replace("_", " ") + mark, *(_cell(Missed(**found[c])) for c in COLUMNS)])
            for column in COLUMNS:
                near[column] += Missed(**found[column]).near
        rows.append(
            [
                f"within {NEAR_CM:.0f} cm and {BENT_DEGREES:.0f} degrees",
                *(f"{near[c]} of {len(places)}" for c in COLUMNS),
            ]
        )
        lines += table([model, *COLUMNS], rows)
    return "\n".join(lines)


def _cell(one: Missed) -> str:
    text = f"{number(one.hand, 0)} cm, {one.elbow:+.0f}°"
    return text if one.near else f"**{text}**"


HANDS = Experiment(
    "Where are hands that words put somewhere? Beside the exact edit, left, right and both.",
    hands,
    hands_table,
    "hands",
    models=2,
)
