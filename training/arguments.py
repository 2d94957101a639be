"""Arguments of `sport train`: read without torch."""

from __future__ import annotations

import argparse
import logging
from dataclasses import dataclass
from pathlib import Path

from training.presets import ABLATIONS, PRESETS

# of the time that --minutes leaves for them
FRACTIONS = {"phase": 0.04, "content": 0.16, "words": 0.03, "stage2": 0.63, "stage3": 0.14}
STAGES = ("import", "layer", "phase", "content", "words", "stage2", "stage3", "ground", "export")
DECODERS = ("diffusion", "mixture")
LAYERED_CLIPS = 4600  # edited clips


@dataclass
class StageSteps:
    """Optimiser steps (0: skip by loading what exists) of each stage: the length of its schedule with --minutes."""

    phase: int = 1000
    content: int = 2500
    words: int = 2000
    stage2: int = 11000
    stage3: int = 1500
    ground: int = 3000
    batch: int = 1024  # samples of a step of stages 2 and 3, over all processes


def build_parser() -> argparse.ArgumentParser:
    """Arguments of `sport train`."""
    parser = argparse.ArgumentParser(
        prog="sport train", description="Train the networks from motion capture; every stage can be resumed."
    )
    parser.add_argument("stage", choices=("all", *STAGES))
    parser.add_argument("--preset", default="compact", help=f"one of {', '.join(PRESETS)}")
    parser.add_argument(
        "--decoder",
        choices=DECODERS,
        default="diffusion",
        help="of the export: mixture is stage 2 without diffusion, written to OUT/model-mixture",
    )
    parser.add_argument("--ablation", help=f"change the preset: {', '.join(ABLATIONS)}")
    parser.add_argument("--layers", type=int, default=LAYERED_CLIPS, help="layered clips (stage layer)")
    parser.add_argument("--data", type=Path, help="folder with the motion data archives (for import)")
    parser.add_argument("--clips", type=Path, help="folder of imported clips (default: OUT/clips)")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for checkpoints and the exported model"
    )
    parser.add_argument(
        "--text-encoder", type=Path, metavar="DIR", help="folder of a text encoder (default: the shipped one)"
    )
    parser.add_argument("--device", default="", help="cpu or cuda (default: cuda where there is one)")
    parser.add_argument("--no-half", action="store_true", help="no bf16 mixed precision")
    parser.add_argument("--seed", type=int, default=0)
    for name, value in vars(StageSteps()).items():
        parser.add_argument(
            f"--{name}-steps" if name != "batch" else "--batch", dest=name, type=int, default=value
        )
    parser.add_argument(
        "--processes", type=int, default=1, help="that train stages 2 and 3 together, such as one a core"
    )
    parser.add_argument(
        "--course-minutes",
        type=float,
        default=0.0,
        help="of the model's own traversals, which the stage ground learns from (default: none, and no such stage)",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        metavar="N",
        help="end after N minutes: every stage up to stage3 has its part of them, and its schedule goes by time;"
        " `all` leaves ground and export for later",
    )
    parser.add_argument(
        "--no-graphs", action="store_true", help="compute every step, in place of CUDA graphs on a GPU"
    )
    return parser


def log_progress() -> None:
    """Show what is logged with its time, and nothing of the exporters' own."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    for chatty in ("onnx_ir", "onnxscript", "torch.onnx"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
