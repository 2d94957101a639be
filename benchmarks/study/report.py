"""Report on the participants' answers, with the tests of Sec. IV-D.

Counts of the five ratings (Fig. 10), means with deviation (Fig. 11), Kruskal-Wallis, Bartlett, one-way repeated-measures
ANOVA over participants and Tukey's HSD. Files marked as synthetic are rejected unless an option accepts them; the first
line of the report then says so.

Answers are a data frame with a row per film and participant: `participant`, `clip`, `method`, `kind`, `title`,
`rating` (the later one if a film was shown again) and `again`.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas
from scipy import stats
from statsmodels.stats.anova import AnovaRM
from statsmodels.stats.multicomp import pairwise_tukeyhsd

from benchmarks.study.make import CAPTURE, FORMAT
from runtime.errors import FileError, UsageError
from runtime.safe_read import is_text, parse_json, read_bounded
from training.markdown import number, table

STEPS = ("Extremely unsatisfied", "Unsatisfied", "Mediocre", "Satisfied", "Highly satisfied")
COLOURS = ("#c92a2a", "#f08c00", "#ced4da", "#74b816", "#2b8a3e")
AGAIN_AT = 2
MAX_BYTES = 16 * 1024 * 1024  # of a participant's file, or of the key
REMEDY = "Use files that the study's page wrote."


def read_answers(files: Sequence[Path], key: Path, synthetic: bool = False) -> pandas.DataFrame:
    """Read the answers of one study; FileError or UsageError names the file and the problem."""
    secret = _read(key)
    if not _is_key(secret):
        raise FileError(
            f"{key}: not the key of a study.",
            "Give the key.json that `python -m benchmarks.study make` wrote.",
        )
    rows: list[dict[str, Any]] = []
    known: dict[str, Path] = {}
    marked = False
    for file in files:
        content = _read_participant(file, secret.get("study"))
        marked |= bool(content.get("synthetic"))
        if marked and not synthetic:
            raise UsageError(f"{file}: marked as synthetic.", "Add --synthetic to try the report with it.")
        who = str(content.get("participant"))
        if who in known:
            raise UsageError(f"{file}: the participant of {known[who]} again.", "Give each file once.")
        known[who] = file
        rows += [{"participant": who, **row} for row in _ratings(file, content["answers"], secret["clips"])]
    if not rows:
        raise UsageError("No answers.", "Give the files that participants downloaded.")
    answers = pandas.DataFrame(rows).drop_duplicates(["participant", "clip"], keep="last")
    answers["method"] = pandas.Categorical(answers["method"], secret["methods"]).remove_unused_categories()
    answers.attrs["synthetic"] = marked
    return answers


def _is_key(secret: dict[str, Any]) -> bool:
    """Return whether all films of a key are described, each with one of its methods."""
    methods, clips = secret.get("methods"), secret.get("clips")
    if secret.get("format") != f"{FORMAT}-key" or not (isinstance(methods, list) and isinstance(clips, dict)):
        return False
    distinct = all(map(is_text, methods)) and len(set(methods)) == len(methods)
    return distinct and all(_is_film(clip, methods) for clip in clips.values())


def _is_film(clip: Any, methods: list[str]) -> bool:
    return (
        isinstance(clip, dict)
        and clip.get("method") in methods
        and all(is_text(clip.get(name)) for name in ("kind", "title"))
    )


def _read_participant(file: Path, study: Any) -> dict[str, Any]:
    content = _read(file)
    whole = isinstance(content.get("answers"), list) and is_text(str(content.get("participant")))
    if content.get("format") != f"{FORMAT}-answers" or not whole:
        raise FileError(f"{file}: not the answers of a participant.", REMEDY)
    if content.get("study") != study:
        raise FileError(f"{file}: answers of another study.", "Give the key of that study.")
    return content


def _ratings(file: Path, answers: list[Any], clips: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a row per answer of a file, repeated films last."""
    rows = []
    for answer in answers:
        try:
            clip, rating, again = str(answer["clip"]), answer["rating"], bool(answer["again"])
            about = {name: clips[clip][name] for name in ("method", "kind", "title")}
        except (KeyError, TypeError) as error:
            raise FileError(f"{file}: an answer about an unknown film.", REMEDY) from error
        if type(rating) is not int or not 1 <= rating <= 5:
            raise FileError(f"{file}: the rating {str(rating)[:20]} of {clip}: expected 1 to 5.", REMEDY)
        rows.append({"clip": clip, **about, "rating": rating, "again": again})
    return sorted(rows, key=lambda row: row["again"])


def _read(path: Path) -> dict[str, Any]:
    try:
        content = parse_json(read_bounded(path, MAX_BYTES, REMEDY))
    except ValueError as error:
        raise FileError(f"{path}: not a readable JSON file.", REMEDY) from error
    if not isinstance(content, dict):
        raise FileError(f"{path}: not a JSON object.", REMEDY)
    return content


def parts_of(answers: pandas.DataFrame) -> dict[str, pandas.DataFrame]:
    """Return all films, and those of each kind if there are two."""
    kinds = dict(tuple(answers.groupby("kind")))
    return {"all": answers, **(kinds if len(kinds) > 1 else {})}


