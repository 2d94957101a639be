"""Paths as a stick gives them: captured ones sway with every step, and a network that reads its step off them loses it.

Along captured paths a character swings as far as the capture; led by a stick, whose path is straight and even, hands and
feet swung a fifth less at the same speed. So what is read of past and coming path is smoothed by random shares in training.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from runtime.motion.features import FPS, INPUT, TRAJECTORY_OFFSETS, L

EXACT = 0.35  # share of rows whose path stays as captured


def steered(x: Tensor) -> Tensor:
    """Real-valued x `(B, n)` whose paths and facing are drawn towards parabolas through the root, each row by its own share.

    The coming path of most rows is smooth altogether; of the past, which the character walked itself, a random part is.
    """
    count = len(x)
    free = (torch.rand(count, 1, device=x.device) >= EXACT).float()
    past = free * torch.rand(count, 1, device=x.device)
    coming = free * (1.5 * torch.rand(count, 1, device=x.device)).clamp_max(1.0)
    ahead = torch.as_tensor(TRAJECTORY_OFFSETS > 0, device=x.device)
    share = torch.where(ahead, coming, past)[..., None]
    result = x.clone()
    for name, fit in zip(("trajectory_positions", "trajectory_directions"), _fits(x.device), strict=True):
        values = x[:, INPUT[name]].unflatten(1, (L, 2))
        values = values + share * (fit @ values - values)
        if name == "trajectory_directions":
            values = torch.nn.functional.normalize(values, dim=-1)
        result[:, INPUT[name]] = values.flatten(1)
    return result


@lru_cache(2)
def _fits(device: torch.device) -> tuple[Tensor, Tensor]:
    """Least-squares parabolas of the 12 samples as `(12, 12)`: of positions through the root, of directions free."""
    time = np.asarray(TRAJECTORY_OFFSETS) / FPS
    powers = np.stack([time**k for k in range(3)], 1)
    fits = [basis @ np.linalg.pinv(basis) for basis in (powers[:, 1:], powers)]
    return tuple(torch.as_tensor(f, dtype=torch.float32, device=device) for f in fits)  # type: ignore[return-value]
