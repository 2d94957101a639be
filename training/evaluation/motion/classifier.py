"""Is our motion told from capture? A classifier sees windows of captured clips and of the character on the same paths.

    python -m training.evaluation.motion.classifier --clips DIR --model FOLDER [--model FOLDER2 ...] [--out FILE]

Every style is led along its own clips (`driving.follow`), as shown, after foot lock. Two kinds of features of windows of 1.3 s:
*kinematic* (322 numbers: ranges, angles, speeds, frequencies) and *trajectories* (the joints' places seen from the root).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.assets import asset_path, model_folder
from runtime.errors import run_command
from runtime.motion.model import load_model
from runtime.prompts.english.library_data import load_styles
from runtime.prompts.prompter import Prompter
from training.evaluation.metrics.kinematic_features import kinematic_features, temporal_features
from training.evaluation.metrics.told_apart import area_under_curve, halves_told_apart
from training.evaluation.motion.capture import driving_segments, read_capture
from training.evaluation.motion.driving import follow
from training.evaluation.motion.motion import GESTURES, Motion, window_index, window_starts
from training.evaluation.report.markers import check_section, write_section

Array = NDArray[np.floating]

SECONDS = 24.0  # of each style
HOP = 20  # frames between two windows
SAMPLES = 10  # of a window's 40, of its joint trajectories
SECTION = "told from capture"  # of a document, between its markers


@dataclass(frozen=True)
class Windows:
    """Features of windows `(N, n)` and the take `(N,)` that each lies in."""

    kinematic: Array
    trajectories: Array
    takes: NDArray[np.int64]

    def of(self, name: str) -> Array:
        """One of the two kinds of features."""
        return self.kinematic if name == "kinematic" else self.trajectories


FEATURES = ("kinematic", "trajectories")


def windows_of(motions: Iterable[Motion]) -> Windows:
    """Windows of all motions; each motion is a take."""
    kinematic, trajectories, takes = [], [], []
    for number, motion in enumerate(motions):
        root = motion.root_features()
        starts = window_starts(len(motion), HOP)
        kinematic.append(np.hstack([kinematic_features(root, starts), temporal_features(root, starts)]))
        index = window_index(starts)
        joints = root.joints[index[:, :: index.shape[1] // SAMPLES]]
        trajectories.append(joints.reshape(len(starts), -1))
        takes.append(np.full(len(starts), number))
    return Windows(np.concatenate(kinematic), np.concatenate(trajectories), np.concatenate(takes))


def captured(clips: Path, seconds: float = SECONDS) -> list[Motion]:
    """Segments of every walked style, held-out clips first."""
    capture = read_capture(clips)
    groups = [g for g in capture.groups if not g.startswith(GESTURES)]
    return [s.load() for g in groups for s in driving_segments(capture, g, seconds)]


def followed(model: Path, segments: list[Motion]) -> list[Motion]:
    """The character led along the segments, each in its style."""
    loaded = load_model(model)
    to_style = Prompter(loaded)
    styles = load_styles(asset_path("prompts/styles.json"))
    codes = {name: to_style(styles[name].descriptions[0]) for name in {m.style for m in segments}}
    return [follow(loaded, m, codes[m.style], seed) for seed, m in enumerate(segments)]


def told_from(ours: Windows, theirs: Windows) -> dict[str, float]:
    """AUC of both kinds of features; a path and its clip lie in the same fold."""
    labels = np.repeat([1, 0], [len(ours.takes), len(theirs.takes)])
    takes = np.concatenate([ours.takes, theirs.takes])
    return {n: area_under_curve(np.concatenate([ours.of(n), theirs.of(n)]), labels, takes) for n in FEATURES}


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--clips", type=Path, required=True, help="folder of imported clips")
    parser.add_argument("--model", type=model_folder, action="append", required=True)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of each style")
    parser.add_argument("--out", type=Path, help="document whose section between the markers is exchanged")
    args = parser.parse_args(argv)
    if args.out is not None:
        check_section(args.out, SECTION)
    segments = captured(args.clips, args.seconds)
    theirs = windows_of(segments)
    rows = {m.name: told_from(windows_of(followed(m, segments)), theirs) for m in args.model}
    rows["capture, half of the takes from the other"] = {
        n: halves_told_apart(theirs.of(n), theirs.takes) for n in FEATURES
    }
    lines = [f"| area under the curve, {len(theirs.takes)} windows | " + " | ".join(FEATURES) + " |"]
    lines.append("| --- " * (1 + len(FEATURES)) + "|")
    lines += [
        f"| {name} | " + " | ".join(f"{row[f]:.3f}" for f in FEATURES) + " |" for name, row in rows.items()
    ]
    if args.out is not None:
        write_section(args.out, SECTION, "\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    raise SystemExit(run_command("classifier", main))
