"""Fig. 6 and 7 with their rivals: the phases of PFNN (footsteps), PAE and BP-PAE over the same captured walks.

    python -m training.evaluation phases --clips DIR --run RUN --rival PAE=RUNS/pae/seed0 --figures docs/images --markdown docs/results/phases.md

`--run` and the rivals are folders of runs whose stage 0 is trained on the same clips, PAE's with `--ablation pae`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from runtime.arrays import Array
from runtime.errors import FileError, UsageError
from runtime.motion.features import OUTPUT, PHASE_OFFSETS, C
from runtime.skeleton import PART_JOINTS, SPORT_SKELETON
from training.baselines.phases import FOOTSTEP, phase_vectors
from training.evaluation.experiment import Arguments, Experiment, Setting
from training.frames import LAYERED, FrameTable, load_frames
from training.markdown import number, table
from training.networks.phase import WINDOW, PeriodicAutoencoder
from training.presets import ModelConfig
from training.session import load_checkpoint

STYLES = 7  # those with the most windows that walk
WINDOWS = 150  # of a style
MOVING = 0.6  # m/s of the root: a walk
DIFFERS = 1.0  # pooled standard deviations between the means of a channel's amplitude or frequency
ARM = "left_arm"  # the part that is held still for Fig. 7
HALF = WINDOW // 2
FOOTSTEPS, OURS = "footstep phase (PFNN)", "BP-PAE"


@dataclass(frozen=True)
class Walks:
    """Centres `(N,)` of captured windows that walk, and their styles."""

    rows: Array
    styles: Array
    names: tuple[str, ...]


def walks_of(frames: FrameTable, seed: int) -> Walks:
    """As many windows of each of the styles with the most; none of edited or mirrored clips."""
    random = np.random.default_rng(seed)
    velocity = frames.y[:, OUTPUT["root"]][:, :2].astype(np.float32)
    found: dict[str, list[Array]] = {}
    for k, style in enumerate(frames.styles):
        if frames.contents[k].startswith(LAYERED) or frames.mirrored[k]:
            continue
        first, end = int(frames.start[k]) + WINDOW, int(frames.start[k + 1]) - WINDOW
        at = np.arange(first, end, 20)
        if len(at):
            moving = np.linalg.norm(velocity[at], axis=-1) > MOVING
            found.setdefault(style, []).append(at[moving])
    joined = {style: np.concatenate(each) for style, each in found.items()}
    rows = {style: each for style, each in joined.items() if len(each) >= WINDOWS}
    chosen = sorted(sorted(rows, key=lambda style: -len(rows[style]))[:STYLES])
    if len(chosen) < 2:
        raise FileError("clips: too few walks to compare.", "Import the whole of the motion data.")
    drawn = [np.sort(random.choice(rows[style], WINDOWS, replace=False)) for style in chosen]
    return Walks(np.concatenate(drawn), np.repeat(np.arange(len(chosen)), WINDOWS), tuple(chosen))


@dataclass(frozen=True)
class Autoencoder:
    """A trained periodic autoencoder and the scale of its velocities."""

    module: PeriodicAutoencoder
    scale: float

    @staticmethod
    def of(run: Path) -> Autoencoder:
        """Of a run's folder; FileError before its stage 0."""
        path = run / "phase_final.pt"
        if not path.exists():
            raise FileError(f"{path}: missing.", "Train stage 'phase' there first.")
        stored = load_checkpoint(path)
        known = ModelConfig.__dataclass_fields__
        module = PeriodicAutoencoder(ModelConfig(**{k: v for k, v in stored["config"].items() if k in known}))
        module.load_state_dict(stored["module"])
        return Autoencoder(module.eval(), float(stored["scale"]))

    @torch.no_grad()
    def encode(self, velocities: Array) -> tuple[Array, Array, Array]:
        """Phase vectors `(N, 5, 2)`, amplitudes and frequencies (Hz) `(N, 5)` of windows `(N, 121, 31, 3)` in m/s."""
        windows = torch.as_tensor(velocities, dtype=torch.float32) / self.scale
        amplitude, frequency, _, _ = self.module.encode(windows)
        return self.module.phase_vectors(windows).numpy(), amplitude.numpy(), frequency.numpy()

    @torch.no_grad()
    def error(self, velocities: Array) -> float:
        """Root mean square of what five sinusoids leave of windows `(N, 121, 31, 3)`, m/s."""
        windows = torch.as_tensor(velocities, dtype=torch.float32) / self.scale
        return self.scale * float((self.module(windows) - windows).square().mean().sqrt())


def velocities_around(frames: FrameTable, rows: Array) -> Array:
    """Joint velocities `(N, 121, 31, 3)` of the second before and after."""
    around = rows[:, None] + np.arange(-HALF, HALF + 1)
    flat = frames.y[around.ravel()][:, OUTPUT["joint_velocities"]].astype(np.float32)
    return flat.reshape(*around.shape, -1, 3)


