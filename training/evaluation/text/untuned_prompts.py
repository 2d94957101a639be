"""Two hundred prompts that nobody tuned the library on: `python -m training.evaluation prompts`."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from runtime.assets import asset_path
from runtime.errors import FileError, SportError
from runtime.motion.model import MotionModel, load_model
from runtime.prompts.content import PromptEncoder
from runtime.prompts.prompter import Prompter
from runtime.skeleton import PART_NAMES
from training.evaluation.experiment import Experiment, Setting

if TYPE_CHECKING:
    from runtime.prompts.expander import Expander

UNTUNED_PROMPTS = Path(__file__).parent / "data" / "untuned_prompts.txt"
BLIND_PROMPTS = UNTUNED_PROMPTS.with_name("blind_prompts.txt")  # written blind; never edited
CLASS_PROMPTS = UNTUNED_PROMPTS.with_name("class_prompts.txt")  # of the kinds that failed there
CLASS_GRADES = UNTUNED_PROMPTS.with_name("class_grades.csv")
BLIND_GRADES = UNTUNED_PROMPTS.with_name("blind_grades.csv")  # what a reader said of each
WARM_UP_PROMPT = "somebody going by"  # loads what the first prompt loads
MAX_MS = 50.0  # processor time from prompt to Z^t, warm
SAMPLE_ROWS = 30
SAME = 0.999  # cosine similarity of a prompt with itself
SECTION = "untuned prompts"  # of a document, between its markers


@dataclass(frozen=True)
class PromptOutcome:
    """What came of one prompt, `cpu_ms` and `wall_ms` after it; `problem` is why it has no usable answer, or ""."""

    prompt: str
    cpu_ms: float
    wall_ms: float
    descriptions: dict[str, str] = field(default_factory=dict)
    source: str = ""
    nearest: tuple[tuple[str, float], ...] = ()
    note: str = ""
    explicit_parts: tuple[str, ...] = ()
    problem: str = ""

    @property
    def similarity(self) -> float:
        """Cosine similarity of the nearest entry of the library, 0 when none was asked."""
        return self.nearest[0][1] if self.nearest else 0.0


def prompts(setting: Setting) -> dict[str, Any]:
    """Figures and all answers."""
    answers, first_ms = measure(read_prompts(setting.args.file), load_model(setting.folders[0]))
    report = {"library_entries": library_size(), **summarise(answers, first_ms)}
    return {**report, "answers": [asdict(answer) for answer in answers]}


def read_prompts(path: Path) -> list[str]:
    """The lines of a text file in UTF-8 without empty ones and comments (#); FileError when there is none."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text in UTF-8"
        raise FileError(f"{path}: {reason}.", "Choose a text file with one prompt a line.") from error
    stripped = [line.strip() for line in lines]
    prompts = [line for line in stripped if line and not line.startswith("#")]
    if not prompts:
        raise FileError(f"{path}: no prompt in it.", "Write one prompt a line.")
    return prompts


class Stopwatch:
    """Milliseconds of this process and of the clock since it was made."""

    def __init__(self) -> None:
        self._cpu, self._wall = time.process_time(), time.perf_counter()

    def read(self) -> tuple[float, float]:
        """(processor, wall) in milliseconds."""
        return (time.process_time() - self._cpu) * 1e3, (time.perf_counter() - self._wall) * 1e3


def library_size() -> int:
    """How many prompts the shipped library has an answer of its own for."""
    from runtime.prompts.english.library_data import load_library, load_styles

    styles = load_styles(asset_path("prompts/styles.json"))
    return len(load_library(asset_path("prompts/library.json"), styles))


def measure(prompts: Sequence[str], model: MotionModel) -> tuple[list[PromptOutcome], float]:
    """An answer for each prompt, asked once, and the processor's milliseconds for a first prompt, loading included."""
    watch = Stopwatch()
    prompter = Prompter(model)
    ask(WARM_UP_PROMPT, prompter.library, prompter.encoder)
    first_ms, _ = watch.read()
    return [ask(prompt, prompter.library, prompter.encoder) for prompt in prompts], first_ms


def ask(prompt: str, expander: Expander, encoder: PromptEncoder) -> PromptOutcome:
    """One prompt to Z^t; whatever is raised on the way becomes the answer's problem."""
    watch = Stopwatch()
    try:
        expansion = expander.expand(prompt)
        z = encoder.encode(expansion.descriptions)
    except SportError as error:
        return PromptOutcome(prompt, *watch.read(), problem=str(error))
    except Exception as defect:  # a defect at one prompt must not hide what the others say
        return PromptOutcome(prompt, *watch.read(), problem=f"unexpected {defect!r}")
    cpu_ms, wall_ms = watch.read()
    said = {part: getattr(expansion.descriptions, part) for part in PART_NAMES}
    return PromptOutcome(
        prompt,
        cpu_ms,
        wall_ms,
        said,
        expansion.source,
        expansion.nearest,
        expansion.note,
        expansion.explicit_parts,
        _problem(said, z),
    )


def _problem(said: dict[str, str], z: NDArray[np.float32]) -> str:
    wordless = [part for part, text in said.items() if not re.search(r"\w", text)]
    if wordless:
        return f"nothing is said of {', '.join(wordless)}"
    return "" if np.isfinite(z).all() and np.any(z) else "Z^t is zero or not finite"


def summarise(answers: Sequence[PromptOutcome], first_ms: float) -> dict[str, Any]:
    """Counts and times of all answers, and the bars that were missed."""
    times = np.array([answer.cpu_ms for answer in answers])
    wall = np.array([answer.wall_ms for answer in answers])
    slowest = answers[int(times.argmax())]
    alike = Counter(tuple(answer.descriptions.values()) for answer in answers)
    return {
        "prompts": len(answers),
        "problems": {answer.prompt: answer.problem for answer in answers if answer.problem},
        "in_the_library": sum(answer.similarity >= SAME for answer in answers),
        "median_similarity": float(np.median([answer.similarity for answer in answers])),
        "with_explicit_parts": sum(bool(answer.explicit_parts) for answer in answers),
        "different_answers": len(alike),
        "most_common_answer": max(alike.values()),
        "notes": dict(Counter(kind_of_note(answer.note) for answer in answers if answer.note).most_common()),
        "first_ms": first_ms,
        "median_ms": float(np.median(times)),
        "max_ms": float(times.max()),
        "slowest": slowest.prompt,
        "wall_median_ms": float(np.median(wall)),
        "wall_max_ms": float(wall.max()),
        "missed": _missed(answers),
    }


def kind_of_note(note: str) -> str:
    """A note without what is its prompt's own: words in quotation marks and numbers."""
    return re.sub(r"\d+(?:\.\d+)?", "N", re.sub(r"“[^”]*”|'[^']*'|\"[^\"]*\"", "“…”", note))


def _missed(answers: Sequence[PromptOutcome]) -> list[str]:
    slow = sum(answer.cpu_ms >= MAX_MS for answer in answers)
    bars = {
        "every prompt is answered, no part of it empty": not any(answer.problem for answer in answers),
        f"each in less than {MAX_MS:.0f} ms warm ({slow} took longer)": slow == 0,
    }
    return [name for name, met in bars.items() if not met]


def _figures(report: dict[str, Any]) -> list[str]:
    noted = sum(report["notes"].values())
    return [
        f"{report['prompts']} prompts, {len(report['problems'])} without an answer or with an empty part",
        f"library of {report['library_entries']} entries; {report['in_the_library']} of the prompts are among its words"
        f" (similarity 1), median similarity of the nearest entry"
        f" {report['median_similarity']:.2f}",
        f"{report['different_answers']} different answers, the most common one given"
        f" {report['most_common_answer']} times",
        f"{report['with_explicit_parts']} with parts taken by their words, {noted} with a note",
        f"to Z^t, processor time: median {report['median_ms']:.1f} ms, longest {report['max_ms']:.1f} ms"
        f" (“{report['slowest']}”), a first prompt {report['first_ms']:.0f} ms with loading; by the clock, others"
        f" working on the machine: {report['wall_median_ms']:.1f} and {report['wall_max_ms']:.1f} ms",
    ]


def markdown(report: dict[str, Any]) -> str:
    """Figures, bars, kinds of notes, prompts without an answer, and a sample."""
    answers = [PromptOutcome(**{**a, "nearest": tuple(map(tuple, a["nearest"]))}) for a in report["answers"]]
    lines = [f"- {line}" for line in _figures(report)]
    lines += [f"- note, {count} times: {kind}" for kind, count in report["notes"].items()]
    lines += [f"- “{prompt}”: {problem}" for prompt, problem in report["problems"].items()]
    lines.append("- missed: " + "; ".join(report["missed"]) if report["missed"] else "- all bars met")
    return "\n".join([*lines, "", *table(sample(answers))])


def sample(answers: Sequence[PromptOutcome], rows: int = SAMPLE_ROWS) -> list[PromptOutcome]:
    """`rows` of the answers at even distances, the first among them; all of them where there are fewer."""
    rows = min(rows, len(answers))
    return [answers[i * len(answers) // rows] for i in range(rows)]


def table(answers: Sequence[PromptOutcome]) -> list[str]:
    """Lines of a Markdown table: the prompt, its six descriptions, the nearest entry with its similarity, the note."""
    titles = ["prompt", *(part.replace("_", " ") for part in PART_NAMES), "nearest entry", "note"]
    lines = [_row(titles), _row(["---"] * len(titles))]
    for answer in answers:
        near = f"{answer.nearest[0][0]} ({answer.similarity:.2f})" if answer.nearest else "none"
        said = [answer.descriptions.get(part, "") for part in PART_NAMES]
        lines.append(_row([answer.prompt, *said, near, answer.problem or answer.note]))
    return lines


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(re.sub(r"([\\|*_<>`])", r"\\\1", cell) for cell in cells) + " |"


PROMPTS = Experiment(
    "Two hundred prompts that nobody tuned the library on, each expanded and encoded to Z^t once; the exit code is 1 when a "
    "bar is missed. Times are those of the processor; by the clock they are given beside. Whether an answer is a good one "
    "is for people to read: --json has all of them.",
    prompts,
    markdown,
    SECTION,
    options=(("--file", {"type": Path, "default": UNTUNED_PROMPTS, "help": "one prompt a line"}),),
    missed=lambda report: bool(report["missed"]),
)
