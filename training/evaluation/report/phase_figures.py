"""Fig. 6 and 7 of three kinds of phases, drawn from what `training.evaluation.phase_spaces` measured."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.motion.features import C

Codes = dict[str, dict[int, tuple[Array, Array, Array]]]  # by kind of phase and style
DPI = 110
PERPLEXITY = 30.0


def draw(
    folder: Path,
    spaces: dict[str, Array],
    styles: Array,
    names: Sequence[str],
    figures: dict[str, Any],
    codes: tuple[Codes, Codes],
    seed: int,
) -> list[Path]:
    """Write `fig6_phase_spaces.png` and `fig7_channels.png` into `folder`; the files.

    `styles` `(N,)` are those of the rows of `spaces`, as places in `names`. `codes` are those of the walks, and of the same walks with one arm held still.
    """
    import matplotlib

    matplotlib.use("Agg")
    folder.mkdir(parents=True, exist_ok=True)
    made = {
        "fig6_phase_spaces": _spaces(spaces, styles, names, figures, seed),
        "fig7_channels": _channels(names, codes),
    }
    paths = []
    for name, figure in made.items():
        path = folder / f"{name}.png"
        figure.savefig(path, dpi=DPI, bbox_inches="tight")
        paths.append(path)
    return paths


def _spaces(
    spaces: dict[str, Array], styles: Array, names: Sequence[str], figures: dict[str, Any], seed: int
) -> Any:
    """t-SNE of what each kind of phase tells of the same windows, coloured by style."""
    from matplotlib import pyplot
    from sklearn.manifold import TSNE

    figure, axes = pyplot.subplots(1, len(spaces), figsize=(15, 5.4))
    for axis, (name, rows) in zip(axes, spaces.items(), strict=True):
        points = TSNE(perplexity=PERPLEXITY, init="pca", random_state=seed).fit_transform(rows)
        for k, style in enumerate(names):
            own = points[styles == k]
            axis.scatter(own[:, 0], own[:, 1], s=7, color=pyplot.cm.tab10(k), label=style.replace("_", " "))
        axis.set(title=f"{name}\nsilhouette {figures[name]['silhouette']:.2f}", xticks=[], yticks=[])
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=len(labels), markerscale=3.0, frameon=False)
    figure.subplots_adjust(bottom=0.1, wspace=0.05)
    return figure


def _channels(names: Sequence[str], codes: tuple[Codes, Codes]) -> Any:
    """Amplitude (over the largest) and frequency of five channels: a walk, the same with one arm held, another style."""
    from matplotlib import pyplot

    walked, held = codes
    kinds = list(walked)
    plain = names.index("neutral") if "neutral" in names else 0
    other = next(k for k, style in enumerate(names) if style in ("chicken", "drunk") or k == plain + 1)
    figure, axes = pyplot.subplots(len(kinds), 2, figsize=(12, 6.4), squeeze=False)
    for row, kind in enumerate(kinds):
        shown = {
            names[plain].replace("_", " "): (walked[kind][plain], "#1864ab"),
            "the same, left arm held still": (held[kind][plain], "#74c0fc"),
            names[other].replace("_", " "): (walked[kind][other], "#e8590c"),
        }
        most = max(code[1].mean(0).max() for code, _ in shown.values())
        for bar, (label, (code, colour)) in enumerate(shown.items()):
            at = np.arange(C) + 0.27 * (bar - 1)
            for axis, values in ((axes[row, 0], code[1] / most), (axes[row, 1], code[2])):
                axis.bar(at, values.mean(0), 0.25, yerr=values.std(0), color=colour, capsize=2, label=label)
        axes[row, 0].set_ylabel(f"{kind}\namplitude")
        axes[row, 1].set_ylabel("frequency (Hz)")
        for axis in axes[row]:
            axis.set_xticks(np.arange(C), [f"channel {k + 1}" for k in range(C)])
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=3, frameon=False)
    figure.tight_layout(rect=(0, 0.05, 1, 1))
    return figure
