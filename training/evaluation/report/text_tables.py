"""Tables of the text evaluation as Markdown."""

from __future__ import annotations

from typing import Any

from training.evaluation.text import edits, retrieval
from training.markdown import table

SECTION = "text evaluation"  # of a document, between its markers


def markdown(results: dict[str, Any]) -> str:
    """All tables of `results`, what `--json` holds."""
    lines = [f"`{results['command']}`, model `{results['model']}`", "", *_bars(results)]
    if "retrieval" in results:
        lines += _retrieval(results["retrieval"])
    if "edits" in results:
        lines += [*_edits(results["edits"]), *_independence(results["independence"])]
    return "\n".join(lines) + "\n"


def bars(results: dict[str, Any]) -> list[tuple[str, str, bool | None]]:
    """Every demand: what is required, what was measured, and whether it is met (None: not measured)."""
    found: list[tuple[str, str, bool | None]] = []
    if "retrieval" in results:
        found += _retrieval_bars(results["retrieval"])
    if "edits" in results:
        summary = results["edits"]["summary"]
        found += _edit_bars("zero-shot part edits", summary["zero-shot"], (edits.RIGHT_BAR, edits.ENOUGH_BAR))
        if edits.HELD_OUT_RHYTHM in summary:
            bars_of_rhythm = (edits.RHYTHM_RIGHT_BAR, edits.RHYTHM_ENOUGH_BAR)
            name = "held-out edits of rhythm and weight"
            found += _edit_bars(name, summary[edits.HELD_OUT_RHYTHM], bars_of_rhythm)
        ratio = results["independence"]["by_slot"]["all"]["ratio"]
        name = f"other parts change by at most {100 * edits.BAR:.0f} % of the described part's change"
        found.append((name, f"{100 * ratio:.0f} %", ratio <= edits.BAR))
    return found


def _edit_bars(
    name: str, scores: dict[str, float], least: tuple[float, float]
) -> list[tuple[str, str, bool | None]]:
    demands = (
        ("right_way", "change the described way"),
        ("enough", "reach at least half the described change"),
    )
    return [
        (
            f"{name} that {demand}: at least {100 * bar:.0f} %",
            f"{100 * scores[key]:.0f} % of {scores['cases']}",
            scores[key] >= bar,
        )
        for (key, demand), bar in zip(demands, least, strict=True)
    ]


def _retrieval_bars(scores: dict[str, Any]) -> list[tuple[str, str, bool | None]]:
    found: list[tuple[str, str, bool | None]] = []
    for key, words in (("text_to_motion", "text→motion"), ("motion_to_text", "motion→text")):
        name = f"{words} R@1 on held-out captured clips: at least {100 * retrieval.BAR:.0f} %"
        if "missing" in scores:
            found.append((name, "not measured", None))
        else:
            r1 = scores["original"]["whole"][key]["r1"]
            found.append((name, f"{100 * r1:.0f} %", r1 >= retrieval.BAR))
    return found


def _bars(results: dict[str, Any]) -> list[str]:
    words = {True: "yes", False: "**no**", None: "–"}
    return table(["Bar", "Measured", "Met"], [[n, m, words[ok]] for n, m, ok in bars(results)])


def _retrieval(scores: dict[str, Any]) -> list[str]:
    lines = ["### Retrieval", ""]
    if "missing" in scores:
        return [*lines, scores["missing"], ""]
    rows = []
    names = {
        "text_to_motion": "text→motion",
        "motion_to_text": "motion→text",
        "text_to_motion_alike": "text→motion, look-alike styles as one",
        "motion_to_text_alike": "motion→text, look-alike styles as one",
    }
    for side in ("original", "mirrored"):
        for key, name in names.items():
            for compared, label in (("whole", "Eq. 2"), ("parts", "mean of parts")):
                rows.append(_recall_row(f"{name}, {side}", label, scores[side][compared][key]))
    head = ["", "compared by", "queries", "gallery", "R@1", "R@3", "median rank", "R@1, mean over styles"]
    lines += [*table(head, rows), "Chance stands in brackets.", ""]
    return lines


