"""`sport evaluate --text`: does the motion do what the words say (Sec. III-C)?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from runtime.assets import asset_path
from runtime.errors import UsageError
from runtime.motion.model import load_model
from runtime.prompts.library_data import load_styles
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.prompter import Prompter
from runtime.prompts.text_encoder import TextEncoder
from training.augmentation.measured_edits import CapturedReference, Summary, load_reference
from training.evaluation import log
from training.evaluation.experiment import CLIPS, MODEL, Arguments, Experiment, Setting, command_of, option
from training.evaluation.text import edits
from training.evaluation.text.edits import Case, by_slot, independence
from training.evaluation.text.retrieval import MIN_RECALL_FRACTION, evaluate_retrieval
from training.evaluation.text.walks import PLAIN_PROMPT, WALK_S, Walk, Walker
from training.markdown import columns, percent, table

PARTS = ("retrieval", "edits")


def words_and_motion(setting: Setting) -> dict[str, Any]:
    """All figures as plain data; equal arguments give equal figures."""
    args, folder = setting.args, setting.folders[0]
    model = load_model(folder)
    prompter = Prompter(model, text_encoder=args.text_encoder)
    command = command_of("sport evaluate --text", args)
    results: dict[str, Any] = {"command": command, "model": model.name}
    if "retrieval" in (args.only or PARTS):
        log.info("retrieval")
        results["retrieval"] = _retrieval(args, folder, prompter.text_encoder)
    if "edits" in (args.only or PARTS):
        results |= _edits(setting, prompter)
    return results


def _retrieval(args: Arguments, folder: Path, words: TextEncoder) -> dict[str, Any]:
    styles = load_styles(asset_path("prompts/styles.json"))
    return evaluate_retrieval(folder, args.clips, {n: list(s.descriptions) for n, s in styles.items()}, words)


def _edits(setting: Setting, prompter: Prompter) -> dict[str, Any]:
    """Part edits and part independence: they look at the same walks."""
    args = setting.args
    reference = load_reference(args.clips)
    neutral = prompter.expand(PLAIN_PROMPT).descriptions
    cases = edits.catalogue_cases(neutral, trained=not args.quick)
    cases += [
        edits.free_case(p, names, prompter.expand(p).descriptions)
        for p, names in edits.free_prompts().items()
    ]
    neutral_walks, walks = _walked(setting, prompter, neutral, cases)
    found = [_case_result(c, own, neutral_walks, reference) for c, own in zip(cases, walks, strict=True)]
    rows = [row for row, _ in found if row is not None]
    independent = [own for _, own in found if own is not None]
    unmeasured = [case.name for case, (row, _) in zip(cases, found, strict=True) if row is None]
    return {
        "edits": {"rows": rows, "unmeasured": unmeasured, "summary": _summaries(rows)},
        "independence": {"rows": independent, "by_slot": by_slot(independent)},
    }


def _walked(
    setting: Setting, prompter: Prompter, neutral: PartDescriptions, cases: Sequence[Case]
) -> tuple[dict[int, Summary], list[list[Summary]]]:
    """The neutral walks by seed, and those of every case's variants."""
    args = setting.args
    walker = Walker(setting.folders[0], args.workers, 3.0 if args.quick else WALK_S)
    plain = [Walk.of(prompter(neutral), seed) for seed in range(edits.SEEDS)]
    walks = [[Walk.of(prompter(d), s) for d, s in zip(c.variants, c.seeds, strict=True)] for c in cases]
    requested = [*plain, *(walk for own in walks for walk in own)]
    log.info(f"{len(set(requested))} walks")
    made = dict(zip(requested, walker.make(requested), strict=True))
    return {walk.seed: made[walk] for walk in plain}, [[made[walk] for walk in own] for own in walks]


def _case_result(
    case: Case, summaries: Sequence[Summary], neutral: dict[int, Summary], reference: CapturedReference
) -> tuple[dict[str, Any] | None, dict[str, Any] | None]:
    """The case's score, None where its measure shows nothing; and its independence, for single edits."""
    pairs = reference.edited(case.edits)
    described = reference.described(pairs, case.edits)
    row = edits.score(case, summaries, neutral, described) if described else None
    single = len(case.edits) == 1 and case.kind != "free words"
    return row, independence(case, summaries, neutral, pairs) if single else None


