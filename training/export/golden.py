"""Golden vectors of the shipped model, to verify a controller in another language (`docs/engine.md`).

python -m training.export.golden assets/golden_step.npz
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import atomic_path
from runtime.controls import Controls, Gait
from runtime.motion.controller import Controller
from runtime.motion.model import MotionModel, load_model
from runtime.motion.style import Style
from runtime.motion.swing import PLAIN
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.library import load_terrain

STICK = (
    (0.0, 0.0, Gait.WALK, 15),
    (0.0, 1.0, Gait.WALK, 75),
    (0.8, 0.6, Gait.JOG, 60),
    (0.0, 0.0, Gait.WALK, 30),
)
KEPT = (10, 80, 140)  # frames whose network step is stored: standing, walking, jogging
TEMPERATURE = 0.7


class _Listened:
    """A model that records the inputs of its steps."""

    def __init__(self, model: MotionModel) -> None:
        self._model, self.inputs = model, list[NDArray[np.float32]]()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)

    def fold_style(self, z: NDArray[np.float32], strength: float = 1.0) -> Style:
        """Fold a style without swing gains, which only concern the display of this program."""
        return replace(self._model.fold_style(z, strength), swings=PLAIN)

    def step(self, x: NDArray[np.float32], noise: NDArray[np.float32], style: Style | Sequence[Style]) -> Any:
        self.inputs.append(x)
        return self._model.step(x, noise, style)


def golden_vectors(model: MotionModel) -> dict[str, NDArray[Any]]:
    """Named arrays: steps of the network in full precision, and a motion of the controller without noise.

    `z` `(6, 64)`; `x` `(3, 472)`, `noise` `(3, 5, 8, 473)` (float16, exact), `y` `(3, 473)`; `stick` `(T, 3)` (x, z, gait),
    `motion` `(T, 31, 3)`: joints before foot lock, metres, from the start; `offsets` `(31, 3)`, `parents` `(31,)`.
    """
    listened = _Listened(model)
    controller = Controller(listened, load_terrain("flat"), temperature=0.0)  # type: ignore[arg-type]
    controller.set_style(model.neutral, 0.0)
    stick = [(x, z, int(gait)) for x, z, gait, frames in STICK for _ in range(frames)]
    motion = []
    for x, z, gait in stick:
        controller.step(Controls((x, z), gait=Gait(gait)))
        hips, local = controller.unlocked
        motion.append(SPORT_SKELETON.forward_kinematics(hips, local)[0])
    inputs = np.concatenate([listened.inputs[frame] for frame in KEPT])
    noise = np.random.default_rng(0).standard_normal((len(KEPT), *model.noise_shape)) * TEMPERATURE
    noise = noise.astype(np.float16)
    style = controller.style
    return {
        "z": model.neutral,
        "x": inputs,
        "noise": noise,
        "y": np.concatenate(
            [
                model.step(inputs[k, None], noise[k, None].astype(np.float32), style)[0]
                for k in range(len(KEPT))
            ]
        ),
        "stick": np.array(stick, np.float32),
        "motion": np.array(motion, np.float32),
        "offsets": SPORT_SKELETON.offsets,
        "parents": np.array(SPORT_SKELETON.parents, np.int32),
    }


def main() -> None:
    """Run the command line above."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path)
    path = parser.parse_args().path
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **golden_vectors(load_model(precision="fp32")))  # type: ignore[arg-type]
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
