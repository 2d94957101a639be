"""The paper's equations written out beside the functions that compute them (docs/equations.md lists both)."""

import re

import numpy as np
import pytest
import torch

from runtime.assets import PROJECT_ROOT
from training import losses
from training.networks.content import Gaussian
from training.networks.decoder import blend_codes
from training.networks.diffusion import Schedule, analytic_variance, reverse_steps
from training.networks.generator import Generator
from training.networks.phase import PeriodicAutoencoder
from training.presets import preset

pytestmark = pytest.mark.needs_torch


def test_equation_1_amplitude_times_sine_and_cosine_of_the_shift():
    torch.manual_seed(0)
    network = PeriodicAutoencoder(preset("tiny")).eval()
    sequence, rows = torch.randn(160, 31, 3), torch.tensor([0, 17, 39])
    amplitude, _, _, shift = network.encode(torch.stack([sequence[row : row + 121] for row in rows]))
    p = network.phase_vectors(sequence, rows)
    for j in range(amplitude.shape[1]):
        angle = 2 * np.pi * shift[:, j]
        assert torch.allclose(p[:, j, 0], amplitude[:, j] * angle.sin(), atol=1e-5)
        assert torch.allclose(p[:, j, 1], amplitude[:, j] * angle.cos(), atol=1e-5)


def test_equation_2_information_noise_contrast_in_both_directions():
    torch.manual_seed(1)
    m, t, tau = torch.randn(5, 12), torch.randn(5, 12), 0.07
    e = (torch.nn.functional.cosine_similarity(m[:, None], t[None], dim=-1) / tau).exp()
    total = sum((e[i, i] / e[i].sum()).log() + (e[i, i] / e[:, i].sum()).log() for i in range(5))
    value = losses.contrastive(m, t, torch.eye(5, dtype=torch.bool), tau)
    assert value.item() == pytest.approx(-total.item() / 10, rel=1e-5)


def test_equation_3_smooth_l1_of_both_reconstructions():
    target = torch.zeros(2, 3)
    small, large = torch.full((2, 3), 0.5), torch.full((2, 3), 3.0)  # x^2 / 2 below one, |x| - 1/2 above
    assert losses.reconstruction(target, small, large).item() == pytest.approx(0.125 + 2.5)


def test_equation_4_and_5_the_sampler_written_out():
    """Z^c_0 = G(E, Z^c_N): five reverse steps with the covariance of Analytic-DPM (Sec. III-E)."""
    torch.manual_seed(2)
    config = preset("tiny")
    generator = Generator(config).eval()
    schedule = Schedule.linear()
    tau, sigma = schedule.subsequence(5), np.linspace(0.1, 0.3, 5)
    e, noise = torch.randn(2, config.embedding), torch.randn(2, 5, 8, config.output_size)
    z = noise[:, 0]
    for n in range(4, -1, -1):
        now, before = schedule.alpha_bar[tau[n]], schedule.alpha_bar[tau[n - 1]] if n else 1.0
        clean = generator.denoiser(z, e, torch.full((2,), int(tau[n])))
        epsilon = (z - np.sqrt(now) * clean) / np.sqrt(1 - now)  # Eq. 6
        variance = (1 - before) / (1 - now) * (1 - now / before)  # lambda^2 along tau
        mean = (
            np.sqrt(before) / np.sqrt(now)
            * (z - (np.sqrt(1 - now) - np.sqrt(now) / np.sqrt(before) * np.sqrt(1 - before - variance)) * epsilon)
        )  # fmt: skip
        kappa = np.sqrt(1 - before - variance) / np.sqrt(1 - now)
        z = mean
        if n:
            variance += (np.sqrt(before) - np.sqrt(now) * kappa) ** 2 * sigma[n]
            z = z + np.sqrt(variance) * noise[:, 5 - n]
    ours = generator.sample_codes(e, noise, reverse_steps(schedule, tau, sigma))
    assert torch.allclose(ours, generator.clean_codes(z.float(), e), atol=1e-4)


def test_equation_5_lambda_of_neighbouring_steps_is_that_of_section_3g():
    """lambda_n^2 = beta_bar_{n-1} / beta_bar_n beta_n, the DDPM variance, when tau skips nothing."""
    schedule = Schedule.linear(50)
    steps = reverse_steps(schedule, np.arange(1, 51), None)
    beta_bar = 1 - schedule.alpha_bar
    for step in steps[:-1]:
        n = step.step
        beta = 1 - schedule.alpha_bar[n] / schedule.alpha_bar[n - 1]
        assert step.deviation**2 == pytest.approx(beta_bar[n - 1] / beta_bar[n] * beta, rel=1e-9)


