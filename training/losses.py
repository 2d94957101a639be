"""The paper's losses: Eq. 2, 3, 7, 8, 9 (stage 1), 10 to 13 (stage 2) and 14 (stage 3)."""

import torch
from torch import Tensor
from torch.nn.functional import mse_loss, smooth_l1_loss

from training.networks.content import Gaussian

CONTACT_SPEED = 0.02  # Eq. 13: threshold of the squared foot velocity


def contrastive(motion: Tensor, text: Tensor, same: Tensor, temperature: float = 0.1) -> Tensor:
    """InfoNCE in both directions, Eq. 2; `motion`, `text` `(B, n)` are VAE parameters mu + Sigma.

    `same` `(B, B)` marks pairs with the same description, which are not negatives of each other.
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
    """Smooth L1 of pose statistics, with equal weight for every part."""
    return torch.stack([smooth_l1_loss(r, t) for r, t in zip(read, target, strict=True)]).mean()


def divergence(a: Gaussian, b: Gaussian | None) -> Tensor:
    """KL(a, b) of diagonal normal distributions, mean over the batch; None is the standard normal."""
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
    """Mean square difference, in units of `scale`, between a rollout's frame-to-frame motion and its predicted velocity.

    `moved` and `velocity` `(B, n)` are m/s. No other loss penalises jitter: a millimetre is little in Eq. 11, but visible
    as 6 cm/s. The rollout is compared with itself, not with its clip: the two may be out of phase, and comparing them
    would reduce its swing.
    """
    return (kept * ((moved - velocity) / scale).square()).mean()


def swing(own: Tensor, captured: Tensor, scale: Tensor, kept: Tensor) -> Tensor:
    """Squared log ratio of the energies of movements `(B, n)` in rollouts and in capture, mean over the entries.

    Eq. 11 alone damps uncertain motion towards its mean, and in a rollout the damping accumulates. Energies of a batch
    are compared, not frames, because rollouts may be out of phase. `scale` `(n,)` is metres. Entries that move by less
    than 3 % of it in the capture are ignored, such as the hips' horizontal position.
    """
    least = MIN_MOVEMENT * kept.sum(0)
    wanted = (kept * (captured / scale).square()).sum(0)
    moves = (wanted > least).float()
    energy = (kept * (own / scale).square()).sum(0)
    ratio = (energy + least + 1e-6) / (wanted + least + 1e-6)
    return (moves * ratio.log().square()).sum() / moves.sum().clamp_min(1.0)


def own_swing(own: Tensor, energies: Tensor, scale: Tensor, kept: Tensor) -> Tensor:
    """Increase movements `(B, n)` of a rollout that were recently smaller than its clip's, and decrease larger ones.

    `swing` compares sums over a batch, where a style that swings too little compensates for one that swings too much.
    `energies` `(2, B, n)` are running means of squares of rollout and clip. The log of their ratio weights the rollout's
    present energy, relative to its running mean.
    """
    mine, wanted = energies / scale.square() + MIN_MOVEMENT
    weight = (mine / wanted).log().clamp(-MAX_WIDENING, MAX_NARROWING)
    return (kept * weight * (own / scale).square() / mine).sum() / kept.sum().clamp_min(1.0)


def offset(away: Tensor, offsets: Tensor, scale: Tensor, kept: Tensor) -> Tensor:
    """Penalise a recent mean offset of movements from their clip's; `away` `(B, n)` is the present difference.

    A rollout that is out of phase with its clip differs in every frame, but most of this averages out. `offsets` `(B, n)`
    are running means of the difference; their product with the present difference is on average their square.
    """
    return (kept * (offsets / scale) * (away / scale)).sum() / kept.sum().clamp_min(1.0)


def distribution(own: Tensor, captured: Tensor, scale: float) -> Tensor:
    """Squared Wasserstein distance of the values in each column of two batches `(B, n)`, in units of `scale`.

    Sorted values are compared, not frames: a rollout out of phase with its clip would otherwise learn the mean, and a
    knee that is always bent by the mean never straightens.
    """
    if not len(own):
        return own.sum()
    return ((own.sort(0).values - captured.sort(0).values) / scale).square().mean()


BEND_UNIT_RAD = 0.2  # unit of knee errors
# limits of the weight in `own_swing`: amplifying a rollout too strongly makes it diverge
MAX_WIDENING, MAX_NARROWING = 0.4, 1.5
MIN_MOVEMENT = 1e-3  # mean square of a movement relative to its scale


def contact(labels: Tensor, squared_foot_velocity: Tensor) -> Tensor:
    """Eq. 12 and 13 with a differentiable step.

    delta is 1 up to the threshold and 0 above, so its gradient is zero everywhere; a steep sigmoid at the same threshold
    replaces it.
    """
    soft = torch.sigmoid((CONTACT_SPEED - squared_foot_velocity) / (0.5 * CONTACT_SPEED))
    return mse_loss(soft, labels)


def codes(target: Tensor, predicted: Tensor, weights: Tensor | float = 1.0) -> Tensor:
    """Eq. 14: mean squared error between E_d's codes Z^c and the denoiser's, `(B, K, n)`, weighted by `(B, 1, n)`."""
    return (weights * (predicted - target).square()).mean()
