"""The paper's losses: Eq. 2, 3, 7, 8, 9 (stage 1), 10 to 13 (stage 2) and 14 (stage 3)."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import mse_loss, smooth_l1_loss

from training.networks.content import Gaussian

CONTACT_SPEED = 0.02  # Eq. 13: threshold on the squared foot velocity


def contrastive(motion: Tensor, text: Tensor, same: Tensor, temperature: float = 0.1) -> Tensor:
    """InfoNCE in both directions, Eq. 2; `motion`, `text` `(B, n)` are VAE parameters mu + Sigma.

    `same` `(B, B)` marks pairs with the same description: they are no negatives of each other.
    """
    m = torch.nn.functional.normalize(motion, dim=-1)
    t = torch.nn.functional.normalize(text, dim=-1)
    similarity = m @ t.T / temperature
    diagonal = torch.eye(len(similarity), dtype=torch.bool, device=similarity.device)
    similarity = similarity.masked_fill(same & ~diagonal, float("-inf"))
    target = torch.arange(len(similarity), device=similarity.device)
    cross_entropy = torch.nn.functional.cross_entropy
    return 0.5 * (cross_entropy(similarity, target) + cross_entropy(similarity.T, target))


def reconstruction(target: Tensor, from_motion: Tensor, from_text: Tensor) -> Tensor:
    """Eq. 3: smooth L1 of both reconstructions."""
    return smooth_l1_loss(from_motion, target) + smooth_l1_loss(from_text, target)


def stage1(
    recon: Tensor,
    contrast: Tensor,
    divergence: Tensor,
    embedding: Tensor,
    weights: tuple[float, float, float],
) -> Tensor:
    """Eq. 7 of Eq. 3, 2, 8 and 9; `weights` are lambda_con, lambda_KL and lambda_emb."""
    return recon + weights[0] * contrast + weights[1] * divergence + weights[2] * embedding


def statistics(target: list[Tensor], read: list[Tensor]) -> Tensor:
    """Smooth L1 of pose statistics, every part counting alike."""
    return torch.stack([smooth_l1_loss(r, t) for r, t in zip(read, target, strict=True)]).mean()


def divergence(a: Gaussian, b: Gaussian | None) -> Tensor:
    """KL(a, b) of diagonal normals, mean over the batch; b None is the standard normal."""
    mean = torch.zeros_like(a.mean) if b is None else b.mean
    log_variance = torch.zeros_like(a.mean) if b is None else b.log_variance
    term = (
        log_variance
        - a.log_variance
        + (a.log_variance.exp() + (a.mean - mean).square()) / log_variance.exp()
        - 1.0
    )
    return 0.5 * term.flatten(1).sum(-1).mean()


def kullback_leibler(text: Gaussian, motion: Gaussian) -> Tensor:
    """Eq. 8: both directions between text and motion, and both against the standard normal."""
    return (
        divergence(text, motion)
        + divergence(motion, text)
        + divergence(text, None)
        + divergence(motion, None)
    )


def embedding_similarity(z_motion: Tensor, z_text: Tensor) -> Tensor:
    """Eq. 9: smooth L1 between the sampled embeddings."""
    return smooth_l1_loss(z_text, z_motion)


def stage2(rec: Tensor, contact_error: Tensor, contact_weight: float = 1.0) -> Tensor:
    """Eq. 10 of Eq. 11 and 12; the paper adds them without a weight."""
    return rec + contact_weight * contact_error


def motion(target: Tensor, predicted: Tensor, weights: Tensor) -> Tensor:
    """Eq. 11: mean squared error of normalised y `(B, n)`, weighted by `(n,)` or `(B, n)` (the paper: 1)."""
    return (weights * (predicted - target).square()).mean()


def unrest(moved: Tensor, velocity: Tensor, scale: Tensor, kept: Tensor) -> Tensor:
    """Difference of a rollout's steps from frame to frame to its own velocity: mean square in units of `scale`.

    `moved` and `velocity` `(B, n)` are m/s. Positions that tremble around their path are punished by nothing else: a
    millimetre is little to Eq. 11, and 6 cm/s to the eye. The rollout is held to itself and not to its clip, with
    which it need not be in step: that would teach it to swing less.
    """
    return (kept * ((moved - velocity) / scale).square()).mean()


def swing(own: Tensor, captured: Tensor, scale: Tensor, kept: Tensor) -> Tensor:
    """Squared logarithm of the energy of a batch's movements `(B, n)` over the capture's, the mean over the entries.

    Eq. 11 alone lets every uncertain movement shrink towards its mean, and a rollout shrinks it in every frame anew.
    The energies of many rollouts are compared, not frames: they need not be in step. `scale` `(n,)` is metres. Entries
    that the capture moves by less than 3 % of it say nothing, such as the hips' place over the root.
    """
    least = MIN_MOVEMENT * kept.sum(0)
    wanted = (kept * (captured / scale).square()).sum(0)
    moves = (wanted > least).float()
    energy = (kept * (own / scale).square()).sum(0)
    ratio = (energy + least + 1e-6) / (wanted + least + 1e-6)
    return (moves * ratio.log().square()).sum() / moves.sum().clamp_min(1.0)


def own_swing(own: Tensor, energies: Tensor, scale: Tensor, kept: Tensor) -> Tensor:
    """Make rollouts swing farther in the movements `(B, n)` in which they moved less than their own clips of late, or less far.

    `swing` compares the sums of a batch, in which a style that swings too little makes up for one that swings too much.
    `energies` `(2, B, n)` are running means of squares, the rollout's and its clip's; their logarithm is the weight, and
    what it weighs is the rollout's present energy over its running mean.
    """
    mine, wanted = energies / scale.square() + MIN_MOVEMENT
    weight = (mine / wanted).log().clamp(-MAX_WIDENING, MAX_NARROWING)
    return (kept * weight * (own / scale).square() / mine).sum() / kept.sum().clamp_min(1.0)


def offset(away: Tensor, offsets: Tensor, scale: Tensor, kept: Tensor) -> Tensor:
    """Draw movements that are `away` `(B, n)` from their clips' back where they were off on average of late.

    A rollout that is out of step with its clip is wrong in every frame, most of it in ways that average out. `offsets`
    `(B, n)` are the running means, and their product with the present error is on average their square.
    """
    return (kept * (offsets / scale) * (away / scale)).sum() / kept.sum().clamp_min(1.0)


def distribution(own: Tensor, captured: Tensor, scale: float) -> Tensor:
    """Squared Wasserstein distance of the values in each column of two batches `(B, n)`, in units of `scale`.

    Sorted values are compared, not frames: a rollout that is out of step with its clip would be taught their mean, and
    a knee that is bent on average is never straight.
    """
    if not len(own):
        return own.sum()
    return ((own.sort(0).values - captured.sort(0).values) / scale).square().mean()


BEND_UNIT_RAD = 0.2  # radians: unit of errors of a knee
# of the weight in `own_swing`: a rollout that is drawn wider too strongly runs away
MAX_WIDENING, MAX_NARROWING = 0.4, 1.5
MIN_MOVEMENT = 1e-3  # mean square of a movement over its scale


def contact(labels: Tensor, squared_foot_velocity: Tensor) -> Tensor:
    """Eq. 12, 13 with a differentiable step.

    delta is 1 at or under the threshold and 0 above, so its gradient vanishes everywhere; a steep sigmoid of the
    same threshold stands in for it, so that the term can train.
    """
    soft = torch.sigmoid((CONTACT_SPEED - squared_foot_velocity) / (0.5 * CONTACT_SPEED))
    return mse_loss(soft, labels)


def codes(target: Tensor, predicted: Tensor, weights: Tensor | float = 1.0) -> Tensor:
    """Eq. 14: mean squared error between E_d's codes Z^c and the denoiser's, `(B, K, n)`, weighted by `(B, 1, n)`."""
    return (weights * (predicted - target).square()).mean()
