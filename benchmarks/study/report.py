"""What participants answered, with the tests of Sec. IV-D.

Counts of the five steps (Fig. 10), means with deviation (Fig. 11), one-way repeated-measures ANOVA over participants, Tukey's HSD,
and before them Kruskal-Wallis and Bartlett. Nothing here makes an answer up: files marked as synthetic are refused unless they are
asked for, and then the report says so in its first line.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.study.make import CAPTURE, FORMAT
from runtime.arrays import Array
from runtime.errors import FileError, UsageError

STEPS = ("Extremely unsatisfied", "Unsatisfied", "Mediocre", "Satisfied", "Highly satisfied")
AGAIN_AT = 2
REMEDY = "Use files that the study's page wrote."


@dataclass(frozen=True)
class Rating:
    """One film by one participant, the later answer where it was shown again."""

    participant: str
    clip: str
    method: str
    kind: str
    title: str
    rating: int
    again: bool


@dataclass(frozen=True)
class Answers:
    """All ratings of a study."""

    methods: tuple[str, ...]
    ratings: tuple[Rating, ...]
    synthetic: bool

    @property
    def participants(self) -> list[str]:
        """Their random names, sorted."""
        return sorted({r.participant for r in self.ratings})

    def of(self, method: str, kind: str | None = None) -> list[int]:
        """Ratings of a method, of one kind of film or of all."""
        return [r.rating for r in self.ratings if r.method == method and kind in (None, r.kind)]

    def table(self, kind: str | None) -> tuple[Array, list[str], list[str]]:
        """Mean rating `(P, M)` by participant and method, of those who rated every method; with both names."""
        names = [m for m in self.methods if self.of(m, kind)]
        rows, kept = [], []
        for participant in self.participants:
            own = [
                [
                    r.rating
                    for r in self.ratings
                    if r.participant == participant and r.method == m and kind in (None, r.kind)
                ]
                for m in names
            ]
            if all(own):
                rows.append([float(np.mean(values)) for values in own])
                kept.append(participant)
        return np.array(rows).reshape(len(rows), len(names)), kept, names


def read_answers(files: Sequence[Path], key: Path, synthetic: bool = False) -> Answers:
    """The answers of one study; FileError or UsageError names the file and what is wrong with it."""
    secret = _read(key)
    clips, study = secret.get("clips"), secret.get("study")
    if secret.get("format") != f"{FORMAT}-key" or not isinstance(clips, dict):
        raise FileError(
            f"{key}: not the key of a study.",
            "Name the key.json that `python -m benchmarks.study make` wrote.",
        )
    ratings: list[Rating] = []
    known: dict[str, Path] = {}
    marked = False
    for file in files:
        content = _read(file)
        if content.get("format") != f"{FORMAT}-answers" or not isinstance(content.get("answers"), list):
            raise FileError(f"{file}: not the answers of a participant.", REMEDY)
        if content.get("study") != study:
            raise FileError(f"{file}: answers of another study.", "Name the key of that study.")
        if content.get("synthetic") and not synthetic:
            raise UsageError(f"{file}: marked as synthetic.", "Add --synthetic to try the report with it.")
        marked |= bool(content.get("synthetic"))
        who = str(content.get("participant"))
        if who in known:
            raise UsageError(f"{file}: the participant of {known[who]} again.", "Give each file once.")
        known[who] = file
        ratings += _ratings(file, who, content["answers"], clips)
    if not ratings:
        raise UsageError("No answers.", "Give the files that participants downloaded.")
    return Answers(tuple(secret["methods"]), tuple(ratings), marked)


def _ratings(file: Path, who: str, answers: list[Any], clips: dict[str, Any]) -> list[Rating]:
    """The last rating of every film."""
    last: dict[str, Rating] = {}
    for answer in answers:
        try:
            clip, rating, again = str(answer["clip"]), answer["rating"], bool(answer["again"])
            about = clips[clip]
        except (KeyError, TypeError) as error:
            raise FileError(f"{file}: an answer about no film of this study.", REMEDY) from error
        if type(rating) is not int or not 1 <= rating <= 5:
            raise FileError(f"{file}: the rating {str(rating)[:20]} of {clip}: expected 1 to 5.", REMEDY)
        if clip not in last or again:
            last[clip] = Rating(who, clip, about["method"], about["kind"], about["title"], rating, again)
    return list(last.values())


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: not a readable JSON file.", REMEDY) from error
    if not isinstance(content, dict):
        raise FileError(f"{path}: not a JSON object.", REMEDY)
    return content


# --- figures ----------------------------------------------------------------------------------------------------------


def analyse(answers: Answers) -> dict[str, Any]:
    """All figures as plain data: of all films, of obstacles and of styles."""
    kinds = [k for k in ("obstacle", "style") if any(r.kind == k for r in answers.ratings)]
    return {
        "synthetic": answers.synthetic,
        "participants": len(answers.participants),
        "ratings": len(answers.ratings),
        "shown_again": sum(r.again for r in answers.ratings),
        "still_low": sum(r.again and r.rating <= AGAIN_AT and r.method == CAPTURE for r in answers.ratings),
        "parts": {
            part or "all": _part(answers, part) for part in ([None, *kinds] if len(kinds) > 1 else [None])
        },
    }


def _part(answers: Answers, kind: str | None) -> dict[str, Any]:
    methods = {}
    for method in answers.methods:
        values = answers.of(method, kind)
        if values:
            methods[method] = {
                "ratings": len(values),
                "counts": [values.count(step) for step in range(1, 6)],
                "mean": float(np.mean(values)),
                "deviation": float(np.std(values, ddof=1)) if len(values) > 1 else 0.0,
            }
    titles = sorted({r.title for r in answers.ratings if kind in (None, r.kind)})
    by_title = {
        title: {
            m: float(np.mean(values))
            for m in methods
            if (values := [r.rating for r in answers.ratings if (r.title, r.method) == (title, m)])
        }
        for title in titles
    }
    return {"methods": methods, "by_title": by_title, "tests": significance(answers, kind)}


def significance(answers: Answers, kind: str | None = None) -> dict[str, Any]:
    """Kruskal-Wallis and Bartlett over ratings, ANOVA over participants' means, and Tukey's HSD; empty where too few rated."""
    table, _, names = answers.table(kind)
    groups = [np.array(answers.of(m, kind), float) for m in names]
    if len(names) < 2 or len(table) < 2 or min(map(len, groups)) < 2:
        return {}
    from scipy import stats

    found: dict[str, Any] = {}
    if len({float(v) for g in groups for v in g}) > 1:
        kruskal = stats.kruskal(*groups)
        found["kruskal_wallis"] = {"H": float(kruskal.statistic), "p": float(kruskal.pvalue)}
    if all(g.std() > 0 for g in groups):
        bartlett = stats.bartlett(*groups)
        found["bartlett"] = {"T": float(bartlett.statistic), "p": float(bartlett.pvalue)}
    found |= repeated_measures(table, names)
    return found


def repeated_measures(table: Array, names: Sequence[str]) -> dict[str, Any]:
    """One-way repeated-measures ANOVA of `(P, M)` by statsmodels, and Tukey's HSD of the same values."""
    import pandas
    from statsmodels.stats.anova import AnovaRM
    from statsmodels.stats.multicomp import pairwise_tukeyhsd

    participants, methods = np.indices(table.shape)
    frame = pandas.DataFrame(
        {
            "rating": table.ravel(),
            "participant": participants.ravel(),
            "method": np.array(names)[methods.ravel()],
        }
    )
    if np.ptp(table - table.mean(1, keepdims=True) - table.mean(0) + table.mean()) < 1e-12:
        return {}  # nothing is left to test against
    row = AnovaRM(frame, "rating", "participant", within=["method"]).fit().anova_table.iloc[0]
    tukey = pairwise_tukeyhsd(frame["rating"], frame["method"])
    pairs = itertools.combinations(tukey.groupsunique, 2)
    return {
        "participants": len(table),
        "anova": {
            "F": float(row["F Value"]),
            "df": [float(row["Num DF"]), float(row["Den DF"])],
            "p": float(row["Pr > F"]),
        },
        "tukey": [
            {
                "pair": [str(a), str(b)],
                "difference": float(d),
                "p": float(p),
                "interval": [float(low), float(high)],
            }
            for (a, b), d, p, (low, high) in zip(
                pairs, tukey.meandiffs, tukey.pvalues, tukey.confint, strict=True
            )
        ],
    }


