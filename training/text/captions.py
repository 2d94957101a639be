"""Measured captions: descriptions that are true of the training motion, merged into the styles' hand-written ones.

    python -m training.text.captions --clips DIR --out assets/prompts/styles.json --merge
    python -m training.text.captions --clips DIR --per-clip captions.json

`--merge` keeps a style's hand-written descriptions and replaces its measured ones, which are the last `measured` of
its list. `--per-clip` writes {clip name: [descriptions]} for training on words of each clip's own.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from runtime.atomic import write_atomic
from runtime.errors import UsageError, run_command
from training.text.clip_measures import measure_clips, styles_of
from training.text.descriptions import describe
from training.text.measure import BodyMeasures

PARAPHRASES = 4


def measured_captions(
    performances: list[BodyMeasures], count: int = PARAPHRASES, pace: bool = False
) -> list[dict[str, str]]:
    """`count` descriptions or a few more, the performances of a style in turn, without repetitions."""
    each = max(1, -(-count // len(performances)))
    found = [describe(body, k, pace).to_mapping() for k in range(each) for body in performances]
    return [caption for i, caption in enumerate(found) if caption not in found[:i]]


def merge_captions(library: dict[str, Any], captions: dict[str, list[dict[str, str]]]) -> dict[str, Any]:
    """A copy of styles.json's object with the measured descriptions of `captions` exchanged."""
    merged = {}
    for style, entry in library.items():
        old = entry["descriptions"]
        written = old[: len(old) - entry.get("measured", 0)]
        new = captions.get(style, [])
        merged[style] = {"prompt": entry["prompt"], "measured": len(new), "descriptions": written + new}
    for style in captions.keys() - library.keys():
        prompt = style.removeprefix("cmu_").replace("_", " ")
        merged[style] = {"prompt": prompt, "measured": len(captions[style]), "descriptions": captions[style]}
    return merged


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Describe imported clips in the words of the prompts.")
    parser.add_argument("--clips", type=Path, required=True, help="folder of imported clips (*.npz)")
    parser.add_argument("--out", type=Path, help="styles.json to write")
    parser.add_argument("--merge", action="store_true", help="keep what is written by hand in --out")
    parser.add_argument("--per-clip", type=Path, help="JSON of captions for each clip")
    arguments = parser.parse_args(argv)
    if arguments.out is None and arguments.per_clip is None:
        raise UsageError("captions: neither --out nor --per-clip is given.", "Give one of them.")
    if arguments.out is not None:
        clips = measure_clips(arguments.clips)
        captions = {style: measured_captions(items) for style, items in styles_of(clips).items()}
        library = json.loads(arguments.out.read_text("utf-8")) if arguments.merge else {}
        _write(arguments.out, merge_captions(library, captions))
        print(f"{arguments.out}: {len(captions)} styles described from {len(clips)} clips")
    if arguments.per_clip is not None:
        count = write_clip_captions(arguments.clips, arguments.per_clip)
        print(f"{arguments.per_clip}: {count} clips described")


def write_clip_captions(clips: Path, path: Path) -> int:
    """Write {clip name: descriptions measured on it} of every captured training clip; returns how many."""
    measured = measure_clips(clips, every_clip=True)
    _write(path, {clip.name: measured_captions([clip.body], pace=True) for clip in measured})
    return len(measured)


def _write(path: Path, value: dict[str, Any]) -> None:
    write_atomic(path, json.dumps(value, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    raise SystemExit(run_command("captions", main))
