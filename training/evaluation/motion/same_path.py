"""The same path at the same speed: does the character swing as far as the clip, and are its hands as calm?

    python -m training.evaluation.motion.same_path --clips DIR --model FOLDER [--model FOLDER2 ...]

Styles are led along their own walks (`driving.follow`), before foot lock; amplitudes are deviations over the clip's.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.assets import model_folder
from runtime.controls import Gait
from runtime.errors import run_command
from runtime.motion.features import FPS
from training.evaluation.motion.driving import follow
from training.evaluation.motion.motion import Motion, load_motion, original_clips
from training.evaluation.report.markers import check_section, write_section
from training.frames import root_motion, smooth

Array = NDArray[np.floating]

CLIPS = 16
MAX_FRAMES = 6 * FPS
FAST_HZ = 4.0
SECTION = "same path"  # of a document, between its markers
_HANDS, _FEET, _HEAD = (20, 27), (4, 9), (16,)
_HIPS, _SHOULDERS = (2, 7), (18, 25)


def walks(clips: Path, count: int = CLIPS) -> list[Motion]:
    """One walk of each style, evenly spread over the styles: held-out ones where there are, at most six seconds."""
    found: dict[str, Motion] = {}
    for path in original_clips(clips):
        if path.stem.startswith(("layer_", "rollout_")):
            continue
        with np.load(path, allow_pickle=False) as file:
            style, forward = str(file["style"]), str(file["content"]) == "walk forward"
            held_out, frames = str(file["split"]) == "held_out", len(file["gait"])
        if not forward or frames < 3 * FPS or (style in found and not held_out):
            continue
        motion = load_motion(path)
        middle = max(0, (len(motion) - MAX_FRAMES) // 2)
        found[style] = motion.cut(middle, middle + MAX_FRAMES)
    styles = sorted(found)
    chosen = [styles[i] for i in np.unique(np.linspace(0, len(styles) - 1, count).round().astype(int))]
    return [replace(found[s], gait=np.full(len(found[s]), Gait.WALK)) for s in chosen]


def amplitudes(positions: Array) -> dict[str, float]:
    """Deviations of what swings, of joints `(T, 31, 3)`, and the energy of the hands over 4 Hz."""
    p = positions.astype(np.float64)
    xz, yaw = root_motion(p)
    c, s = np.cos(-yaw)[:, None], np.sin(-yaw)[:, None]
    local = p - np.stack([xz[:, 0], np.zeros(len(xz)), xz[:, 1]], -1)[:, None]
    local = np.stack(
        [local[..., 0] * c + local[..., 2] * s, local[..., 1], local[..., 2] * c - local[..., 0] * s], -1
    )

    def spread(joints: tuple[int, ...]) -> float:
        q = local[:, list(joints)]
        return float(np.sqrt(((q - smooth(q, FPS / 2)) ** 2).sum(-1).mean()))

    def angle(pair: tuple[int, int], of: Callable[[Array], Array]) -> float:
        values = of(local[:, pair[0]] - local[:, pair[1]])
        return float(np.std(values - smooth(values[:, None], FPS / 2)[:, 0]))

    def level(v: Array) -> Array:
        return np.arctan2(v[:, 2], v[:, 0])

    def tilt(v: Array) -> Array:
        return np.arcsin(v[:, 1] / np.linalg.norm(v, axis=-1))

    speed = np.gradient(local[:, list(_HANDS)], axis=0) * FPS
    spectrum = np.abs(np.fft.rfft((speed - speed.mean(0)) * np.hanning(len(p))[:, None, None], axis=0)) ** 2
    fast = np.fft.rfftfreq(len(p), 1 / FPS) > FAST_HZ
    return {
        "hands": spread(_HANDS),
        "feet": spread(_FEET),
        "head": spread(_HEAD),
        "pelvis bob": float(np.std(p[:, 0, 1] - smooth(p[:, 0, 1:2], FPS / 2)[:, 0])),
        "pelvis yaw": angle(_HIPS, level),
        "pelvis roll": angle(_HIPS, tilt),
        "shoulder yaw": angle(_SHOULDERS, level),
        "hands over 4 Hz": float(spectrum[fast].sum()),
    }


def compare(model: Path, motions: list[Motion]) -> dict[str, float]:
    """Median over the walks of ours over the clip's, for every amplitude; and the speed."""
    from runtime.assets import asset_path
    from runtime.motion.model import load_model
    from runtime.prompts.english.library_data import load_styles
    from runtime.prompts.prompter import Prompter

    loaded = load_model(model)
    to_style = Prompter(loaded)
    styles = load_styles(asset_path("prompts/styles.json"))
    ratios: dict[str, list[float]] = {}
    for clip in motions:
        made = follow(loaded, clip, to_style(styles[clip.style].descriptions[0]))
        assert made.unlocked is not None
        ours, theirs = amplitudes(made.unlocked), amplitudes(clip.positions)
        for key, value in ours.items():
            ratios.setdefault(key, []).append(value / max(theirs[key], 1e-9))
    return {key: float(np.median(values)) for key, values in ratios.items()}


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--clips", type=Path, required=True, help="folder of imported clips")
    parser.add_argument("--model", type=model_folder, action="append", required=True)
    parser.add_argument("--count", type=int, default=CLIPS)
    parser.add_argument("--out", type=Path, help="document whose section between the markers is exchanged")
    args = parser.parse_args(argv)
    if args.out is not None:
        check_section(args.out, SECTION)
    motions = walks(args.clips, args.count)
    found = {folder.name: compare(folder, motions) for folder in args.model}
    keys = list(next(iter(found.values())))
    lines = [f"| ours over the clip's, median of {len(motions)} walks | " + " | ".join(keys) + " |"]
    lines.append("| --- " * (1 + len(keys)) + "|")
    lines += [f"| {n} | " + " | ".join(f"{r[k]:.2f}" for k in keys) + " |" for n, r in found.items()]
    if args.out is not None:
        write_section(args.out, SECTION, "\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    raise SystemExit(run_command("same_path", main))
