"""`sport evaluate --text`: does the motion do what the words say (Sec. III-C)?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runtime.assets import asset_path
from runtime.errors import UsageError
from runtime.motion.model import load_model
from runtime.prompts.english.library_data import load_styles
from runtime.prompts.prompter import Prompter
from runtime.prompts.text_encoder import TextEncoder
from training.augmentation.measured_edits import CapturedReference, Summary, load_reference
from training.evaluation.experiment import Arguments, Experiment, Setting, command_of, option
from training.evaluation.report.text_tables import SECTION, markdown
from training.evaluation.text import edits
from training.evaluation.text.edits import FREE_PROMPTS, Case, by_slot, independence, seed_changes
from training.evaluation.text.walks import PLAIN_PROMPT, SECONDS, Walk, Walker

PARTS = ("retrieval", "edits")


def words_and_motion(setting: Setting) -> dict[str, Any]:
    """All figures as plain data; equal arguments give equal figures."""
    args, folder = setting.args, setting.folders[0]
    model = load_model(folder)
    prompter = Prompter(model, text_encoder=args.text_encoder)
    command = command_of("sport evaluate --text", args, clips=True)
    results: dict[str, Any] = {"command": command, "model": model.name}
    if "retrieval" in (args.only or PARTS):
        setting.report("retrieval")
        results["retrieval"] = _retrieval(args, folder, prompter.text_encoder)
    if "edits" in (args.only or PARTS):
        results |= _edits(setting, prompter)
    return results


def _retrieval(args: Arguments, folder: Path, words: TextEncoder) -> dict[str, Any]:
    """The figures, or why there are none: models of version 0.1 hold no motion encoder."""
    from training.evaluation.metrics.features import has_encoder
    from training.evaluation.text.retrieval import evaluate_retrieval

    if not has_encoder(folder):
        return {
            "missing": "The model folder holds no motion.onnx: export it again with `sport train export`."
        }
    styles = load_styles(asset_path("prompts/styles.json"))
    texts = {name: list(style.descriptions) for name, style in styles.items()}
    return evaluate_retrieval(folder, args.clips, texts, words)


def _edits(setting: Setting, prompter: Prompter) -> dict[str, Any]:
    """Part edits and part independence: they look at the same walks."""
    args = setting.args
    reference = load_reference(args.clips)
    neutral = prompter.expand(PLAIN_PROMPT).descriptions
    expanded = {prompt: prompter.expand(prompt) for prompt in FREE_PROMPTS}
    cases = edits.catalogue_cases(neutral, trained=not args.quick)
    cases += [edits.free_case(p, FREE_PROMPTS[p], e.descriptions) for p, e in expanded.items()]
    walker = Walker(setting.folders[0], args.workers, 3.0 if args.quick else SECONDS)
    requested = [Walk.of(prompter(neutral), seed) for seed in range(edits.SEEDS)]
    requested += [Walk.of(prompter(d), s) for c in cases for d, s in zip(c.variants, c.seeds, strict=True)]
    setting.report(f"{len(set(requested))} walks")
    made = iter(walker.make(requested))
    neutral_walks = {seed: next(made) for seed in range(edits.SEEDS)}
    rows, independent, unmeasured = [], [], []
    for case in cases:
        summaries = [next(made) for _ in case.variants]
        row, own = _case_result(case, summaries, neutral_walks, reference)
        if row is None:
            unmeasured.append(case.name)
        else:
            rows.append(row)
        if own is not None:
            independent.append(own)
    for row in rows:
        if row["kind"] == "free words":
            row["expansion"] = expanded[row["name"]].note
    return {
        "edits": {
            "rows": rows,
            "unmeasured": unmeasured,
            "summary": _summaries(rows),
            "reference": [name for name, _, _ in reference.walks],
            "walks": len(set(requested)),
        },
        "independence": {
            "rows": independent,
            "by_slot": by_slot(independent),
            "seeds": seed_changes(neutral_walks),
        },
    }


def _case_result(
    case: Case, summaries: Sequence[Summary], neutral: dict[int, Summary], reference: CapturedReference
) -> tuple[dict[str, Any] | None, dict[str, Any] | None]:
    """The case's score, None where its measure shows nothing; and its independence, for single edits."""
    pairs = reference.edited(case.edits)
    described = reference.described(pairs, case.edits)
    row = None
    if described:
        row = edits.score(case, summaries, neutral, described)
        row["seed_noise"] = edits.seed_noise(neutral, described)
    single = len(case.edits) == 1 and case.kind != "free words"
    return row, independence(case, summaries, neutral, pairs) if single else None


def _summaries(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """By kind, and of held-out edits and pairs together: what the bars are about."""
    groups = {kind: [r for r in rows if r["kind"] == kind] for kind in dict.fromkeys(r["kind"] for r in rows)}
    zero_shot = [r for r in rows if r["kind"] in ("held out", "pair")]
    return {kind: edits.totals(group) for kind, group in {"zero-shot": zero_shot, **groups}.items()}


def _check(args: Arguments) -> None:
    if not 1 <= args.workers <= 64:
        raise UsageError(f"--workers {args.workers}: expected 1 to 64.", "Choose another number.")


TEXT = Experiment(
    "Does the motion do what the words say (Sec. III-C)?",
    words_and_motion,
    markdown,
    SECTION,
    clips=True,
    options=(
        option("--only", choices=PARTS, nargs="+", help="measure this alone"),
        option("--quick", action="store_true", help="no trained edits, shorter walks: no figures to quote"),
        option("--workers", type=int, default=2, metavar="N", help="processes (default: 2)"),
        option(
            "--text-encoder", type=Path, metavar="DIR", help="text encoder that the model was trained with"
        ),
    ),
    check=_check,
)