def _summaries(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """By kind, and of held-out edits and pairs together: what the bars are about."""
    groups = {kind: [r for r in rows if r["kind"] == kind] for kind in dict.fromkeys(r["kind"] for r in rows)}
    zero_shot = [r for r in rows if r["kind"] in ("held out", "pair")]
    return {kind: edits.totals(group) for kind, group in {"zero-shot": zero_shot, **groups}.items()}


# --- tables -----------------------------------------------------------------------------------------------------------


Bar = tuple[str, str, bool]  # what is required, what was measured, and whether it is met
DIRECTIONS = {"text_to_motion": "text→motion", "motion_to_text": "motion→text"}


def markdown(results: dict[str, Any]) -> str:
    """All tables of `results`, what `--json` holds."""
    rows = [[required, measured, "yes" if ok else "**no**"] for required, measured, ok in bars(results)]
    lines = [f"`{results['command']}`, model `{results['model']}`", ""]
    lines += table(["Bar", "Measured", "Met"], rows)
    if "retrieval" in results:
        lines += ["### Retrieval", "", *_retrieval_table(results["retrieval"])]
    if "edits" in results:
        lines += ["### Part edits", "", *_edits_table(results["edits"])]
        lines += ["### Part independence", "", *_independence_table(results["independence"])]
    return "\n".join(lines) + "\n"


def bars(results: dict[str, Any]) -> list[Bar]:
    """Every demand."""
    found: list[Bar] = []
    for key, words in DIRECTIONS.items() if "retrieval" in results else ():
        r1 = results["retrieval"][key]["r1"]
        name = f"{words} R@1 on held-out captured clips: at least {percent(MIN_RECALL_FRACTION)}"
        found.append((name, percent(r1), r1 >= MIN_RECALL_FRACTION))
    if "edits" in results:
        rhythm = (edits.MIN_RHYTHM_RIGHT_WAY_FRACTION, edits.MIN_RHYTHM_ENOUGH_FRACTION)
        for kind, name, least in (
            ("zero-shot", "zero-shot part edits", (edits.MIN_RIGHT_WAY_FRACTION, edits.MIN_ENOUGH_FRACTION)),
            (edits.HELD_OUT_RHYTHM, "held-out edits of rhythm and weight", rhythm),
        ):
            if kind in results["edits"]["summary"]:
                found += _edit_bars(name, results["edits"]["summary"][kind], least)
        ratio = results["independence"]["by_slot"]["all"]["ratio"]
        name = f"other parts change by at most {percent(edits.MAX_OTHERS_FRACTION)} of the described part's change"
        found.append((name, percent(ratio), ratio <= edits.MAX_OTHERS_FRACTION))
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


Row = tuple[str, dict[str, Any]]  # a title and its scores
Columns = dict[str, Callable[[Row], str]]
RETRIEVAL_COLUMNS: Columns = {
    "": lambda row: row[0],
    "queries": lambda row: str(row[1]["queries"]),
    "gallery": lambda row: str(row[1]["gallery"]),
    "R@1": lambda row: _with(row[1], "r1", "chance_r1"),
    "R@3": lambda row: _with(row[1], "r3", "chance_r3"),
    "median rank": lambda row: f"{row[1]['median_rank']:g} ({row[1]['chance_rank']:g})",
    "R@1, mean over styles": lambda row: percent(row[1]["r1_by_style"]),
}
EDITS_COLUMNS: Columns = {
    "": lambda row: row[0],
    "cases": lambda row: str(row[1]["cases"]),
    "right way": lambda row: percent(row[1]["right_way"]),
    "at least half": lambda row: percent(row[1]["enough"]),
    "median fraction": lambda row: f"{row[1]['median_fraction']:.2f}",
    "of single walks": lambda row: percent(row[1]["runs_right_way"]),
    "at least half of them": lambda row: percent(row[1]["runs_enough"]),
}
INDEPENDENCE_COLUMNS: Columns = {
    "part": lambda row: row[0],
    "edits": lambda row: str(row[1]["edits"]),
    "its change": lambda row: f"{row[1]['own']:.1f}°",
    "the others'": lambda row: f"{row[1]['others']:.1f}°",
    "the others' between two seeds": lambda row: f"{row[1]['seed_others']:.1f}°",
    "ratio": lambda row: _with(row[1], "ratio", "edit_ratio"),
    "edits within 25 %": lambda row: percent(row[1]["within"]),
    "the other part that changes most": lambda row: _with(row[1], "most_ratio", "edit_most_ratio"),
}


def _with(scores: dict[str, float], key: str, bracketed: str) -> str:
    return f"{percent(scores[key])} ({100 * scores[bracketed]:.0f})"


def _retrieval_table(scores: dict[str, Any]) -> list[str]:
    rows = [
        (name + words, scores[key + suffix])
        for suffix, words in (("", ""), ("_alike", ", look-alike styles as one"))
        for key, name in DIRECTIONS.items()
    ]
    return [*columns(RETRIEVAL_COLUMNS, rows), "Chance stands in brackets.", ""]


def _edits_table(found: dict[str, Any]) -> list[str]:
    weak: dict[str, list[str]] = {row["kind"]: [] for row in found["rows"]}
    for row in found["rows"]:
        if not row["enough"]:
            weak[row["kind"]].append(f"{row['name']} ({row['worst_fraction']:.2f})")
    lines = columns(EDITS_COLUMNS, found["summary"].items())
    lines += ["Edits under half of the described change (in brackets the fraction):", ""]
    lines += table(["kind", "edits"], [[kind, ", ".join(names)] for kind, names in weak.items() if names])
    if found["unmeasured"]:
        why = "as captured walks disagree about what the edit does to its measure"
        lines += [f"Not scored, {why}: {', '.join(found['unmeasured'])}.", ""]
    return lines


def _independence_table(found: dict[str, Any]) -> list[str]:
    note = "In brackets what the edits themselves do to captured walks."
    return [*columns(INDEPENDENCE_COLUMNS, found["by_slot"].items()), note, ""]


def _check(args: Arguments) -> None:
    if not 1 <= args.workers <= 64:
        raise UsageError(f"--workers {args.workers}: expected 1 to 64.", "Choose another number.")


TEXT = Experiment(
    "Does the motion do what the words say (Sec. III-C)?",
    words_and_motion,
    markdown,
    "text evaluation",
    needs=("clips",),
    options=(
        CLIPS,
        MODEL,
        option("--only", choices=PARTS, nargs="+", help="measure this alone"),
        option("--quick", action="store_true", help="no trained edits, shorter walks: no figures to quote"),
        option("--workers", type=int, default=2, metavar="N", help="processes (default: 2)"),
        option(
            "--text-encoder", type=Path, metavar="DIR", help="text encoder that the model was trained with"
        ),
    ),
    check=_check,
)