def _recall_row(name: str, compared: str, found: dict[str, float]) -> list[str]:
    return [
        name,
        compared,
        f"{found['queries']}",
        f"{found['gallery']}",
        f"{100 * found['r1']:.0f} % ({100 * found['chance_r1']:.0f})",
        f"{100 * found['r3']:.0f} % ({100 * found['chance_r3']:.0f})",
        f"{found['median_rank']:g} ({found['chance_rank']:g})",
        f"{100 * found['r1_by_style']:.0f} %",
    ]


def _edits(found: dict[str, Any]) -> list[str]:
    lines = ["### Part edits", ""]
    rows = [
        [
            kind,
            f"{s['cases']}",
            f"{100 * s['right_way']:.0f} %",
            f"{100 * s['enough']:.0f} %",
            f"{s['median_fraction']:.2f}",
            f"{100 * s['runs_right_way']:.0f} %",
            f"{100 * s['runs_enough']:.0f} %",
        ]
        for kind, s in found["summary"].items()
    ]
    head = ["", "cases", "right way", "at least half", "median fraction", "of single walks", "at least half"]
    lines += table(head, rows)
    for kind, title in (
        ("held out", "Held-out edits"),
        ("pair", "Held-out pairs"),
        (edits.HELD_OUT_RHYTHM, "Held-out edits of rhythm and weight"),
        ("free words", "Free words"),
        ("trained", "Trained edits"),
        (edits.TRAINED_RHYTHM, "Trained edits of rhythm and weight"),
    ):
        rows = [_edit_row(r) for r in found["rows"] if r["kind"] == kind]
        if rows:
            last = "words that the library made of it" if kind == "free words" else "walks right / half"
            lines += [f"{title}:", ""]
            lines += table(
                [" ", "measure: described → measured", "fraction", "right way", "half", last], rows
            )
    if found["unmeasured"]:
        names = ", ".join(found["unmeasured"])
        lines += [
            f"Not scored, as captured walks disagree about what the edit does to its measure: {names}.",
            "",
        ]
    return lines


def _edit_row(row: dict[str, Any]) -> list[str]:
    changes = [
        f"{name} {_signed(row['described'][name])} → {_signed(row['change'][name])}"
        for name in row["described"]
    ]
    words = {True: "yes", False: "no"}
    last = f"{100 * row['runs_right_way']:.0f} % / {100 * row['runs_enough']:.0f} %"
    if row["kind"] == "free words":
        last = "; ".join(row["words"].values())
    noisy = "†" if row["seed_noise"] > edits.RIGHT_WAY else ""
    return [
        row["name"],
        "; ".join(changes),
        f"{row['worst_fraction']:.2f}{noisy}",
        words[row["right_way"]],
        words[row["enough"]],
        last,
    ]


def _signed(value: float) -> str:
    return f"{value:+.1f}°" if abs(value) >= 3.0 else f"{value:+.2f}"


def _independence(found: dict[str, Any]) -> list[str]:
    rows = [
        [
            slot,
            f"{s['edits']}",
            f"{s['own']:.1f}°",
            f"{s['others']:.1f}°",
            f"{s['seed_others']:.1f}°",
            f"{100 * s['ratio']:.0f} % ({100 * s['edit_ratio']:.0f})",
            f"{100 * s['within']:.0f} %",
            f"{100 * s['most_ratio']:.0f} % ({100 * s['edit_most_ratio']:.0f})",
        ]
        for slot, s in found["by_slot"].items()
    ]
    head = [
        "part",
        "edits",
        "its change",
        "the others'",
        "the others' between two seeds",
        "ratio",
        "edits within 25 %",
        "the other part that changes most",
    ]
    seeds = ", ".join(f"{part.replace('_', ' ')} {change:.1f}°" for part, change in found["seeds"].items())
    note = (
        "In brackets what the edits themselves do when they are applied to captured walks. "
        f"Two seeds of the neutral prompt differ, in the same measure, by: {seeds}."
    )
    return ["### Part independence", "", *table(head, rows), note, ""]
