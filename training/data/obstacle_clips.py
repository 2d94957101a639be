"""Copies of imported clips on obstacles that fit them: hurdles, gaps, platforms, beams.

    python -m training.data.obstacle_clips --clips DIR --out DIR [--report docs/results/obstacles.md]

A copy is named `<name>_fit_t`, as copies on made ground are, and has the motion of its source frame for frame.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.errors import run_command
from runtime.safe_read import open_npz
from runtime.skeleton import SPORT_SKELETON
from training.data.clip_files import TrainingClip
from training.data.height_patches import Patches
from training.data.labels import soften
from training.data.obstacle_fit import Fitted, fit_obstacles, platform_ground, raised
from training.data.retarget import FPS

SOURCES = ("cmu", "cmu91", "o3de", "accad", "fair_zombie", "jlpm", "pfnn", "pfnn_rollouts")
LONGEST_S = 12.0  # of one copy
SHORTEST_S = 1.0
BEFORE_JUMP_S = 0.35  # the crouch before a take-off belongs to the jump
LEAP_M = 0.25  # of a hurdle that is leaped, not stepped over
SECTION = "fitted obstacles"  # of a document, between its markers


@dataclass(frozen=True)
class FittedClip:
    """What was fitted under one copy."""

    name: str
    source: str
    seconds: float
    fits: tuple[Fitted, ...]


def fitted_copies(clip: TrainingClip, seed: int = 0) -> Iterator[tuple[TrainingClip, FittedClip]]:
    """Pieces of a clip that something fits, on their ground, with words and gait of what they do."""
    generator = np.random.default_rng([seed, *clip.name.encode()])
    longest = round(LONGEST_S * FPS)
    for number, first in enumerate(range(0, len(clip.hips), longest)):
        piece = slice(first, min(first + longest, len(clip.hips)))
        if piece.stop - first < SHORTEST_S * FPS:
            continue
        positions = SPORT_SKELETON.forward_kinematics(clip.hips[piece], clip.local[piece])[0].astype(
            np.float64
        )
        contacts = clip.contacts[piece]
        patches, fits = _ground(clip, positions, contacts, generator)
        if not fits:
            continue
        copy = TrainingClip(
            f"{clip.name}_{number}_fit_t", clip.hips[piece], clip.local[piece], contacts,
            _gait(clip.gait[piece], contacts, fits), clip.style, _words(clip.content, fits), clip.source,
            clip.split, clip.tier, patches,
        )  # fmt: skip
        yield copy, FittedClip(copy.name, clip.source, (piece.stop - first) / FPS, tuple(fits))


def _ground(
    clip: TrainingClip, positions: Array, contacts: NDArray[np.uint8], generator: np.random.Generator
) -> tuple[Patches, list[Fitted]]:
    """Platforms where footholds were captured on several levels; else obstacles on the clip's own ground."""
    own = clip.patches.terrain()
    if "platform" in clip.content:
        patches, steps = platform_ground(positions, contacts)
        if steps:
            return patches, steps
    fits = fit_obstacles(positions, contacts, own, generator)
    return raised(fits, positions, own), fits


def _gait(gait: Array, contacts: NDArray[np.uint8], fits: Sequence[Fitted]) -> Array:
    """Gait labels with a jump around the flight over everything that is leaped over or jumped onto."""
    hard = gait.argmax(1)
    air = contacts.sum(1) == 0
    reach = round(BEFORE_JUMP_S * FPS)
    for fit in fits:
        leaped = fit.kind in ("gap", "platform") or (fit.kind == "hurdle" and fit.size >= LEAP_M)
        around = slice(max(0, fit.frame - reach), fit.frame + reach)
        if leaped and air[around].any() and not (hard[around] == Gait.JOG).all():
            frames = np.flatnonzero(air[around]) + around.start
            hard[max(0, frames[0] - reach) : frames[-1] + reach] = Gait.JUMP
    return soften(np.eye(gait.shape[1])[hard])


def _words(content: str, fits: Sequence[Fitted]) -> str:
    return f"{content}: " + ", ".join(f.words() for f in sorted(fits, key=lambda f: f.frame)[:4])


def load_clip(path: Path) -> TrainingClip:
    """A clip file of the importer; FileError when it is none."""
    with open_npz(path, "Run the importer again.") as c:
        origin = (float(c["patch_origin"][0]), float(c["patch_origin"][1]))
        patches = Patches(c["patch_heights"][:1].astype(np.float64), origin, float(c["patch_cell"]))
        style, content, source, split, tier = (
            str(c[k]) for k in ("style", "content", "source", "split", "tier")
        )
        return TrainingClip(
            path.stem,
            c["hips_positions"],
            c["local_rotations"],
            c["contacts"],
            c["gait"],
            style,
            content,
            source,
            split,
            tier,
            patches,
        )


def report(rows: Sequence[FittedClip], command: str) -> str:
    """Tables of what was fitted, by source and kind, heights and lengths in cm."""
    lines = [f"`{command}`", "", f"{len(rows)} pieces, {sum(r.seconds for r in rows) / 60:.1f} minutes.", ""]
    lines += ["| source | kind | fitted | pieces | smallest, cm | median | largest |", "| --- " * 7 + "|"]
    for source in sorted({r.source for r in rows}):
        for kind in ("hurdle", "gap", "platform", "beam"):
            own = [(r, f) for r in rows if r.source == source for f in r.fits if f.kind == kind]
            if own:
                sizes = 100.0 * np.array([f.size for _, f in own])
                pieces = len({r.name for r, _ in own})
                low, middle, high = sizes.min(), np.median(sizes), sizes.max()
                lines.append(
                    f"| {source} | {kind} | {len(own)} | {pieces} | {low:.0f} | {middle:.0f} | {high:.0f} |"
                )
    heights = [f.size for r in rows for f in r.fits if f.kind == "hurdle"]
    counts, _ = np.histogram(heights, (0.1, 0.2, 0.3, 0.4, 0.5, 0.8))
    names = ("10 to 20", "20 to 30", "30 to 40", "40 to 50", "over 50")
    spread = ", ".join(f"{n} cm {c}" for n, c in zip(names, counts, strict=True))
    return "\n".join([*lines, "", f"Hurdles by height: {spread}."]) + "\n"


def main(argv: Sequence[str] | None = None) -> None:
    """Command line."""
    from training.markdown import check_section, write_section

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--clips", type=Path, required=True, help="folder that the importer wrote")
    parser.add_argument("--out", type=Path, required=True, help="folder for the copies")
    parser.add_argument("--report", type=Path, help="document whose section between the markers is exchanged")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    if args.report is not None:
        check_section(args.report, SECTION)
    args.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for path in sorted(args.clips.glob("*.npz")):
        if path.stem.endswith(("_m", "_t")) or not _is_source(path):
            continue
        for copy, row in fitted_copies(load_clip(path), args.seed):
            copy.save(args.out)
            copy.mirror().save(args.out)
            rows.append(row)
    text = report(rows, "python -m training.data.obstacle_clips --clips DIR --out DIR")
    print(text, end="")
    if args.report is not None:
        write_section(args.report, SECTION, text)


def _is_source(path: Path) -> bool:
    with open_npz(path, "Run the importer again.") as clip:
        return str(clip["source"]) in SOURCES and str(clip["tier"]) != "layered"


if __name__ == "__main__":
    raise SystemExit(run_command("obstacle clips", main))
