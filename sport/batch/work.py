"""One row made into files, wherever it runs: in this process, a worker, or a machine of a cluster."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.errors import SportError
from sport.batch.manifest import entry, sha256
from sport.batch.plan import Task

_PROGRESS = re.compile(r": (a film of|\d+ of \d+ frames|this folder is new)")
# one thread in each process: the rows are what runs side by side
THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}


@dataclass
class Maker:
    """Makes rows one after the other and keeps the model and the text encoder of the last one."""

    _model: tuple[Any, Any] = (None, None)
    _prompter: tuple[Any, Any] = (None, None)

    def make(self, task: Task, folder: Path) -> dict[str, Any]:
        """Make the files of a task in the empty `folder`; its line of the manifest, whatever happens."""
        begin = time.perf_counter()
        said = io.StringIO()
        try:
            folder.mkdir(parents=True)
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
                self._run(task, folder)
        except SportError as error:
            problem = str(error).replace(f"{folder}{os.sep}", "")
            return entry(task.number, task.values, task.key, problem)
        except Exception as error:  # one row must not end the others
            return entry(task.number, task.values, task.key, f"{type(error).__name__}: {error}")
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        files = {path.relative_to(folder).as_posix(): sha256(path) for path in paths}
        main = _main_file(task.options, files)
        notes = [
            line.removeprefix("sport: ")
            for line in said.getvalue().splitlines()
            if not _PROGRESS.search(line)
        ]
        return entry(
            task.number, task.values, task.key, file=main, sha256=files[main], files=files, notes=notes,
            seconds=round(time.perf_counter() - begin, 3),
        )  # fmt: skip

    def _run(self, task: Task, folder: Path) -> None:
        """As `sport generate` does; imported here, since a process that only leads needs none of it."""
        from sport.clips import write_clips

        options = argparse.Namespace(**vars(task.options))
        options.out = folder / options.out
        if options.ground_out is not None:
            options.ground_out = folder / options.ground_out
        write_clips(options, self._tools)

    def _tools(self, options: argparse.Namespace) -> Any:
        """The model and the prompter for these arguments, those of the row before where they are the same."""
        from runtime.motion.model import load_model
        from runtime.prompts.prompter import Prompter

        key = options.model
        if self._model[1] is None or self._model[0] != key:
            self._model, self._prompter = (key, load_model(options.model)), (None, None)
        model, key = self._model[1], (options.expander, options.text_encoder)
        if self._prompter[1] is None or self._prompter[0] != key:
            self._prompter = key, Prompter(model, options.expander, text_encoder=options.text_encoder)
        return model, self._prompter[1]


def _main_file(options: argparse.Namespace, files: dict[str, str]) -> str:
    """The file that was asked for; the first of several."""
    name = options.out.as_posix()
    return name if name in files else min((f for f in files if not f.endswith(".json")), default=min(files))


def put(folder: Path, line: dict[str, Any], target: Path) -> None:
    """Move the files of a finished row into place, the one that was asked for last; each is whole."""
    names = sorted(line["files"], key=lambda name: name == line["file"])
    for name in names:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(folder / name, target / name)
