"""The paper's Fig. 6, 7 and 8 for a model of ours: `sport evaluate --figures DIR`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.controls import Controls
from runtime.motion import features
from runtime.motion.controller import Controller
from runtime.motion.features import FPS, split_output
from runtime.motion.model import MotionModel
from runtime.motion.motion_encoder import ExportedMotionEncoder
from runtime.skeleton import SPORT_SKELETON
from training.data.contact_sheet import draw_figure
from training.evaluation.metrics.features import has_encoder, window_set
from training.evaluation.metrics.frechet import Projection
from training.evaluation.motion.capture import Capture, driving_segments, read_capture, style_texts
from training.evaluation.motion.driving import LEAD_IN_FRAMES, flat_ground
from training.evaluation.motion.evaluated_model import EvaluatedModel

Report = Callable[[str], None]

EMBEDDED_STYLES = 12  # those with the most training capture
EMBEDDED_SECONDS = 30.0
PHASE_STYLES = ("neutral", "masculine2", "chicken")  # the first two alike, the third not
PHASE_SECONDS = 4.0
BETWEEN = ("neutral", "aeroplane")
STEPS = 7
FONT: dict[Any, Any] = {"font.size": 12, "axes.titlesize": 13}
DPI = 110


def draw_figures(clips: Path, model: Path, out: Path, seed: int, report: Report) -> list[Path]:
    """Write `fig6_embeddings.png`, `fig7_phases.png` and `fig8_interpolation.png`; the files."""
    import matplotlib

    matplotlib.use("Agg")
    capture = read_capture(clips)
    subject = EvaluatedModel(model, style_texts(set(capture.groups) | {*PHASE_STYLES, *BETWEEN}))
    drawn = []
    with matplotlib.rc_context(FONT):
        for name, figure in (
            ("fig6_embeddings", lambda: _embeddings(capture, subject, seed)),
            ("fig7_phases", lambda: _phases(subject, seed)),
            ("fig8_interpolation", lambda: _interpolation(subject, seed)),
        ):
            report(f"figure {name}")
            path = out / f"{name}.png"
            made = figure()
            made.savefig(path, dpi=DPI, bbox_inches="tight")
            drawn.append(path)
    return drawn


# --- Fig. 6 ----------------------------------------------------------------------------------------------------------


def _embeddings(capture: Capture, subject: EvaluatedModel, seed: int) -> Any:
    """t-SNE of captured windows in the space of the motion encoder, and of the descriptions' Z^t, by style."""
    from matplotlib import pyplot
    from sklearn.manifold import TSNE

    styles = _most_captured(capture)
    encoder = ExportedMotionEncoder(subject.folder) if has_encoder(subject.folder) else None
    rows, labels = [], []
    for number, style in enumerate(styles):
        parts = driving_segments(capture, style, EMBEDDED_SECONDS, seed)
        windows = window_set((s.load() for s in parts), encoder, hop=20)
        rows.append(windows.of("kinematic" if encoder is None else "encoder"))
        labels += [number] * len(windows)
    motion = np.concatenate(rows)
    motion = Projection.fit(motion, 32, encoder is None)(motion)
    texts = [
        (number, subject.style(style, k).ravel())
        for number, style in enumerate(styles)
        for k in range(len(subject.texts[style]))
    ]
    words = np.stack([z for _, z in texts])
    figure, axes = pyplot.subplots(1, 2, figsize=(13, 6))
    titles = (
        f"captured windows, {'kinematic features' if encoder is None else 'motion encoder'}",
        "descriptions, Z$^t$",
    )
    for axis, title, values, colours, size in (
        (axes[0], titles[0], motion, labels, 8),
        (axes[1], titles[1], words, [number for number, _ in texts], 40),
    ):
        perplexity = min(30.0, (len(values) - 1) / 4)
        points = TSNE(perplexity=perplexity, init="pca", random_state=seed).fit_transform(values)
        for number, style in enumerate(styles):
            own = points[np.asarray(colours) == number]
            axis.scatter(own[:, 0], own[:, 1], s=size, color=pyplot.cm.tab20(number), label=style)
        axis.set(title=title, xticks=[], yticks=[])
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="lower center", ncols=6, markerscale=3.0, frameon=False)
    figure.subplots_adjust(bottom=0.16, wspace=0.05)
    return figure


def _most_captured(capture: Capture) -> list[str]:
    frames = {g: sum(c.frames for c in capture.of(g, False)) for g in capture.groups}
    return sorted(sorted(frames, key=lambda g: -frames[g])[:EMBEDDED_STYLES])


# --- Fig. 7 ----------------------------------------------------------------------------------------------------------


class PhaseTap:
    """A model that notes the phase vectors (Eq. 1) of every frame that it gives."""

    def __init__(self, model: MotionModel) -> None:
        self._model = model
        self.phases: list[Array] = []  # (5, 2) each

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)

    def step(self, x: Array, noise: Array, style: Any) -> tuple[Array, Array]:
        """The model's frame."""
        y, alpha = self._model.step(x, noise, style)
        self.phases.append(split_output(y[0]).phase[0])
        return y, alpha


