"""Diffusion in five steps (Sec. III-E): schedule, forward process, reverse step with the Analytic-DPM variance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from training.gpu import constant


@dataclass(frozen=True)
class Schedule:
    """`alpha_bar` `(N + 1,)`: cumulative product of alpha_n = 1 - beta_n, with alpha_bar[0] = 1; beta_bar = 1 - alpha_bar."""

    alpha_bar: NDArray[np.float64]

    @staticmethod
    def linear(steps: int = 1000, first: float = 1e-4, last: float = 0.02) -> Schedule:
        """The usual linear beta schedule over N steps."""
        beta = np.linspace(first, last, steps)
        return Schedule(np.concatenate([[1.0], np.cumprod(1.0 - beta)]))

    def alpha_bars(self, like: Tensor) -> Tensor:
        """Return `alpha_bar` `(N + 1,)` with the device and dtype of `like`."""
        return constant(self.alpha_bar.tolist(), like.device, like.dtype)

    def subsequence(self, count: int) -> NDArray[np.int64]:
        """Return tau, `count` evenly spaced steps that end at N."""
        n = len(self.alpha_bar) - 1
        return np.round(np.arange(1, count + 1) * n / count).astype(np.int64)


def add_noise(schedule: Schedule, clean: Tensor, step: Tensor, noise: Tensor) -> Tensor:
    """Sample q(Z_n | Z_0): codes `(B, K, n)` at step `(B,)`."""
    alpha_bar = schedule.alpha_bars(clean)[step][:, None, None]
    return alpha_bar.sqrt() * clean + (1.0 - alpha_bar).sqrt() * noise


def noise_estimate(schedule: Schedule, noisy: Tensor, clean: Tensor, step: Tensor) -> Tensor:
    """Return epsilon_theta from the predicted Z_0: Eq. 6 solved for the noise."""
    alpha_bar = schedule.alpha_bars(noisy)[step][:, None, None]
    return (noisy - alpha_bar.sqrt() * clean) / (1.0 - alpha_bar).sqrt()


@dataclass(frozen=True)
class ReverseStep:
    """One reverse step tau_n -> tau_{n-1}: Z' = `clean` * Z_0 + `noisy` * Z + `deviation` * fresh noise."""

    step: int
    clean: float
    noisy: float
    deviation: float


def reverse_steps(
    schedule: Schedule, tau: NDArray[np.int64], sigma_bar_squared: NDArray[np.float64] | None
) -> list[ReverseStep]:
    """Return the coefficients of Eq. 5 for tau_dim ... tau_1, with lambda of Sec. III-G for the subsequence.

    `sigma_bar_squared` `(len(tau),)` is the Monte Carlo estimate of Analytic-DPM per step of tau; None uses plain
    lambda^2. The last step leads to n = 0, where the prediction itself is the sample.
    """
    result = []
    for n in range(len(tau) - 1, -1, -1):
        now = schedule.alpha_bar[tau[n]]
        before = schedule.alpha_bar[tau[n - 1]] if n else 1.0
        if n == 0:
            result.append(ReverseStep(int(tau[n]), 1.0, 0.0, 0.0))
            continue
        variance = (1.0 - before) / (1.0 - now) * (1.0 - now / before)  # lambda^2
        kappa = np.sqrt((1.0 - before - variance) / (1.0 - now))
        # sqrt(before) Z_0 + sqrt(beta_bar_before - lambda^2) epsilon, epsilon by Eq. 6
        clean = np.sqrt(before) - kappa * np.sqrt(now)
        if sigma_bar_squared is not None:
            variance = variance + clean**2 * float(sigma_bar_squared[n])
        result.append(ReverseStep(int(tau[n]), float(clean), float(kappa), float(np.sqrt(variance))))
    return result


def analytic_variance(schedule: Schedule, step: int, noise_norms: Tensor) -> float:
    """Return sigma_bar_n^2 = beta_bar/alpha_bar (1 - E||epsilon||^2 / d), clipped at 0; `noise_norms` are ||epsilon||^2 / d."""
    alpha_bar = schedule.alpha_bar[step]
    return float((1.0 - alpha_bar) / alpha_bar * max(0.0, 1.0 - noise_norms.double().mean().item()))
