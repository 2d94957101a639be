"""`sport evaluate --text`: whether motion does what the words say (Sec. III-C)."""

from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from runtime.assets import asset_path
from runtime.errors import UsageError
from runtime.motion.model import load_model
from runtime.prompts.library_data import load_styles
from runtime.prompts.prompter import Prompter
from training.augmentation.measured_edits import load_reference
from training.evaluation import log
from training.evaluation.experiment import Arguments, Experiment, Setting, command_of, option
from training.evaluation.text import edits
from training.evaluation.text.edits import Case, by_slot, independence
from training.evaluation.text.retrieval import MIN_RECALL_FRACTION, evaluate_retrieval
from training.evaluation.text.walks import PLAIN_PROMPT, WALK_S, Walker
from training.markdown import columns, percent, table

PARTS = ("retrieval", "edits")


def words_and_motion(setting: Setting) -> dict[str, Any]:
    """Return all figures as plain data; equal arguments give equal figures."""
    args, folder = setting.args, setting.folders[0]
    model = load_model(folder)
    prompter = Prompter(model, text_encoder=args.text_encoder)
    command = command_of("sport evaluate --text", args)
    results: dict[str, Any] = {"command": command, "model": model.name}
    if "retrieval" in (args.only or PARTS):
        log.info("retrieval")
        styles = load_styles(asset_path("prompts/styles.json"))
        texts = {name: list(style.descriptions) for name, style in styles.items()}
        results["retrieval"] = evaluate_retrieval(folder, args.clips, texts, prompter.text_encoder)
    if "edits" in (args.only or PARTS):
        results |= _edits(setting, prompter)
    return results


def _edits(setting: Setting, prompter: Prompter) -> dict[str, Any]:
    """Measure part edits and part independence, on the same walks."""
    args = setting.args
    reference = load_reference(args.clips)
    plain = prompter.expand(PLAIN_PROMPT).descriptions
    cases = edits.catalogue_cases(plain, trained=not args.quick)
    cases += [
        Case(p, "free words", names, (prompter.expand(p).descriptions,) * 2, (0, 1))
        for p, names in edits.free_prompts().items()
    ]
    walker = Walker(setting.folders[0], args.workers, 3.0 if args.quick else WALK_S)
    words, seeds = [plain] * edits.SEEDS, list(range(edits.SEEDS))
    for case in cases:
        words += case.variants
        seeds += case.seeds
    log.info(f"{len(set(zip(words, seeds, strict=True)))} walks")
    made = iter(walker.make(map(prompter, words), seeds))
    neutral = {seed: next(made) for seed in range(edits.SEEDS)}
    rows, unmeasured, independent = [], [], []
    for case in cases:
        summaries, pairs = list(islice(made, len(case.variants))), reference.edited(case.edits)
        described = reference.described(pairs, case.edits)
        if described:
            rows.append(edits.score(case, summaries, neutral, described))
        else:  # its measure is inconclusive
            unmeasured.append(case.name)
        if len(case.edits) == 1 and case.kind != "free words":
            independent.append(independence(case, summaries, neutral, pairs))
    return {
        "edits": {"rows": rows, "unmeasured": unmeasured, "summary": _summaries(rows)},
        "independence": {"rows": independent, "by_slot": by_slot(independent)},
    }


def _summaries(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Summarise by kind, and held-out edits and pairs together, the subject of the criteria."""
    groups = {kind: [r for r in rows if r["kind"] == kind] for kind in dict.fromkeys(r["kind"] for r in rows)}
    zero_shot = [r for r in rows if r["kind"] in ("held out", "pair")]
    return {kind: edits.totals(group) for kind, group in {"zero-shot": zero_shot, **groups}.items()}


# --- tables -----------------------------------------------------------------------------------------------------------


Bar = tuple[str, str, bool]  # requirement, measurement, and whether it is met
DIRECTIONS = {"text_to_motion": "text→motion", "motion_to_text": "motion→text"}


def markdown(results: dict[str, Any]) -> str:
    """Return all tables of `results`, the content of `--json`."""
    rows = [[required, measured, "yes" if ok else "**no**"] for required, measured, ok in bars(results)]
    lines = [f"`{results['command']}`, model `{results['model']}`", ""]
    lines += table(["Bar", "Measured", "Met"], rows)
    if "retrieval" in results:
        lines += ["### Retrieval", "", *_retrieval_table(results["retrieval"])]
    if "edits" in results:
        lines += ["### Part edits", "", *_edits_table(results["edits"])]
        lines += ["### Part independence", ""]
        lines += columns(INDEPENDENCE_COLUMNS, results["independence"]["by_slot"].items())
        lines += ["In brackets what the edits themselves do to captured walks.", ""]
    return "\n".join(lines) + "\n"


def bars(results: dict[str, Any]) -> list[Bar]:
    """Return all criteria with their results."""
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


def _check(args: Arguments) -> None:
    if not 1 <= args.workers <= 64:
        raise UsageError(f"--workers {args.workers}: expected 1 to 64.", "Choose another number.")


TEXT = Experiment(
    "Whether motion does what the words say (Sec. III-C).",
    words_and_motion,
    markdown,
    "text evaluation",
    needs=("clips",),
    options=(
        "clips",
        "model",
        option("--only", choices=PARTS, nargs="+", help="measure only these"),
        option("--quick", action="store_true", help="trial without trained edits, with shorter walks"),
        option("--workers", type=int, default=2, metavar="N", help="processes (default: 2)"),
        option(
            "--text-encoder", type=Path, metavar="DIR", help="text encoder that the model was trained with"
        ),
    ),
    check=_check,
)