def significance(answers: pandas.DataFrame) -> dict[str, Any]:
    """Return Kruskal-Wallis and Bartlett on ratings, ANOVA on participants' means, and Tukey's HSD; empty for too few."""
    means = answers.pivot_table("rating", "participant", "method", observed=True).dropna()
    groups = [answers.rating[answers.method == method].astype(float) for method in means]
    if len(groups) < 2 or len(means) < 2 or min(map(len, groups)) < 2:
        return {}
    found: dict[str, Any] = {}
    if answers.rating.nunique() > 1:
        found["kruskal_wallis"] = stats.kruskal(*groups)
    if all(group.nunique() > 1 for group in groups):
        found["bartlett"] = stats.bartlett(*groups)
    rest = means.sub(means.mean(axis=1), axis=0) - means.mean() + means.to_numpy().mean()
    if np.ptp(rest.to_numpy()) < 1e-12:
        return found  # no variance left to test
    long = means.melt(ignore_index=False, value_name="rating").reset_index()
    long["method"] = long["method"].astype(str)
    row = AnovaRM(long, "rating", "participant", within=["method"]).fit().anova_table.iloc[0]
    tukey = pairwise_tukeyhsd(long["rating"], long["method"])
    pairs = itertools.combinations(tukey.groupsunique, 2)
    found["anova"] = {
        "participants": len(means),
        **{"F": row["F Value"], "df": (row["Num DF"], row["Den DF"]), "p": row["Pr > F"]},
    }
    found["tukey"] = [
        {"pair": pair, "difference": difference, "p": p, "interval": interval}
        for pair, difference, p, interval in zip(
            pairs, tukey.meandiffs, tukey.pvalues, tukey.confint, strict=True
        )
    ]
    return found


def markdown(answers: pandas.DataFrame) -> str:
    """Return the report as Markdown."""
    synthetic = answers.attrs["synthetic"]
    lines = ["**Synthetic answers: a trial of the report, no result.**", ""] if synthetic else []
    low = answers[answers.again & (answers.method == CAPTURE) & (answers.rating <= AGAIN_AT)]
    lines += [
        f"{answers.participant.nunique()} participants, {len(answers)} ratings; {answers.again.sum()} films of capture"
        f" were rated {AGAIN_AT} or less and shown again, {len(low)} of them rated so again.",
        "",
    ]
    for name, part in parts_of(answers).items():
        by_title = part.pivot_table("rating", "title", "method", observed=True)
        lines += [f"### {name.capitalize()}", "", *_counts(part)]
        lines += table(
            ["mean rating", *by_title],
            [[str(title), *(number(v, 2) for v in means)] for title, means in by_title.iterrows()],
        )
        lines += [*_tests(significance(part)), ""]
    return "\n".join(lines) + "\n"


def _counts(part: pandas.DataFrame) -> list[str]:
    rows = []
    for method, ratings in part.groupby("method", observed=True)["rating"]:
        fractions = [f"{100.0 * (ratings == step).mean():.1f} %" for step in range(1, 6)]
        spread = f"{ratings.mean():.2f} ± {ratings.std() if len(ratings) > 1 else 0.0:.2f}"
        rows.append([str(method), str(len(ratings)), *fractions, spread])
    return table(["method", "ratings", *STEPS, "mean ± deviation"], rows)


def _tests(found: dict[str, Any]) -> list[str]:
    if not found:
        return ["Too few ratings for a test."]
    lines = []
    for name, title, letter in (("kruskal_wallis", "Kruskal-Wallis", "H"), ("bartlett", "Bartlett", "T")):
        if name in found:
            lines.append(f"- {title}: {letter} = {found[name].statistic:.2f}, {_p(found[name].pvalue)}")
    if "anova" in found:
        a = found["anova"]
        test = f"F({a['df'][0]:.0f}, {a['df'][1]:.0f}) = {a['F']:.2f}, {_p(a['p'])}"
        lines.append(f"- repeated-measures ANOVA over {a['participants']} participants: {test}")
    for pair in found.get("tukey", ()):
        (first, second), (low, high) = pair["pair"], pair["interval"]
        interval = f"{pair['difference']:+.2f} ({low:+.2f} to {high:+.2f}), {_p(pair['p'])}"
        lines.append(f"- Tukey HSD, {second} − {first}: {interval}")
    return lines


def _p(value: float) -> str:
    return "p < 0.001" if value < 0.001 else f"p = {value:.3f}"


def draw_bars(answers: pandas.DataFrame, out: Path) -> list[Path]:
    """Draw `fig10_responses.png`, fractions of the five ratings, and `fig11_means.png`, means with deviation."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    out.mkdir(parents=True, exist_ok=True)
    parts = parts_of(answers)
    paths = [out / "fig10_responses.png", out / "fig11_means.png"]
    figure, axes = pyplot.subplots(1, len(parts), figsize=(5.2 * len(parts), 2.6), squeeze=False)
    for axis, (name, part) in zip(axes[0], parts.items(), strict=True):
        counts = pandas.crosstab(part["method"], part["rating"], normalize="index").mul(100.0)
        counts = counts.reindex(columns=range(1, 6), fill_value=0.0).set_axis(list(STEPS), axis=1)
        counts[::-1].plot.barh(ax=axis, stacked=True, color=COLOURS, legend=False, ylabel="")
        axis.set(title=name, xlim=(0, 100), xlabel="% of ratings")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=5, frameon=False, fontsize=8)
    figure.tight_layout(rect=(0, 0.1, 1, 1))
    figure.savefig(paths[0], dpi=110)
    figure, axes = pyplot.subplots(1, len(parts), figsize=(3.6 * len(parts), 3.2), squeeze=False, sharey=True)
    for axis, (name, part) in zip(axes[0], parts.items(), strict=True):
        ratings = part.groupby("method", observed=True)["rating"]
        ratings.mean().plot.bar(ax=axis, yerr=ratings.std(), capsize=4, color="#4dabf7", rot=20, xlabel="")
        axis.set(title=name, ylim=(1, 5), ylabel="mean rating")
    figure.tight_layout()
    figure.savefig(paths[1], dpi=110)
    pyplot.close("all")
    return paths
