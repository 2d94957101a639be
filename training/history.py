"""What a run's weights have been through: the steps of every stage, also of the models that they go on from."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from runtime.atomic import write_atomic
from runtime.errors import FileError

BEFORE = "before.json"  # in a run that began with packed weights: what these had been through
_STEP = re.compile(r"step (\d+) of \d+")


@dataclass
class History:
    """Steps of each stage, one number for every model that went on from the one before; last logged losses."""

    steps: dict[str, list[int]] = field(default_factory=dict)
    losses: dict[str, str] = field(default_factory=dict)

    @staticmethod
    def of_run(folder: Path) -> History:
        """From `before.json`, where there is one, and the run's own logs; FileError when either is damaged."""
        history = History()
        if (folder / BEFORE).exists():
            history = History.from_mapping(_read(folder / BEFORE), folder / BEFORE)
        for log in sorted((folder / "logs").glob("*.txt")):
            line = log.read_text(encoding="utf-8").strip()
            reached = _STEP.search(line)
            if reached is None:
                raise FileError(f"{log}: no line such as `step 100 of 100`.", "Run the stage again.")
            history.steps.setdefault(log.stem, []).append(int(reached[1]))
            history.losses[log.stem] = line
        return history

    @staticmethod
    def from_mapping(stored: dict[str, Any], path: Path) -> History:
        """From what `mapping` gave; FileError names `path` when it is something else."""
        try:
            steps = {str(stage): [int(n) for n in counts] for stage, counts in stored["steps"].items()}
            return History(steps, {str(stage): str(line) for stage, line in stored["losses"].items()})
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise FileError(f"{path}: not the history of a run.", "Pack the run again.") from error

    def mapping(self) -> dict[str, Any]:
        """Plain values, for JSON and checkpoints."""
        return asdict(self)

    def write(self, folder: Path) -> None:
        """As what the weights of a new run in `folder` had been through."""
        write_atomic(folder / BEFORE, json.dumps(self.mapping(), indent=1) + "\n")


def _read(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: not the history of a run.", "Unpack the checkpoint again.") from error