# --- tables and bars --------------------------------------------------------------------------------------------------


def markdown(found: dict[str, Any]) -> str:
    """The report as Markdown."""
    lines = ["**Synthetic answers: a trial of the report, no result.**", ""] if found["synthetic"] else []
    lines += [
        f"{found['participants']} participants, {found['ratings']} ratings; {found['shown_again']} films of capture were rated "
        f"{AGAIN_AT} or less and shown again, {found['still_low']} of them rated so again.",
        "",
    ]
    for part, values in found["parts"].items():
        lines += [
            f"### {part[0].upper()}{part[1:]}",
            "",
            *_counts(values["methods"]),
            *_titles(values["by_title"]),
        ]
        lines += _tests(values["tests"])
    return "\n".join(lines) + "\n"


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _counts(methods: dict[str, Any]) -> list[str]:
    rows = []
    for name, m in methods.items():
        shares = [f"{100.0 * n / m['ratings']:.1f} %" for n in m["counts"]]
        rows.append(_row([name, str(m["ratings"]), *shares, f"{m['mean']:.2f} ± {m['deviation']:.2f}"]))
    head = ["method", "ratings", *STEPS, "mean ± deviation"]
    return [_row(head), "|" + " --- |" * len(head), *rows, ""]


def _titles(by_title: dict[str, dict[str, float]]) -> list[str]:
    names = list(dict.fromkeys(n for means in by_title.values() for n in means))
    rows = [
        _row([title, *(f"{means[n]:.2f}" if n in means else "–" for n in names)])
        for title, means in by_title.items()
    ]
    return [_row(["mean rating", *names]), "|" + " --- |" * (1 + len(names)), *rows, ""]


