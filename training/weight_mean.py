"""The mean of two runs' generators, one of which went on from the other (Wortsman et al. 2022, model soups).

python -m training.weight_mean RUN LATER OUT     OUT: a run as LATER, with the mean of both generators, to be exported

Further training of single things (turns of head and feet) costs others (words of rhythm); halfway between both runs most of
either is kept.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path
from typing import Any

import torch

from runtime.errors import FileError, UsageError, run_command
from training.session import load_checkpoint, save_checkpoint

GENERATORS = ("stage2_final.pt", "stage3_final.pt")
REST = ("content_final.pt", "phase_final.pt", "scales.pt", "before.json")


def mean_of(one: Any, other: Any, path: Path) -> Any:
    """Halfway between two checkpoints of one shape; FileError names `path` where they differ."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return {key: mean_of(one[key], other[key], path) for key in one}
    if isinstance(one, torch.Tensor) and isinstance(other, torch.Tensor) and one.shape == other.shape:
        return torch.lerp(one, other, 0.5) if one.is_floating_point() else other
    if type(one) is not type(other) or isinstance(one, dict | torch.Tensor):
        raise FileError(f"{path}: weights of another shape.", "Give a run that went on from the first.")
    return other


def average(run: Path, later: Path, out: Path) -> None:
    """Write the run `out`; UsageError where it exists, FileError where one of the runs is not finished."""
    if out.exists():
        raise UsageError(f"{out}: exists.", "Choose another folder.")
    means = {
        name: mean_of(load_checkpoint(run / name), load_checkpoint(later / name), later / name)
        for name in GENERATORS
    }
    out.mkdir(parents=True)
    for name in REST:
        if (later / name).exists():
            shutil.copy2(later / name, out / name)
    shutil.copytree(later / "logs", out / "logs")
    for name, checkpoint in means.items():
        save_checkpoint(out / name, checkpoint)


def main(argv: list[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="The mean of the generators of two runs.")
    for name in ("run", "later", "out"):
        parser.add_argument(name, type=Path)
    args = parser.parse_args(argv)
    average(args.run, args.later, args.out)


if __name__ == "__main__":
    raise SystemExit(run_command("weight_mean", main))
