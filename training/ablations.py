"""The ablation rows of Table I: every variant trained for the same few steps, on the same data, and exported.

    python -m training.ablations --clips DIR --run DIR --out DIR --stage2-steps 3000 --stage3-steps 1000 --seeds 0 1 2

`--run` is the folder of a finished run: its phases and content encoder serve the variants that do not change them.
Every variant lands in OUT/<name>/seed<k>/model, and OUT/full/seed<k>/model-mixture is the one without diffusion;
`training.evaluation table1 --runs OUT` scores them together.
"""

from __future__ import annotations

import argparse
import logging
import shutil
from pathlib import Path

from runtime.errors import FileError, run_command
from training import pipeline
from training.frames import stored_for
from training.presets import ABLATIONS

log = logging.getLogger("sport.train")

# What a variant can take over from the full model's run: the stages that its change leaves alone. Others take the phase.
_PHASE, _CONTENT = ("phase.npy", "phase_final.pt"), ("content_final.pt",)
SHARED: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(ABLATIONS, _PHASE),
    **dict.fromkeys(
        ("full", "4-experts", "4-content-experts", "distilled-diffusion", "expert-shares"), _PHASE + _CONTENT
    ),
    **dict.fromkeys(("pae", "joined-hips"), _CONTENT),
}

# These differ from the full model in stage 3 alone, and take over its stage 2 of the same seed.
OTHER_DIFFUSION = ("distilled-diffusion", "expert-shares")
STAGE2 = "stage2.pt"
STAGES = {"phase": 1500, "content": 1500, "stage2": 3000, "stage3": 1000}  # steps
FRAMES = "frames"  # the table of all frames: gigabytes, which every variant of the same clips maps


def prepare(run: Path, out: Path, name: str, clips: Path) -> None:
    """Copy what the variant `name` shares with `run` into `out`; FileError names what is missing."""
    out.mkdir(parents=True, exist_ok=True)
    if stored_for(run / FRAMES, clips) and not (out / FRAMES).exists():
        (out / FRAMES).symlink_to((run / FRAMES).resolve(), target_is_directory=True)
    for file in SHARED[name]:
        if (out / file).exists():
            continue
        if not (run / file).exists():
            raise FileError(f"{run / file}: missing.", "Train stages phase and content there first.")
        shutil.copy(run / file, out / file)


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Train and export the ablations of Table I.")
    parser.add_argument("--clips", type=Path, required=True)
    parser.add_argument("--run", type=Path, required=True, help="folder of the full model's run")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", choices=tuple(ABLATIONS), default=list(ABLATIONS))
    parser.add_argument("--preset", default="compact")
    for stage, steps in STAGES.items():
        parser.add_argument(f"--{stage}-steps", type=int, default=steps)
    parser.add_argument("--batch", type=int, default=1024)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="every variant once with each")
    args = parser.parse_args(argv)
    for seed in args.seeds:  # a whole table first, then its spread
        for name in args.only:
            _train(args, name, seed)


def _train(args: argparse.Namespace, name: str, seed: int) -> None:
    """Train and export one variant, if it is not there."""
    folder = args.out / name / f"seed{seed}"
    if (folder / "model" / "metadata.json").exists():
        log.info("%s, seed %d: already exported", name, seed)
        return
    prepare(args.run, folder, name, args.clips)
    trained = args.out / "full" / f"seed{seed}" / STAGE2
    if name in OTHER_DIFFUSION and trained.exists() and not (folder / STAGE2).exists():
        shutil.copy(trained, folder / STAGE2)
    steps = [f"--{stage}-steps={getattr(args, f'{stage}_steps')}" for stage in STAGES]
    steps += [f"--batch={args.batch}", f"--seed={seed}"]
    common = ["--preset", args.preset, "--clips", str(args.clips), "--out", str(folder), "--layers", "0"]
    pipeline.main(["all", *common, "--ablation", name, *steps])
    if name == "full":  # its stage 2 is the row without diffusion
        pipeline.main(["export", *common, "--ablation", name, "--decoder", "mixture"])


if __name__ == "__main__":
    raise SystemExit(run_command("ablations", main))