def spaces(frames: FrameTable, walks: Walks, autoencoders: dict[str, Autoencoder]) -> dict[str, Array]:
    """What each kind of phase tells the experts of a window: `(N, 13 * channels * 2)`, by its name."""
    result: dict[str, list[Array]] = {name: [] for name in (FOOTSTEPS, *autoencoders)}
    for row in walks.rows:
        at = row + PHASE_OFFSETS
        clip = int(frames.clip[row])
        first, end = int(frames.start[clip]), int(frames.start[clip + 1])
        contacts = frames.y[first:end, OUTPUT["contacts"]] > 0.5
        result[FOOTSTEPS].append(phase_vectors(contacts)[at - first, FOOTSTEP].ravel())
        windows = velocities_around(frames, np.clip(at, first + HALF, end - 1 - HALF))
        for name, autoencoder in autoencoders.items():
            result[name].append(autoencoder.encode(windows)[0].ravel())
    return {name: np.stack(rows) for name, rows in result.items()}


def arm_held(velocities: Array) -> Array:
    """The same windows with one arm that moves with the chest alone."""
    held = velocities.copy()
    held[:, :, list(PART_JOINTS[ARM])] = held[:, :, [SPORT_SKELETON.index("Spine1")]]
    return held


def differing(one: tuple[Array, Array, Array], other: tuple[Array, Array, Array]) -> Array:
    """Which channels `(5,)` differ between two motions: their mean amplitude or frequency by `DIFFERS` deviations."""
    differs = np.zeros(C, bool)
    for a, b in zip(one[1:], other[1:], strict=True):
        spread = np.sqrt(0.5 * (a.var(0) + b.var(0))) + 1e-9
        differs |= np.abs(a.mean(0) - b.mean(0)) / spread > DIFFERS
    return differs


def _figures(setting: Setting) -> dict[str, Any]:
    from sklearn.metrics import silhouette_score

    args = setting.args
    frames = load_frames(setting.clips, args.run / "frames")
    walks = walks_of(frames, args.seed)
    autoencoders = {name: Autoencoder.of(Path(folder)) for name, folder in _rivals(args)}
    autoencoders[OURS] = Autoencoder.of(args.run)
    setting.report(f"{len(walks.rows)} windows of {', '.join(walks.names)}")
    found = spaces(frames, walks, autoencoders)
    velocities = {
        k: velocities_around(frames, walks.rows[walks.styles == k]) for k in range(len(walks.names))
    }
    pairs = [(a, b) for a in velocities for b in velocities if a < b]
    figures: dict[str, Any] = {
        name: {"silhouette": float(silhouette_score(rows, walks.styles))} for name, rows in found.items()
    }
    codes, held = {}, {}
    for name, each in autoencoders.items():
        one = codes[name] = {k: each.encode(v) for k, v in velocities.items()}
        still = held[name] = {k: each.encode(arm_held(v)) for k, v in velocities.items()}
        figures[name] |= {
            "error": float(np.mean([each.error(v) for v in velocities.values()])),
            "arm": float(np.mean([differing(one[k], still[k]).mean() for k in one])),
            "styles": float(np.mean([differing(one[a], one[b]).mean() for a, b in pairs])),
        }
    if args.figures is not None:
        from training.evaluation.report.phase_figures import draw

        draw(args.figures, found, walks.styles, walks.names, figures, (codes, held), args.seed)
    return figures


def _rivals(args: Arguments) -> list[list[str]]:
    return [rival.split("=", 1) for rival in args.rival or []]


def _table(figures: dict[str, Any]) -> str:
    missing = float("nan")
    rows = [
        [
            name,
            number(found["silhouette"], 3),
            number(100 * found.get("error", missing), 1),
            *(number(found.get(key, missing), 2) for key in ("arm", "styles")),
        ]
        for name, found in figures.items()
    ]
    head = [
        "phases",
        "silhouette by style",
        "velocities that five sines leave (cm/s)",
        "channels that differ, one arm held still",
        "channels that differ, two styles",
    ]
    return "\n".join(table(head, rows))


def _check(args: Arguments) -> None:
    if args.known is not None:
        return
    if args.run is None:
        raise UsageError("--run: no folder of a run is given.", "Add --run DIR.")
    for rival in args.rival or []:
        if "=" not in rival:
            raise UsageError(
                f"--rival {rival}: has no name.", "Write it as NAME=DIR, such as PAE=RUNS/pae/seed0."
            )


PHASES = Experiment(
    "Which phases tell motions and parts apart: footsteps, PAE or BP-PAE.",
    _figures,
    _table,
    section="phases",
    clips=True,
    models=0,
    options=(
        ("--run", {"type": Path, "metavar": "DIR", "help": "run with a trained BP-PAE"}),
        (
            "--rival",
            {"action": "append", "metavar": "NAME=DIR", "help": "run of a variant; several can be given"},
        ),
        (
            "--figures",
            {"type": Path, "metavar": "DIR", "help": "draw fig6_phase_spaces.png and fig7_channels.png"},
        ),
        ("--seed", {"type": int, "default": 0}),
    ),
    check=_check,
)
