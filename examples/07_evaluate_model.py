"""Measures a model without captured data: speed accuracy, foot sliding, and the distance between styles and seeds.

Needs `pip install -e '.[train]'`. Against captured motion: `sport evaluate --clips DIR --model FOLDER`.

    python examples/07_evaluate_model.py [MODEL_FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

from sport import Controller, Controls, Gait, MotionModel, Prompter, Terrain, load_model
from training.evaluation.metrics.features import kinematic_features
from training.evaluation.metrics.feet import foot_skating, skating_means
from training.evaluation.metrics.frechet import Projection, frechet_distance
from training.evaluation.metrics.motion import Motion, mean_speed, window_starts

PROMPTS = ("a proud queen", "a frail old man", "a child pretending to be an aeroplane")
SEEDS, SECONDS, LEAD_IN_S, HOP = (0, 1), 2, 1, 5


def walk(model: MotionModel, z: np.ndarray, seed: int) -> tuple[Motion, float]:
    """Return a walk at full stick on flat ground without its first seconds, and the requested speed in m/s."""
    controller = Controller(model, Terrain.flat(size_m=80.0), seed=seed)
    controller.set_style(z, transition_seconds=0.0)
    stick = Controls(move=(0.0, 1.0))
    poses = [controller.step(stick) for _ in range(60 * (LEAD_IN_S + SECONDS))][60 * LEAD_IN_S :]
    hips, local, contacts = (
        np.stack([getattr(pose, name) for pose in poses])
        for name in ("hips_position", "local_rotations", "contacts")
    )
    gait = np.full(len(poses), int(Gait.WALK))
    return Motion("walk", "", hips, local, contacts, gait, controller.terrain), controller.requested_speed


def main(arguments: list[str]) -> None:
    """Print two tables."""
    model = load_model(Path(arguments[0]) if arguments else None)
    to_style = Prompter(model)
    windows: dict[tuple[str, int], np.ndarray] = {}
    for prompt in PROMPTS:
        for seed in SEEDS:
            motion, requested = walk(model, to_style(prompt), seed)
            slide = skating_means([foot_skating(motion.positions, motion.terrain)])
            share = mean_speed(motion.positions) / requested
            print(
                f"{prompt}, seed {seed}: speed {share:.2f} of the request, soles {slide['soles']:.3f} cm a frame"
            )
            windows[prompt, seed] = kinematic_features(
                motion.root_features(), window_starts(len(motion), HOP)
            )
    projection = Projection.fit(np.concatenate(list(windows.values())), components=8, standardise=True)
    print("Frechet distance of kinematic features: between two seeds, and to another style")
    for prompt, other in zip(PROMPTS, PROMPTS[1:] + PROMPTS[:1], strict=True):
        own, again, apart = (projection(windows[key]) for key in ((prompt, 0), (prompt, 1), (other, 1)))
        print(f"{prompt}: {frechet_distance(own, again):.1f}, {frechet_distance(own, apart):.1f}")


if __name__ == "__main__":
    main(sys.argv[1:])
