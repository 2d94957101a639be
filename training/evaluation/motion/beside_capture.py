"""A captured walk, and the same style's character led along its path, as two BVH files to be looked at side by side.

python -m training.evaluation.motion.beside_capture --clips DIR --style old --out FOLDER [--model FOLDER]
python -m viewer.tools.film FOLDER/old_captured.bvh FOLDER/old_ours.bvh --labels captured ours --out old.webp
"""

from __future__ import annotations

import argparse
from pathlib import Path

from runtime.assets import asset_path, model_folder
from runtime.errors import FileError, run_command
from runtime.motion.features import FPS
from runtime.motion.model import load_model
from runtime.prompts.english.library_data import load_styles
from runtime.prompts.prompter import Prompter
from runtime.takes.clip import Clip, save_bvh
from training.evaluation.motion.driving import follow
from training.evaluation.motion.motion import Motion
from training.evaluation.motion.same_path import walks

EVERY = 10_000  # more than there are styles


def clip_of(motion: Motion) -> Clip:
    """What a motion shows, as a take without prompts."""
    return Clip(motion.name, FPS, motion.hips, motion.local, motion.contacts)


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--clips", type=Path, required=True, help="folder of imported clips")
    parser.add_argument("--style", action="append", required=True, help="as in prompts/styles.json; several")
    parser.add_argument("--model", type=model_folder, help="default: the shipped one")
    parser.add_argument("--out", type=Path, required=True, help="folder for two files of each style")
    args = parser.parse_args(argv)
    model = load_model(args.model)
    to_style = Prompter(model)
    prompts = load_styles(asset_path("prompts/styles.json"))
    found = {motion.style: motion for motion in walks(args.clips, EVERY)}
    missing = sorted(set(args.style) - set(found))
    if missing:
        raise FileError(
            f"{args.clips}: no walk of {', '.join(missing)}.", f"There are {', '.join(sorted(found))}."
        )
    args.out.mkdir(parents=True, exist_ok=True)
    for style in args.style:
        captured = found[style]
        made = follow(model, captured, to_style(prompts[style].descriptions[0]))
        for motion, name in ((captured, "captured"), (made, "ours")):
            path = args.out / f"{style}_{name}.bvh"
            save_bvh(clip_of(motion), path)
            print(path)


if __name__ == "__main__":
    raise SystemExit(run_command("beside_capture", main))
