"""Reverse steps against the equations, on distributions with a known answer."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from runtime.motion.features import INPUT_SIZE
from training.networks.decoder import blend_codes
from training.networks.diffusion import Schedule, add_noise, analytic_variance, noise_estimate, reverse_steps
from training.networks.generator import Generator
from training.presets import preset

pytestmark = pytest.mark.needs_torch


def test_noise_estimate_inverts_the_forward_process():
    """Eq. 6."""
    torch.manual_seed(0)
    schedule = Schedule.linear()
    clean, noise = torch.randn(4, 8, 3), torch.randn(4, 8, 3)
    step = torch.tensor([10, 300, 600, 999])
    noisy = add_noise(schedule, clean, step, noise)
    assert torch.allclose(noise_estimate(schedule, noisy, clean, step), noise, atol=1e-2)


def test_reverse_steps_keep_the_marginals_of_the_forward_process():
    """With the true Z_0, every reverse step must land on q(Z_tau | Z_0): its mean and its variance."""
    schedule = Schedule.linear()
    tau = schedule.subsequence(5)
    rng = np.random.default_rng(0)
    clean, count = 1.7, 200_000
    z = np.sqrt(schedule.alpha_bar[1000]) * clean
    z = z + np.sqrt(1 - schedule.alpha_bar[1000]) * rng.standard_normal(count)
    targets = [*tau[:-1][::-1], 0]
    for step, target in zip(reverse_steps(schedule, tau, None), targets, strict=True):
        z = step.clean * clean + step.noisy * z + step.deviation * rng.standard_normal(count)
        assert z.mean() == pytest.approx(np.sqrt(schedule.alpha_bar[target]) * clean, abs=0.01)
        assert z.var() == pytest.approx(1 - schedule.alpha_bar[target], abs=0.01)


def test_analytic_variance_of_a_gaussian_is_its_posterior_variance():
    """For Z_0 ~ N(0, s^2) the optimal prediction leaves Var(Z_0 | Z_n), which sigma_bar^2 must equal."""
    torch.manual_seed(1)
    schedule, s, n = Schedule.linear(), 0.8, 400
    alpha_bar = schedule.alpha_bar[n]
    clean = s * torch.randn(200_000, 1, 1)
    step = torch.full((len(clean),), n)
    noisy = add_noise(schedule, clean, step, torch.randn_like(clean))
    gain = np.sqrt(alpha_bar) * s**2 / (alpha_bar * s**2 + 1 - alpha_bar)
    epsilon = noise_estimate(schedule, noisy, gain * noisy, step)
    expected = s**2 * (1 - alpha_bar) / (alpha_bar * s**2 + 1 - alpha_bar)
    assert analytic_variance(schedule, n, epsilon.square().flatten()) == pytest.approx(expected, rel=0.06)


def _generator(**changes):
    torch.manual_seed(0)
    return Generator(replace(preset("tiny"), **changes)).eval()


@pytest.mark.parametrize("shares", [False, True])
def test_residual_targets_blend_to_the_captured_motion(shares):
    """E_d's codes and what is diffused add up to y, whatever the experts' shares."""
    generator = _generator(residual_shares=shares)
    size = generator.config.output_size
    generator.code_mean.normal_()
    generator.code_deviation.uniform_(0.5, 2.0)
    e, alpha = torch.randn(3, generator.config.embedding), torch.softmax(torch.randn(3, 8), -1)
    y = torch.randn(3, size)
    codes = generator.clean_codes(generator.target_codes(e, alpha, y), e)
    assert torch.allclose(blend_codes(codes, alpha), y, atol=1e-5)


def test_without_the_residual_the_targets_are_the_codes_of_the_paper():
    generator = _generator(residual_diffusion=False)
    e, alpha = torch.randn(3, generator.config.embedding), torch.full((3, 8), 1 / 8)
    targets = generator.target_codes(e, alpha, torch.full((3, generator.config.output_size), 9.0))
    assert torch.equal(targets, generator.mixture_decoder.codes(e))


def test_a_silent_denoiser_leaves_the_mixture_decoder():
    """Stage 3 begins with zero heads: without noise the sample is E_d's output."""
    generator = _generator()
    torch.nn.init.zeros_(generator.denoiser.head.weight)
    torch.nn.init.zeros_(generator.denoiser.head.bias)
    schedule = Schedule.linear()
    steps = reverse_steps(schedule, schedule.subsequence(5), None)
    x, z = torch.randn(2, INPUT_SIZE), torch.randn(2, generator.config.style_size)
    noise = torch.zeros(2, 5, 8, generator.config.output_size)
    expected, _, _ = generator.decode_mixture(x, z)
    assert torch.allclose(generator.sample(x, z, noise, steps), expected, atol=1e-5)
