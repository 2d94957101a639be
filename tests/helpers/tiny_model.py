"""An untrained network of the smallest preset, ready to be exported."""

import numpy as np
import torch

from training.batches import Normalisation
from training.export.model import Trained
from training.networks.content import ContentEncoder
from training.networks.diffusion import Schedule, reverse_steps
from training.networks.generator import Generator
from training.presets import preset


def tiny_trained(seed: int = 7) -> Trained:
    """Return random weights and scales."""
    torch.manual_seed(seed)
    config = preset("tiny")
    schedule = Schedule.linear()
    return Trained(
        config=config,
        content=ContentEncoder(config).eval(),
        generator=Generator(config).eval(),
        normal=Normalisation(
            torch.randn(472), torch.rand(472) + 0.5, torch.randn(473), torch.rand(473) + 0.5
        ),
        style_centre=torch.zeros(384),
        style_deviation=torch.ones(384),
        speeds=torch.zeros(385, 2),
        steps=reverse_steps(schedule, schedule.subsequence(5), np.full(5, 0.01)),
        sigma_bar_squared=np.zeros(5),
        start={"output": [0.0] * 473, "phase": [0.0] * 130},
        credits=[],
        notes={"clips": 1, "frames": 60, "styles": ["none"], "licence": "none", "seed": 0, "steps": {}},
        curves={},
        neutral=np.full((6, 64), 0.5, np.float32),
        sequence_scales={
            "joint_mean": torch.randn(31, 9),
            "joint_deviation": torch.rand(31, 9) + 0.5,
            "root_deviation": torch.rand(3) + 0.5,
        },
    )
