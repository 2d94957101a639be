"""Arguments of `sport train`; importing them does not import torch."""

import argparse
import logging
from dataclasses import dataclass
from pathlib import Path

from training.presets import ABLATIONS, PRESETS

# of the training time that --minutes allows
FRACTIONS = {"phase": 0.04, "content": 0.16, "words": 0.03, "stage2": 0.63, "stage3": 0.14}
STAGES = ("import", "layer", "phase", "content", "words", "stage2", "stage3", "ground", "export")
DECODERS = ("diffusion", "mixture")
LAYERED_CLIPS = 4600  # number of edited clips


@dataclass
class StageSteps:
    """Optimiser steps of each stage (0: load its existing result); with --minutes, the length of its schedule."""

    phase: int = 1000
    content: int = 2500
    words: int = 2000
    stage2: int = 11000
    stage3: int = 1500
    ground: int = 3000
    batch: int = 1024  # samples per step of stages 2 and 3, over all processes


def build_parser() -> argparse.ArgumentParser:
    """Return the argument parser of `sport train`."""
    parser = argparse.ArgumentParser(
        prog="sport train", description="Train the networks from motion capture; every stage can be resumed."
    )
    parser.add_argument("stage", choices=("all", *STAGES))
    parser.add_argument("--preset", default="compact", help=f"one of {', '.join(PRESETS)}")
    parser.add_argument(
        "--decoder",
        choices=DECODERS,
        default="diffusion",
        help="decoder to export: mixture is stage 2 without diffusion, written to OUT/model-mixture",
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
    parser.add_argument("--device", default="", help="cpu or cuda (default: cuda if available)")
    parser.add_argument("--no-half", action="store_true", help="no bf16 mixed precision")
    parser.add_argument("--seed", type=int, default=0)
    for name, value in vars(StageSteps()).items():
        parser.add_argument(
            f"--{name}-steps" if name != "batch" else "--batch", dest=name, type=int, default=value
        )
    parser.add_argument(
        "--processes", type=int, default=1, help="processes for stages 2 and 3, such as one per core"
    )
    parser.add_argument(
        "--course-minutes",
        type=float,
        default=0.0,
        help="minutes of the model's own traversals, the data of stage ground (default: none, skip that stage)",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        metavar="N",
        help="stop after N minutes: every stage up to stage3 gets a fraction of them, and its schedule follows time;"
        " `all` then omits ground and export",
    )
    parser.add_argument(
        "--no-graphs", action="store_true", help="on a GPU, run every step without CUDA graphs"
    )
    return parser


def log_progress() -> None:
    """Show log messages with their time, without those of the ONNX exporters."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    for chatty in ("onnx_ir", "onnxscript", "torch.onnx"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
