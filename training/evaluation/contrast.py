"""Fig. 8: what the contrast of body parts brings over that of the whole body: parts put together, and blends.

    python -m training.evaluation contrast --model RUNS/full/seed0/model --model RUNS/whole-body-contrast/seed0/model \\
        --figures docs/images --markdown docs/results/contrast.md

Each part of a style is asked for on an otherwise neutral body, which no capture shows, and each style is blended with neutral.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from training.evaluation.experiment import Experiment, Setting
from training.evaluation.motion.subject import Subject
from training.evaluation.text.edits import own_and_others, part_changes
from training.evaluation.text.walks import Walk, Walker
from training.layering.measured_edits import Summary
from training.markdown import number, percent, table

NEUTRAL = "neutral"
STYLES = ("aeroplane", "chicken", "drunk", "in_the_dark", "karate_chop", "zombie")
PARTS = ("left_arm", "right_arm", "torso", "head")
BLENDS = (0.25, 0.5, 0.75)
LEAST_CHANGE = 4.0  # degrees by which a style's part differs from neutral's, or there is nothing to ask for
SEED = 1


@dataclass(frozen=True)
class PartAlone:
    """One part of a style on a neutral body, as shares of what the style itself changes in that part."""

    style: str
    part: str
    reached: float  # 1: as in the style, 0: as neutral
    spilt: float  # change of the other parts, over that of the part


@dataclass(frozen=True)
class Blend:
    """A walk in (1 - t) Z(neutral) + t Z(style)."""

    style: str
    share: float  # t
    found: float  # 0: as neutral, 1: as the style


def z_of(subject: Subject, style: str, part: str | None = None) -> Array:
    """Z^t `(6, 64)` of a style, or of neutral with one part in its words."""
    words = subject.texts[style][0]
    if part is not None:
        words = subject.texts[NEUTRAL][0].replace(part, getattr(words, part))
    return subject.prompter(words)


def part_alone(style: str, part: str, neutral: Summary, whole: Summary, alone: Summary) -> PartAlone | None:
    """From three walks; None where the style leaves the part as it is."""
    asked = part_changes(neutral, whole)[part]
    if asked < LEAST_CHANGE:
        return None
    own, others, _ = own_and_others(part_changes(neutral, alone), (part,))
    left = part_changes(whole, alone)[part]
    return PartAlone(style, part, 1.0 - left / asked, others / max(own, 1e-6))


def place_between(neutral: Summary, whole: Summary, blend: Summary) -> float:
    """Where a walk lies between two: 0 at the first, 1 at the second, by the joints' mean change."""
    from_first, from_second = (
        float(np.mean(list(part_changes(end, blend).values()))) for end in (neutral, whole)
    )
    return from_first / max(from_first + from_second, 1e-6)


def measure(subject: Subject, styles: tuple[str, ...]) -> dict[str, Any]:
    """Parts alone and blends of one model, as plain data."""
    walker = Walker(subject.folder)

    def walked(codes: list[Array]) -> list[Summary]:
        return walker.make([Walk.of(z, SEED) for z in codes])

    neutral_z = z_of(subject, NEUTRAL)
    (neutral,) = walked([neutral_z])
    whole_z = {style: z_of(subject, style) for style in styles}
    whole = dict(zip(styles, walked(list(whole_z.values())), strict=True))
    asked = list(product(styles, PARTS))
    alone = walked([z_of(subject, *each) for each in asked])
    parts = [part_alone(*each, neutral, whole[each[0]], s) for each, s in zip(asked, alone, strict=True)]
    between = list(product(styles, BLENDS))
    blended = walked([(1 - t) * neutral_z + t * whole_z[style] for style, t in between])
    return {
        "parts": [vars(p) for p in parts if p is not None],
        "blends": [
            vars(Blend(style, t, place_between(neutral, whole[style], s)))
            for (style, t), s in zip(between, blended, strict=True)
        ],
    }


def _shown(subject: Subject, style: str) -> dict[str, Array]:
    """What Fig. 8 shows of a model, by its title: neutral, a style, and each of the style's parts alone."""
    whole = {name: z_of(subject, name) for name in (NEUTRAL, style)}
    return whole | {f"its {part.replace('_', ' ')} alone": z_of(subject, style, part) for part in PARTS}


def contrast(setting: Setting) -> dict[str, Any]:
    """Every model's figures by its name; draws Fig. 8 with --figures."""
    styles = tuple(setting.args.styles)
    results = {}
    for subject in setting.subjects:
        setting.report(subject.name)
        results[subject.name] = measure(subject, styles)
    if setting.args.figures is not None:
        from training.evaluation.report.contrast_figure import draw

        shown = [(subject, _shown(subject, styles[0])) for subject in setting.subjects]
        draw(setting.args.figures, shown, results, SEED)
    return results


def contrast_table(results: dict[str, Any]) -> str:
    """A row for each model."""
    head = [
        "model",
        "parts asked for alone",
        "share of the style's change that they reach, median",
        "at least half of it",
        "change of the other parts over theirs, median",
        "blends: away from a straight line, mean",
    ]
    rows = []
    for name, found in results.items():
        reached = np.array([p["reached"] for p in found["parts"]])
        away = np.mean([abs(b["found"] - b["share"]) for b in found["blends"]])
        rows.append(
            [
                name,
                str(len(reached)),
                number(float(np.median(reached)), 2),
                percent(float((reached >= 0.5).mean())),
                number(float(np.median([p["spilt"] for p in found["parts"]])), 2),
                number(float(away), 2),
            ]
        )
    return "\n".join(table(head, rows))


CONTRAST = Experiment(
    "Fig. 8: parts of styles put together and blends of styles, by models with and without the contrast of body parts.",
    contrast,
    contrast_table,
    "contrast",
    models=2,
    options=(
        ("--styles", {"nargs": "+", "metavar": "STYLE", "default": list(STYLES)}),
        ("--figures", {"type": Path, "metavar": "DIR", "help": "draw fig8_contrast.png into DIR"}),
    ),
)
