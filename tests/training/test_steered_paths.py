"""Captured paths as a stick gives them: straight or round, and without the sway of the steps."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from runtime.motion.features import FPS, INPUT, INPUT_SIZE, TRAJECTORY_OFFSETS, L  # noqa: E402
from training import rollouts as steered_paths  # noqa: E402
from training.rollouts import steered  # noqa: E402

TIME = np.asarray(TRAJECTORY_OFFSETS) / FPS


def inputs(across: np.ndarray, ahead: np.ndarray, yaw: np.ndarray, count: int = 400) -> torch.Tensor:
    """Rows of x with one path and facing."""
    x = torch.rand(1, INPUT_SIZE).expand(count, -1).clone()
    for name, pair in (
        ("trajectory_positions", (across, ahead)),
        ("trajectory_directions", (np.sin(yaw), np.cos(yaw))),
    ):
        x[:, INPUT[name]] = torch.as_tensor(np.stack(pair, -1).ravel(), dtype=torch.float32)
    return x


def path(x: torch.Tensor) -> np.ndarray:
    return x[:, INPUT["trajectory_positions"]].reshape(len(x), L, 2).numpy()


def test_an_even_path_stays_and_so_does_all_that_is_no_path():
    x = inputs(0.1 * TIME**2, 1.3 * TIME, np.zeros(L))
    y = steered(x)
    np.testing.assert_allclose(y.numpy(), x.numpy(), atol=1e-5)


def test_the_sway_of_steps_shrinks_by_random_shares_and_some_rows_keep_it(monkeypatch):
    torch.manual_seed(0)
    x = inputs(0.03 * np.sin(2 * np.pi * TIME), 1.3 * TIME, 0.1 * np.sin(2 * np.pi * TIME))
    y = steered(x)
    sway = np.ptp(path(y)[..., 0], axis=1) / np.ptp(path(x)[..., 0], axis=1)
    assert 0.25 < (sway > 0.999).mean() < 0.45  # EXACT
    assert sway.min() < 0.6
    facing = y[:, INPUT["trajectory_directions"]].reshape(len(y), L, 2).norm(dim=-1)
    np.testing.assert_allclose(facing.numpy(), 1.0, atol=1e-5)
    monkeypatch.setattr(steered_paths, "EXACT", 1.0)
    assert torch.equal(steered(x)[:, INPUT["trajectory_positions"]], x[:, INPUT["trajectory_positions"]])