def test_monte_carlo_variance_of_section_3e():
    schedule, norms = Schedule.linear(), torch.tensor([0.5, 0.7])  # ||epsilon||^2 / d
    alpha_bar = schedule.alpha_bar[400]
    wanted = (1 - alpha_bar) / alpha_bar * 0.4
    assert analytic_variance(schedule, 400, norms) == pytest.approx(wanted, rel=1e-6)


def test_output_is_the_blend_of_its_codes():
    """y_i = sum_k alpha_k c_0^k (Sec. III-E)."""
    codes, alpha = torch.randn(2, 8, 5), torch.rand(2, 8)
    assert torch.allclose(blend_codes(codes, alpha), sum(alpha[:, k, None] * codes[:, k] for k in range(8)))


def test_equation_7_weights_its_four_terms():
    terms = [torch.tensor(v) for v in (1.0, 2.0, 3.0, 4.0)]
    assert losses.stage1(*terms, (1e-2, 1e-5, 1e-3)).item() == pytest.approx(1.0 + 0.02 + 3e-5 + 4e-3)


def test_equation_8_four_divergences():
    torch.manual_seed(3)
    text, motion = (Gaussian(torch.randn(3, 6, 64), torch.randn(3, 6, 64)) for _ in range(2))
    unit = Gaussian(torch.zeros(3, 6, 64), torch.zeros(3, 6, 64))

    def kl(a, b):
        normal = [torch.distributions.Normal(g.mean, (0.5 * g.log_variance).exp()) for g in (a, b)]
        return torch.distributions.kl_divergence(*normal).flatten(1).sum(1).mean()

    expected = kl(text, motion) + kl(motion, text) + kl(text, unit) + kl(motion, unit)
    assert losses.kullback_leibler(text, motion).item() == pytest.approx(expected.item(), rel=1e-4)


def test_equation_9_smooth_l1_of_the_samples():
    a, b = torch.zeros(4, 6, 64), torch.full((4, 6, 64), 2.0)
    assert losses.embedding_similarity(a, b).item() == pytest.approx(1.5)


def test_equation_10_adds_reconstruction_and_contact():
    assert losses.stage2(torch.tensor(2.0), torch.tensor(3.0)).item() == 5.0
    assert losses.stage2(torch.tensor(2.0), torch.tensor(3.0), 0.1).item() == pytest.approx(2.3)


def test_equation_11_mean_squared_error():
    target, predicted = torch.zeros(2, 3), torch.tensor([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]])
    assert losses.motion(target, predicted, torch.ones(3)).item() == pytest.approx(14 / 6)
    assert losses.motion(target, predicted, torch.tensor([0.0, 0.0, 2.0])).item() == pytest.approx(18 / 6)


def test_equations_12_and_13_the_soft_step_is_a_half_at_the_threshold():
    speed = torch.tensor([[0.0, 0.02, 0.2, 2.0]])
    assert losses.contact(torch.ones(1, 1), torch.full((1, 1), 0.02)).item() == pytest.approx(0.25)
    # what the soft step says of a foot at rest, and of a fast one
    at_rest, moving = (1 / (1 + np.exp(-2.0)), 0.0)
    labels = torch.zeros(1, 3)
    away = speed[:, [0, 2, 3]]
    assert losses.contact(labels, away).item() == pytest.approx((at_rest**2 + moving) / 3, abs=1e-5)


def test_equation_14_mean_squared_error_of_the_codes():
    assert losses.codes(torch.zeros(2, 8, 3), torch.full((2, 8, 3), 2.0)).item() == 4.0


def test_every_equation_is_named_where_it_is_computed_and_listed():
    """docs/equations.md names, for Eq. 1 to 14, a function that exists and whose docstring names the equation."""
    import importlib

    table = (PROJECT_ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| Eq\. (\d+)[^|]*\|[^|]*\| `([\w.]+)`", table, re.MULTILINE)
    assert [int(n) for n, _ in rows] == list(range(1, 15))
    for number, name in rows:
        module, _, attribute = name.rpartition(".")
        try:
            found = getattr(importlib.import_module(module), attribute)
        except ModuleNotFoundError:  # a method
            module, _, cls = module.rpartition(".")
            found = getattr(getattr(importlib.import_module(module), cls), attribute)
        told = " ".join(re.findall(r"Eq\. ([\d, and]+)", found.__doc__))
        named = {int(n) for n in re.findall(r"\d+", told)}
        assert int(number) in named, f"{name}: its docstring does not name Eq. {number}"


def test_the_tests_that_the_table_names_exist():
    table = (PROJECT_ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
    for file, test in re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", table):
        assert f"def {test}(" in (PROJECT_ROOT / file).read_text(encoding="utf-8"), f"{file}::{test}"
