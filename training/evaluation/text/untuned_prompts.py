"""Interpretation of prompts unseen during development: `python -m training.evaluation.text.untuned_prompts [FILE]`.

Prints each prompt with its six descriptions and its note, for human judgement. Grades of a reader are in
`blind_grades.csv` and `class_grades.csv`. The exit code is 1 if a prompt has no answer.
"""

import re
import sys
from collections.abc import Sequence
from pathlib import Path

from runtime.errors import FileError, SportError
from runtime.prompts.expander import Expander
from runtime.skeleton import PART_NAMES

DATA = Path(__file__).parent / "data"
LISTS = (DATA / "untuned_prompts.txt", DATA / "blind_prompts.txt", DATA / "class_prompts.txt")  # never edited


def read_prompts(path: Path) -> list[str]:
    """Read the lines of a UTF-8 text file, without empty lines and comments (#); FileError if there are none."""
    try:
        lines = [line.strip() for line in path.read_text(encoding="utf-8-sig").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"{path}: {error}.", "Choose a text file with one prompt a line.") from error
    prompts = [line for line in lines if line and not line.startswith("#")]
    if not prompts:
        raise FileError(f"{path}: no prompt in it.", "Write one prompt a line.")
    return prompts


def read(prompt: str, expander: Expander) -> tuple[list[str], str]:
    """Return six descriptions with the note, and the problem (no answer, or parts without description), or ""."""
    try:
        expansion = expander.expand(prompt)
    except SportError as error:
        return [], str(error)
    lines = [f"{part}: {getattr(expansion.descriptions, part)}" for part in PART_NAMES]
    wordless = [line for line in lines if not re.search(r"\w", line.partition(":")[2])]
    return [*lines, f"note: {expansion.note}"], "; ".join(wordless)


def main(arguments: Sequence[str]) -> int:
    """Print every prompt of a list; returns the exit code."""
    from runtime.motion.model import load_model
    from runtime.prompts.prompter import Prompter

    expander, wrong = Prompter(load_model(None)).library, 0
    for prompt in read_prompts(Path(arguments[0]) if arguments else LISTS[0]):
        lines, problem = read(prompt, expander)
        print(f"{prompt}\n  " + "\n  ".join([*lines, *([f"WRONG {problem}"] if problem else [])]))
        wrong += bool(problem)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
