"""Draws the paper's Fig. 6, 7 and 8 of `docs/evaluation.md`: `python docs/make_figures.py CLIPS [MODEL]`."""

import sys
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib import pyplot
from sklearn.manifold import TSNE

from runtime.arrays import Array
from runtime.assets import model_folder
from runtime.controls import Controls
from runtime.motion import features
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import ExportedMotionEncoder
from runtime.motion.trajectory import PRESENT
from runtime.skeleton import SPORT_SKELETON
from training.data.contact_sheet import draw_figure
from training.evaluation.metrics.features import window_set
from training.evaluation.metrics.frechet import Projection
from training.evaluation.motion.capture import driving_segments, read_capture
from training.evaluation.motion.driving import LEAD_IN_FRAMES, flat_ground
from training.evaluation.motion.evaluated_model import EvaluatedModel, style_texts

IMAGES = Path(__file__).parent / "images"
PHASE_STYLES = ("neutral", "masculine2", "chicken")  # the first two alike, the third not
BETWEEN = ("neutral", "aeroplane")
HANDS = [SPORT_SKELETON.index(name) for name in ("LeftHand", "RightHand")]


def walk(model: EvaluatedModel, z: Array) -> tuple[Array, Array, Array]:
    """Joints `(T, 31, 3)` relative to the root, contacts `(T, 4)` and phases `(T, 5, 2)` of four seconds in Z^t."""
    controller = Controller(model.model, flat_ground(), 0)
    controller.set_style(z, 0.0)
    frames = []
    for _ in range(LEAD_IN_FRAMES + 4 * FPS):
        pose = controller.step(Controls((0.0, 1.0)))
        root, yaw = pose.root_position, np.array(pose.root_yaw)
        joints = features.relative_joints(pose.positions, root[[0, 2]], root[1], yaw)
        frames.append((joints, pose.contacts, controller.state.phase[0, PRESENT].copy()))
    joints, contacts, phases = (np.stack(values) for values in zip(*frames[LEAD_IN_FRAMES:], strict=True))
    return joints, contacts, phases


def embeddings(clips: Path, model: EvaluatedModel) -> Any:
    """Fig. 6: t-SNE of captured windows in the motion encoder's space, and of Z^t, of the twelve most captured styles."""
    capture = read_capture(clips)
    seconds = {group: sum(c.frames for c in capture.of(group, False)) for group in capture.groups}
    styles = sorted(sorted(seconds, key=lambda group: -seconds[group])[:12])
    encoder = ExportedMotionEncoder(model.folder)
    windows = [
        window_set((s.load() for s in driving_segments(capture, style, 30.0)), encoder, hop=20).encoder
        for style in styles
    ]
    motion, texts = np.concatenate(windows), [model.texts[style] for style in styles]
    words = np.stack(
        [model.style(s, k).ravel() for s, ts in zip(styles, texts, strict=True) for k in range(len(ts))]
    )
    figure, axes = pyplot.subplots(1, 2, figsize=(13, 6))
    for axis, title, values, counts, size in (
        (axes[0], "captured windows, motion encoder", Projection.fit(motion, 32, False)(motion), windows, 8),
        (axes[1], "descriptions, Z$^t$", words, texts, 40),
    ):
        points = TSNE(perplexity=min(30.0, (len(values) - 1) / 4), init="pca", random_state=0).fit_transform(
            values
        )
        ends = np.cumsum([0, *map(len, counts)])
        for number, style in enumerate(styles):
            own = points[ends[number] : ends[number + 1]]
            axis.scatter(own[:, 0], own[:, 1], s=size, color=pyplot.cm.tab20(number), label=style)
        axis.set(title=title, xticks=[], yticks=[])
    figure.legend(*axes[0].get_legend_handles_labels(), loc="lower center", ncols=6, frameon=False)
    figure.subplots_adjust(bottom=0.16, wspace=0.05)
    return figure


def phases(model: EvaluatedModel) -> Any:
    """Fig. 7: sine and amplitude of the five phase channels of three styles."""
    figure, grid = pyplot.subplots(features.C, len(PHASE_STYLES), figsize=(13, 9), sharex=True, sharey="row")
    for column, style in enumerate(PHASE_STYLES):
        curves = walk(model, model.style(style, 0))[2]
        time = np.arange(len(curves)) / FPS
        for channel, axis in enumerate(grid[:, column]):
            amplitude = np.linalg.norm(curves[:, channel], axis=-1)
            axis.fill_between(time, -amplitude, amplitude, color="#d0ebff")
            axis.plot(time, curves[:, channel, 0], color="#1864ab", lw=1.6)
            turns = np.unwrap(np.arctan2(*curves[:, channel].T))
            frequency = abs(turns[-1] - turns[0]) / (2 * np.pi * time[-1])
            axis.set_title(f"{frequency:.2f} Hz, a = {amplitude.mean():.2f}", loc="right", fontsize=11)
        grid[0, column].set_title(style, loc="left", fontweight="bold")
        grid[-1, column].set_xlabel("seconds")
    figure.tight_layout()
    return figure


def interpolation(model: EvaluatedModel) -> Any:
    """Fig. 8: walks in seven steps between two styles, and the height of their hands."""
    first, second = (model.style(style, 0) for style in BETWEEN)
    steps, heights = np.linspace(0.0, 1.0, 7), []
    figure = pyplot.figure(figsize=(14, 7.5))
    grid = figure.add_gridspec(2, len(steps), height_ratios=(1.25, 1.0), hspace=0.12, wspace=0.0)
    for column, t in enumerate(steps):
        joints, contacts, _ = walk(model, (1 - t) * first + t * second)
        heights.append(100.0 * joints[:, HANDS, 1].mean(1))
        moment = int(np.argmax(joints[:, 4, 2] - joints[:, 9, 2]))  # the left foot farthest ahead
        axis = figure.add_subplot(grid[0, column])
        draw_figure(axis, joints[moment], contacts[moment] > 0.5)
        axis.set_title(f"t = {t:.2f}")
    axis = figure.add_subplot(grid[1, 1:-1])
    axis.errorbar(steps, np.mean(heights, 1), np.std(heights, 1), marker="o", capsize=4, label="generated")
    axis.plot([0, 1], [heights[0].mean(), heights[-1].mean()], "--", color="#868e96", label="straight line")
    axis.set(xlabel=f"t: (1 − t) Z({BETWEEN[0]}) + t Z({BETWEEN[1]})", ylabel="height of the hands (cm)")
    axis.legend(frameon=False)
    return figure


if __name__ == "__main__":
    matplotlib.use("Agg")
    evaluated = EvaluatedModel(Path(sys.argv[2]) if sys.argv[2:] else model_folder(), style_texts())
    embeddings(Path(sys.argv[1]), evaluated).savefig(
        IMAGES / "fig6_embeddings.png", dpi=110, bbox_inches="tight"
    )
    phases(evaluated).savefig(IMAGES / "fig7_phases.png", dpi=110, bbox_inches="tight")
    interpolation(evaluated).savefig(IMAGES / "fig8_interpolation.png", dpi=110, bbox_inches="tight")
