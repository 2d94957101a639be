"""Stage 3: the diffusion decoder of the motion generator (Sec. III-F), and the variances of its steps."""

import math
from collections.abc import Callable, Iterable

import numpy as np
import torch
from torch import Tensor, nn

from training import losses as terms
from training.batches import RandomRows
from training.gpu import Losses
from training.networks.decoder import blend_codes
from training.networks.diffusion import Schedule, add_noise, analytic_variance, noise_estimate
from training.networks.generator import Generator
from training.packed_run import START
from training.session import Session, StageLength, train
from training.stages import motion as stage_motion
from training.stages.motion import MotionData


@torch.no_grad()
def measure_codes(module: Generator, data: MotionData, session: Session, batches: int = 8) -> None:
    """Measure mean and deviation of the diffused variable into the module's buffers."""
    module.eval()
    module.code_mean.zero_()
    module.code_deviation.fill_(1.0)
    rows = RandomRows(data.weights, 2048, 0, data.frames.last, session.generator(5))
    codes = []
    for _ in range(batches):
        codes.append(_captured_codes(module, data, next(rows))[1])
    stacked = torch.cat(codes)
    module.code_mean.copy_(stacked.mean(0))
    module.code_deviation.copy_(stacked.std(0).clamp_min(1e-2))


def _captured_codes(module: Generator, data: MotionData, rows: Tensor) -> tuple[Tensor, Tensor]:
    """Return E `(B, n)` and the diffused variable of captured frames."""
    patch = data.patch(rows)
    e, alpha = module.embed(data.input(rows, patch), data.styles(data.frames.clip[rows]))
    return e, module.target_codes(e, alpha, data.output(rows, patch))


def _noised(schedule: Schedule, tau: Tensor, codes: Tensor) -> tuple[Tensor, Tensor]:
    """Draw noise levels `(B,)`, mostly those of inference, and add that noise to codes `(B, K, output)`."""
    size, last = (len(codes),), len(schedule.alpha_bar) - 1
    n = tau[torch.randint(len(tau), size, device=codes.device)]
    anywhere = torch.randint(1, last + 1, size, device=codes.device)
    n = torch.where(torch.rand(size, device=codes.device) < 0.3, anywhere, n)
    return n, add_noise(schedule, codes, n, torch.randn(codes.shape, device=codes.device))


def _cosine(steps: int, peak: float) -> Callable[[float], float]:
    """Return a cosine learning rate from `peak` to a hundredth of it; Sec. III-G starts at 4e-4."""

    def rate(step: float) -> float:
        return (
            peak * min(1.0, (step + 1) / 200) * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * step / steps)))
        )

    return rate


def _denoiser_parameters(session: Session, module: Generator) -> Iterable[nn.Parameter]:
    """Freeze all but the denoiser and return its parameters; as a new residual decoder it starts with output zero."""
    if module.config.residual_diffusion and not (session.out / START).exists():
        torch.nn.init.zeros_(module.denoiser.head.weight)
        torch.nn.init.zeros_(module.denoiser.head.bias)
    module.requires_grad_(False)
    module.denoiser.requires_grad_(True)
    return module.denoiser.parameters()


def run_stage3(session: Session, data: MotionData, module: Generator, length: StageLength) -> Generator:
    """Train the denoiser on `target_codes` (Eq. 14), then also with stage-2 supervision of the blended output."""
    torch.manual_seed(session.seed + 3)
    measure_codes(module, data, session)
    steps, batch = length.steps, length.batch
    parameters = _denoiser_parameters(session, module)
    schedule = Schedule.linear(module.config.diffusion_steps)
    tau = torch.as_tensor(schedule.subsequence(module.config.inference_steps), device=session.device)
    rows = RandomRows(data.weights, batch, 1, data.frames.last, session.batch_generator(6))
    lanes = stage_motion.lanes_of(session, data, batch, 9)
    state = stage_motion.generator_state(module, parameters, steps, {"rows": rows, "lanes": lanes})
    supervised = False

    def prepare(at: float) -> tuple:
        nonlocal supervised
        supervised = at > 0.25 * steps
        module.eval()  # no dropout in the frozen part; the denoiser has none
        return lanes.draw(), supervised

    def losses(item: Tensor) -> Losses:
        with torch.no_grad():
            mixed = stage_motion.mixed_batch(data, item, lanes)
            e, alpha = module.embed(mixed.x, mixed.z)
            with stage_motion.full_precision(e.device):
                codes = module.target_codes(e.float(), alpha.float(), mixed.target)
            n, noisy = _noised(schedule, tau, codes.float())
        predicted = module.denoiser(noisy, e, n).float()
        with stage_motion.full_precision(e.device):
            y = blend_codes(module.clean_codes(predicted, e.float()), alpha.float())
            motion = stage_motion.motion_losses(data, lanes, mixed, y)
            total = terms.codes(codes.float(), predicted)
            result = {"codes": total}
            if supervised:
                result, total = result | motion, 0.1 * total + stage_motion.total_of(motion)
            return result | {"total": total}

    state.prepare = prepare
    train(session, "stage3", state, rows, losses, _cosine(steps, stage_motion.peak_of(batch)), length)
    module.load_state_dict(state.average.values)
    return module.eval()


VARIANCE_BATCHES = 12  # of 1024 frames, each with antithetic noise


@torch.no_grad()
def estimate_variance(
    session: Session, data: MotionData, module: Generator, batches: int = VARIANCE_BATCHES
) -> np.ndarray:
    """Estimate sigma_bar^2 `(5,)` per step of tau by Monte Carlo over the training set (Analytic-DPM).

    It is clipped to its bounds: the diffused variable is standardised, so the variance left at any step is between 0 and
    the variable's own. The last steps divide by an alpha_bar of nearly zero; there the bound decides.
    """
    schedule = Schedule.linear(module.config.diffusion_steps)
    tau = schedule.subsequence(module.config.inference_steps)
    rows = RandomRows(data.weights, 1024, 0, data.frames.last, session.generator(7))
    norms: list[list[Tensor]] = [[] for _ in tau]
    spread: list[float] = []
    module.eval()
    for _ in range(batches):
        e, codes = _captured_codes(module, data, next(rows))
        spread.append(float(codes.var(0).mean()))
        noise = torch.randn_like(codes)
        for k, step in enumerate(tau):
            n = torch.full((len(e),), int(step), device=e.device)
            for sign in (1.0, -1.0):
                noisy = add_noise(schedule, codes, n, sign * noise)
                epsilon = noise_estimate(schedule, noisy, module.denoiser(noisy, e, n), n)
                norms[k].append(epsilon.square().flatten(1).mean(1))
    found = [analytic_variance(schedule, int(s), torch.cat(v)) for s, v in zip(tau, norms, strict=True)]
    return np.clip(found, 0.0, np.mean(spread))
