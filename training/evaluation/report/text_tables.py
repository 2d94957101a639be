"""Tables of the text evaluation as Markdown."""

from __future__ import annotations

from typing import Any

from training.evaluation.text import edits, retrieval
from training.markdown import percent, table

SECTION = "text evaluation"  # of a document, between its markers
Bar = tuple[
    str, str, bool | None
]  # what is required, what was measured, and whether it is met (None: not measured)
DIRECTIONS = {"text_to_motion": "text→motion", "motion_to_text": "motion→text"}
KINDS = {
    "held out": "Held-out edits",
    "pair": "Held-out pairs",
    edits.HELD_OUT_RHYTHM: "Held-out edits of rhythm and weight",
    "free words": "Free words",
    "trained": "Trained edits",
    edits.TRAINED_RHYTHM: "Trained edits of rhythm and weight",
}


def markdown(results: dict[str, Any]) -> str:
    """All tables of `results`, what `--json` holds."""
    met = {True: "yes", False: "**no**", None: "–"}
    rows = [[required, measured, met[ok]] for required, measured, ok in bars(results)]
    lines = [f"`{results['command']}`, model `{results['model']}`", ""]
    lines += table(["Bar", "Measured", "Met"], rows)
    if "retrieval" in results:
        lines += ["### Retrieval", "", *_retrieval(results["retrieval"])]
    if "edits" in results:
        lines += ["### Part edits", "", *_edits(results["edits"])]
        lines += ["### Part independence", "", *_independence(results["independence"])]
    return "\n".join(lines) + "\n"


def bars(results: dict[str, Any]) -> list[Bar]:
    """Every demand."""
    found: list[Bar] = []
    for key, words in DIRECTIONS.items() if "retrieval" in results else ():
        r1 = results["retrieval"].get(key, {}).get("r1")
        name = f"{words} R@1 on held-out captured clips: at least {percent(retrieval.BAR)}"
        found.append(
            (name, "not measured" if r1 is None else percent(r1), None if r1 is None else r1 >= retrieval.BAR)
        )
    if "edits" in results:
        rhythm = (edits.RHYTHM_RIGHT_BAR, edits.RHYTHM_ENOUGH_BAR)
        for kind, name, least in (
            ("zero-shot", "zero-shot part edits", (edits.RIGHT_BAR, edits.ENOUGH_BAR)),
            (edits.HELD_OUT_RHYTHM, "held-out edits of rhythm and weight", rhythm),
        ):
            if kind in results["edits"]["summary"]:
                found += _edit_bars(name, results["edits"]["summary"][kind], least)
        ratio = results["independence"]["by_slot"]["all"]["ratio"]
        name = f"other parts change by at most {percent(edits.BAR)} of the described part's change"
        found.append((name, percent(ratio), ratio <= edits.BAR))
    return found


def _edit_bars(name: str, scores: dict[str, float], least: tuple[float, float]) -> list[Bar]:
    demands = {"right_way": "change the described way", "enough": "reach at least half the described change"}
    return [
        (
            f"{name} that {demand}: at least {percent(bar)}",
            f"{percent(scores[key])} of {scores['cases']}",
            scores[key] >= bar,
        )
        for (key, demand), bar in zip(demands.items(), least, strict=True)
    ]


def _retrieval(scores: dict[str, Any]) -> list[str]:
    if "missing" in scores:
        return [scores["missing"], ""]
    rows = []
    for suffix, words in (("", ""), ("_alike", ", look-alike styles as one")):
        for key, name in DIRECTIONS.items():
            found = scores[key + suffix]
            rows.append(
                [
                    name + words,
                    str(found["queries"]),
                    str(found["gallery"]),
                    f"{percent(found['r1'])} ({100 * found['chance_r1']:.0f})",
                    f"{percent(found['r3'])} ({100 * found['chance_r3']:.0f})",
                    f"{found['median_rank']:g} ({found['chance_rank']:g})",
                    percent(found["r1_by_style"]),
                ]
            )
    head = ["", "queries", "gallery", "R@1", "R@3", "median rank", "R@1, mean over styles"]
    return [*table(head, rows), "Chance stands in brackets.", ""]


def _edits(found: dict[str, Any]) -> list[str]:
    rows = [
        [
            kind,
            str(s["cases"]),
            percent(s["right_way"]),
            percent(s["enough"]),
            f"{s['median_fraction']:.2f}",
            percent(s["runs_right_way"]),
            percent(s["runs_enough"]),
        ]
        for kind, s in found["summary"].items()
    ]
    head = ["", "cases", "right way", "at least half", "median fraction", "of single walks", "at least half"]
    lines = table(head, rows)
    for kind, title in KINDS.items():
        lines += _edits_of(kind, title, [r for r in found["rows"] if r["kind"] == kind])
    if found["unmeasured"]:
        names = ", ".join(found["unmeasured"])
        lines += [
            f"Not scored, as captured walks disagree about what the edit does to its measure: {names}.",
            "",
        ]
    return lines


def _edits_of(kind: str, title: str, rows: list[dict[str, Any]]) -> list[str]:
    if not rows:
        return []
    last = "words that the library made of it" if kind == "free words" else "walks right / half"
    head = [" ", "measure: described → measured", "fraction", "right way", "half", last]
    return [f"{title}:", "", *table(head, [_edit_row(r) for r in rows])]


def _edit_row(row: dict[str, Any]) -> list[str]:
    changes = [f"{n} {_signed(row['described'][n])} → {_signed(row['change'][n])}" for n in row["described"]]
    walks = f"{percent(row['runs_right_way'])} / {percent(row['runs_enough'])}"
    return [
        row["name"],
        "; ".join(changes),
        f"{row['worst_fraction']:.2f}" + ("†" if row["seed_noise"] > edits.RIGHT_WAY else ""),
        *("yes" if row[key] else "no" for key in ("right_way", "enough")),
        "; ".join(row["words"].values()) if row["kind"] == "free words" else walks,
    ]


def _signed(value: float) -> str:
    return f"{value:+.1f}°" if abs(value) >= 3.0 else f"{value:+.2f}"


def _independence(found: dict[str, Any]) -> list[str]:
    rows = [
        [
            slot,
            str(s["edits"]),
            *(f"{s[key]:.1f}°" for key in ("own", "others", "seed_others")),
            f"{percent(s['ratio'])} ({100 * s['edit_ratio']:.0f})",
            percent(s["within"]),
            f"{percent(s['most_ratio'])} ({100 * s['edit_most_ratio']:.0f})",
        ]
        for slot, s in found["by_slot"].items()
    ]
    head = ["part", "edits", "its change", "the others'", "the others' between two seeds", "ratio"]
    head += ["edits within 25 %", "the other part that changes most"]
    seeds = ", ".join(f"{part.replace('_', ' ')} {change:.1f}°" for part, change in found["seeds"].items())
    note = "In brackets what the edits themselves do when they are applied to captured walks. "
    note += f"Two seeds of the neutral prompt differ, in the same measure, by: {seeds}."
    return [*table(head, rows), note, ""]
