"""The distances of several models alone, a tenth of the whole evaluation: is the diffusion worth its steps?

python -m training.evaluation.motion.distances --clips DIR --model A --model B --json FILE --markdown FILE
"""

from __future__ import annotations

import argparse
import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

from runtime.assets import model_folder
from runtime.atomic import write_atomic
from runtime.errors import run_command
from runtime.motion.motion_encoder import MotionEncoder
from training.evaluation.motion.plan import Options, make_plan
from training.evaluation.motion.score_styles import score_following
from training.evaluation.motion.subject import Subject
from training.evaluation.report.markers import check_section, write_section

log = logging.getLogger("sport.evaluate")


def main(argv: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        description="Compare models by distance to capture and style recognition."
    )
    parser.add_argument("--clips", type=Path, required=True, help="folder of imported clips")
    parser.add_argument(
        "--model", type=model_folder, action="append", required=True, help="can be given several times"
    )
    parser.add_argument("--seconds", type=float, default=12.0, help="of followed paths per style")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--markdown", type=Path, help="write the table between this file's markers")
    parser.add_argument("--section", default="distances", help="name in the file's markers")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    if args.markdown is not None:
        check_section(args.markdown, args.section)
    options = replace(Options(), follow_seconds=args.seconds, recognise_seconds=8.0, seed=args.seed)
    # one encoder serves all, that of the first model
    plan = make_plan(args.clips, None, options, MotionEncoder(args.model[0]), log.info)
    results = {}
    for folder in args.model:
        subject = Subject(folder, plan.texts)
        label = f"{subject.name} ({subject.decoder})"
        results[label] = score_following(plan, subject, log.info)
        if args.json is not None:
            write_atomic(args.json, json.dumps(results, indent=1) + "\n")
    text = table(results)
    print(text)
    if args.markdown is not None:
        write_section(args.markdown, args.section, text)
    return 0


def table(results: dict[str, dict[str, Any]]) -> str:
    """Markdown: overall distance, its ratio to two halves of the capture (whole takes, cut takes), and recognition."""
    sets = sorted({name for r in results.values() for name in r["fmd"]})
    head = ["model", *(f"FMD, {n} (halves)" for n in sets), "styles recognised, mean"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for label, result in results.items():
        cells = [label]
        for name in sets:
            found = result["fmd"][name]
            takes = found["takes"]
            cells.append(f"{takes['distance']:.2f} ({takes['ratio']:.1f} x, {found['ratio']:.1f} x)")
        score = result["recognition"]["score"]
        cells.append(f"{100 * sum(score.values()) / max(1, len(score)):.0f} %")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(run_command("distances", main))
