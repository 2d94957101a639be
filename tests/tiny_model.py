"""An untrained network of the smallest preset, ready to be exported."""

import numpy as np
import torch

from sport.training.batches import Normalisation
from sport.training.export.model import Trained
from sport.training.networks.content import ContentEncoder
from sport.training.networks.diffusion import Schedule, reverse_steps
from sport.training.networks.generator import Generator
from sport.training.presets import preset


def tiny_trained(seed: int = 7) -> Trained:
    """Random weights and scales."""
    torch.manual_seed(seed)
    config = preset("tiny")
    schedule = Schedule.linear()
    return Trained(
        config,
        ContentEncoder(config).eval(),
        Generator(config).eval(),
        Normalisation(torch.randn(472), torch.rand(472) + 0.5, torch.randn(473), torch.rand(473) + 0.5),
        torch.zeros(384),
        torch.ones(384),
        torch.zeros(385, 2),
        reverse_steps(schedule, schedule.subsequence(5), np.full(5, 0.01)),
        np.zeros(5),
        {"output": [0.0] * 473, "phase": [0.0] * 130},
        [],
        {"clips": 1, "frames": 60, "styles": ["none"], "licence": "none", "seed": 0, "steps": {}},
        {},
        np.full((6, 64), 0.5, np.float32),
        {
            "joint_mean": torch.randn(31, 9),
            "joint_deviation": torch.rand(31, 9) + 0.5,
            "root_deviation": torch.rand(3) + 0.5,
        },
    )