def _tests(found: dict[str, Any]) -> list[str]:
    if not found:
        return ["Too few ratings for a test.", ""]
    lines = []
    if "kruskal_wallis" in found:
        k = found["kruskal_wallis"]
        lines.append(f"- Kruskal-Wallis: H = {k['H']:.2f}, {_p(k['p'])}")
    if "bartlett" in found:
        b = found["bartlett"]
        lines.append(f"- Bartlett: T = {b['T']:.2f}, {_p(b['p'])}")
    if "anova" in found:
        a = found["anova"]
        lines.append(
            f"- repeated-measures ANOVA over {found['participants']} participants: F({a['df'][0]:.0f}, {a['df'][1]:.0f}) = {a['F']:.2f}, "
            f"{_p(a['p'])}"
        )
        for pair in found["tukey"]:
            low, high = pair["interval"]
            lines.append(
                f"- Tukey HSD, {pair['pair'][1]} − {pair['pair'][0]}: {pair['difference']:+.2f} ({low:+.2f} to {high:+.2f}), {_p(pair['p'])}"
            )
    return [*lines, ""]


def _p(value: float) -> str:
    return "p < 0.001" if value < 0.001 else f"p = {value:.3f}"


def draw_bars(found: dict[str, Any], out: Path) -> list[Path]:
    """`fig10_responses.png`: shares of the five steps; `fig11_means.png`: means with deviation."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    out.mkdir(parents=True, exist_ok=True)
    parts = found["parts"]
    colours = ("#c92a2a", "#f08c00", "#ced4da", "#74b816", "#2b8a3e")
    figure, axes = pyplot.subplots(1, len(parts), figsize=(5.2 * len(parts), 2.6), squeeze=False)
    for axis, (part, values) in zip(axes[0], parts.items(), strict=True):
        names = list(values["methods"])[::-1]
        left = np.zeros(len(names))
        for step, (label, colour) in enumerate(zip(STEPS, colours, strict=True)):
            m = [values["methods"][n] for n in names]
            share = np.array([100.0 * v["counts"][step] / v["ratings"] for v in m])
            axis.barh(names, share, left=left, color=colour, label=label)
            left += share
        axis.set(title=part, xlim=(0, 100), xlabel="% of ratings")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=5, frameon=False, fontsize=8)
    figure.tight_layout(rect=(0, 0.1, 1, 1))
    paths = [out / "fig10_responses.png", out / "fig11_means.png"]
    figure.savefig(paths[0], dpi=110)
    pyplot.close(figure)
    figure, axes = pyplot.subplots(1, len(parts), figsize=(3.6 * len(parts), 3.2), squeeze=False, sharey=True)
    for axis, (part, values) in zip(axes[0], parts.items(), strict=True):
        m = values["methods"]
        means, spread = [v["mean"] for v in m.values()], [v["deviation"] for v in m.values()]
        axis.bar(list(m), means, yerr=spread, capsize=4, color="#4dabf7")
        axis.set(title=part, ylim=(1, 5), ylabel="mean rating")
        axis.tick_params(axis="x", labelrotation=20)
    figure.tight_layout()
    figure.savefig(paths[1], dpi=110)
    pyplot.close(figure)
    return paths
