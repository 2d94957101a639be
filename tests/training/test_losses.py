"""The losses against their equations."""

import pytest

torch = pytest.importorskip("torch")

from training import losses  # noqa: E402
from training.networks.content import Gaussian  # noqa: E402


def test_pairs_with_the_same_text_are_no_negatives():
    torch.manual_seed(2)
    motion = torch.randn(4, 8)
    text = motion.clone()
    text[1] = text[0]
    motion[1] = motion[0]
    same = torch.eye(4, dtype=torch.bool)
    punished = losses.contrastive(motion, text, same)
    same[0, 1] = same[1, 0] = True
    assert losses.contrastive(motion, text, same) < punished


def test_divergence_of_equal_distributions_is_zero_and_matches_torch():
    torch.manual_seed(3)
    a = Gaussian(torch.randn(2, 6, 64), torch.randn(2, 6, 64))
    b = Gaussian(torch.randn(2, 6, 64), torch.randn(2, 6, 64))
    assert losses.divergence(a, a).item() == pytest.approx(0.0, abs=1e-4)

    def normal(g):
        return torch.distributions.Normal(g.mean, (0.5 * g.log_variance).exp())

    expected = torch.distributions.kl_divergence(normal(a), normal(b)).flatten(1).sum(-1).mean()
    assert losses.divergence(a, b).item() == pytest.approx(expected.item(), rel=1e-4)


def test_contact_loss_is_small_for_planted_and_large_for_sliding_feet():
    labels = torch.ones(2, 4)
    still, sliding = torch.zeros(2, 4), torch.full((2, 4), 0.5)
    assert losses.contact(labels, still) < 0.05
    assert losses.contact(labels, sliding) > 0.9