def phase_curves(model: MotionModel, z: Array, seconds: float, seed: int) -> Array:
    """Phase vectors `(T, 5, 2)` while walking straight ahead in style Z^t `(6, 64)`."""
    tap = PhaseTap(model)
    controller = Controller(tap, flat_ground(), seed)  # type: ignore[arg-type]
    controller.set_style(z, 0.0)
    for _ in range(LEAD_IN_FRAMES + round(seconds * FPS)):
        controller.step(Controls((0.0, 1.0)))
    return np.stack(tap.phases[LEAD_IN_FRAMES:])


def _phases(subject: EvaluatedModel, seed: int) -> Any:
    from matplotlib import pyplot

    figure, grid = pyplot.subplots(
        features.C, len(PHASE_STYLES), figsize=(13, 9), sharex=True, sharey="row", squeeze=False
    )
    for column, style in enumerate(PHASE_STYLES):
        curves = phase_curves(subject.model, subject.style(style, 0), PHASE_SECONDS, seed)
        time = np.arange(len(curves)) / FPS
        for channel, axis in enumerate(grid[:, column]):
            sine, amplitude = curves[:, channel, 0], np.linalg.norm(curves[:, channel], axis=-1)
            axis.fill_between(time, -amplitude, amplitude, color="#d0ebff")
            axis.plot(time, sine, color="#1864ab", lw=1.6)
            turns = np.unwrap(np.arctan2(curves[:, channel, 0], curves[:, channel, 1]))
            frequency = abs(turns[-1] - turns[0]) / (2 * np.pi * time[-1])
            axis.set_title(f"{frequency:.2f} Hz, a = {amplitude.mean():.2f}", loc="right", fontsize=11)
            if column == 0:
                axis.set_ylabel(f"channel {channel + 1}")
        grid[0, column].set_title(style, loc="left", fontweight="bold")
        grid[-1, column].set_xlabel("seconds")
    figure.suptitle("a sin 2πs (line) and ±a (band) of the five phase channels, walking", fontsize=13)
    figure.tight_layout()
    return figure


# --- Fig. 8 ----------------------------------------------------------------------------------------------------------


def blend_walk(model: MotionModel, z: Array, seed: int) -> tuple[Array, Array]:
    """Joints relative to the root `(T, 31, 3)` and contacts `(T, 4)` of four seconds of walking in Z^t."""
    controller = Controller(model, flat_ground(), seed)
    controller.set_style(z, 0.0)
    joints, contacts = [], []
    for frame in range(LEAD_IN_FRAMES + 4 * FPS):
        pose = controller.step(Controls((0.0, 1.0)))
        if frame >= LEAD_IN_FRAMES:
            root, yaw = pose.root_position, np.array(pose.root_yaw)
            joints.append(features.relative_joints(pose.positions, root[[0, 2]], root[1], yaw))
            contacts.append(pose.contacts)
    return np.stack(joints), np.stack(contacts)


def hand_height(joints: Array) -> Array:
    """Mean height of both hands over the ground `(T,)` in cm."""
    hands = [SPORT_SKELETON.index("LeftHand"), SPORT_SKELETON.index("RightHand")]
    return 100.0 * joints[:, hands, 1].mean(1)


def _interpolation(subject: EvaluatedModel, seed: int) -> Any:
    from matplotlib import pyplot

    first, second = (subject.style(s, 0) for s in BETWEEN)
    shares = np.linspace(0.0, 1.0, STEPS)
    figure = pyplot.figure(figsize=(14, 7.5))
    grid = figure.add_gridspec(2, STEPS, height_ratios=(1.25, 1.0), hspace=0.12, wspace=0.0)
    heights = []
    for column, share in enumerate(shares):
        joints, contacts = blend_walk(subject.model, (1 - share) * first + share * second, seed)
        heights.append(hand_height(joints))
        moment = int(np.argmax(joints[:, 4, 2] - joints[:, 9, 2]))  # the left foot farthest ahead
        axis = figure.add_subplot(grid[0, column])
        draw_figure(axis, joints[moment], contacts[moment] > 0.5)
        axis.set_title(f"t = {share:.2f}")
    means, spread = np.array([h.mean() for h in heights]), np.array([h.std() for h in heights])
    axis = figure.add_subplot(grid[1, 1:-1])
    axis.errorbar(shares, means, spread, marker="o", capsize=4, color="#1864ab", label="generated")
    axis.plot([0, 1], means[[0, -1]], "--", color="#868e96", label="straight line")
    axis.set(xlabel=f"t: (1 − t) Z({BETWEEN[0]}) + t Z({BETWEEN[1]})", ylabel="height of the hands (cm)")
    axis.grid(alpha=0.3)
    axis.legend(frameon=False)
    return figure
