"""Fig. 8: single parts of a style on a neutral body, and how straight a blend goes, a row for each model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from training.data.contact_sheet import draw_figure
from training.evaluation.motion.subject import Subject
from training.evaluation.report.figures import DPI, FONT, blend_walk

LEFT_FOOT, RIGHT_FOOT = 4, 9


Codes = dict[str, Array]  # Z^t `(6, 64)` by what is written over its pose


def draw(folder: Path, shown: Sequence[tuple[Subject, Codes]], results: dict[str, Any], seed: int) -> Path:
    """Write `fig8_contrast.png`: for each model a stride under each of its codes, then the blends of `results`."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    folder.mkdir(parents=True, exist_ok=True)
    columns = max(len(codes) for _, codes in shown)
    with matplotlib.rc_context(FONT):
        figure = pyplot.figure(figsize=(17, 3.9 * len(shown)))
        widths = [1.0] * columns + [1.5]
        grid = figure.add_gridspec(len(shown), columns + 1, width_ratios=widths, wspace=0.05, hspace=0.25)
        for row, (subject, codes) in enumerate(shown):
            for column, (title, z) in enumerate(codes.items()):
                axis = figure.add_subplot(grid[row, column])
                draw_figure(axis, *_stride(subject, z, seed))
                axis.set_title(title, fontsize=11)
                if not column:
                    axis.text(-0.75, 0.6, subject.name, rotation=90, va="center", fontweight="bold")
            _blends(figure.add_subplot(grid[row, -1]), results[subject.name]["blends"])
        path = folder / "fig8_contrast.png"
        figure.savefig(path, dpi=DPI, bbox_inches="tight")
        pyplot.close(figure)
    return path


def _stride(subject: Subject, z: Array, seed: int) -> tuple[Array, Array]:
    """The joints `(31, 3)` and contacts `(4,)` of a walk where the left foot is farthest ahead."""
    joints, contacts = blend_walk(subject.model, z, seed)
    moment = int(np.argmax(joints[:, LEFT_FOOT, 2] - joints[:, RIGHT_FOOT, 2]))
    return joints[moment], contacts[moment] > 0.5


def _blends(axis: Any, blends: list[dict[str, Any]]) -> None:
    """Where each style's blends lie between neutral and the style, and the straight line."""
    for style in dict.fromkeys(b["style"] for b in blends):
        own = [(b["share"], b["found"]) for b in blends if b["style"] == style]
        axis.plot(
            *zip((0.0, 0.0), *own, (1.0, 1.0), strict=True), marker="o", ms=3, label=style.replace("_", " ")
        )
    axis.plot([0, 1], [0, 1], "--", color="#868e96")
    axis.set(xlabel="t", ylabel="found between", xlim=(0, 1), ylim=(0, 1))
    axis.yaxis.set_label_position("right")
    axis.yaxis.tick_right()
    axis.legend(frameon=False, fontsize=8)
