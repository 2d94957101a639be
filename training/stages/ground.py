"""Stage ground: fine-tunes a finished generator on its own traversals of courses, without changing it elsewhere.

On captured and composed samples it is distilled from its former self (learning without forgetting, Li and Hoiem 2016):
y and embedding E are kept, so that words and denoiser keep their meaning, also at strengths up to 2. On clips of
`training.courses` it is trained as in stage 2, with the true heights.
"""

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import mse_loss

from training.batches import RandomRows
from training.gpu import Losses
from training.networks.generator import Generator
from training.session import Resumable, Session, StageLength, train
from training.stages import motion as stage_motion
from training.stages.motion import MotionData

COURSES_FRACTION = 0.35  # of the samples
EMBEDDING_WEIGHT = 1.0
# Fraction of parts in distilled samples whose codes are up to twice as far from neutral, for strengths above 1.
DRAWN_OUT_FRACTION = 0.5
PEAK_RATE_FRACTION = 0.5  # of stage 2's learning rate


def run_ground(
    session: Session,
    data: MotionData,
    courses: MotionData,
    module: Generator,
    neutral: np.ndarray,
    length: StageLength,
) -> Generator:
    """Train encoder, modulator and E_d of `module` on `courses`, distilled on `data`; the denoiser is fixed.

    `neutral` is Z^t `(6, n / 6)` of neutral walking.
    """
    torch.manual_seed(session.seed + 4)
    steps, batch = length.steps, length.batch
    teacher = Generator(module.config).to(session.device)
    teacher.load_state_dict(module.state_dict())
    teacher.requires_grad_(False).eval()
    plain = torch.as_tensor(neutral, dtype=torch.float32, device=session.device)
    stage_motion.without_dropout(module)
    on_courses = round(COURSES_FRACTION * batch)
    held_rows = batch - on_courses
    rows = RandomRows(data.weights, held_rows, 1, data.frames.last, session.batch_generator(12))
    lanes = stage_motion.lanes_of(session, data, held_rows, 13)
    ahead = RandomRows(courses.weights, on_courses, 1, courses.frames.last, session.batch_generator(14))
    ahead_lanes = stage_motion.lanes_of(session, courses, on_courses, 15)
    sources: dict[str, Resumable] = {"rows": rows, "lanes": lanes, "ahead": ahead, "ahead_lanes": ahead_lanes}
    parameters = stage_motion.all_but_the_denoiser(module)
    state = stage_motion.generator_state(module, parameters, steps, sources)

    def losses(item: Tensor) -> Losses:
        mixed = stage_motion.mixed_batch(data, item[:held_rows], lanes)
        mixed.z = _drawn_out(mixed.z, plain)
        with torch.no_grad():
            known, alpha = teacher.embed(mixed.x, mixed.z)
            with stage_motion.full_precision(known.device):
                mixed.target = teacher.mixture_decoder(known.float(), alpha.float())
        found, e = stage_motion.mixture_losses(data, module, mixed, lanes)
        held, embedding = found, mse_loss(e, known.float())
        mixed = stage_motion.mixed_batch(courses, item[held_rows:], ahead_lanes)
        new, _ = stage_motion.mixture_losses(courses, module, mixed, ahead_lanes)
        total = (1.0 - COURSES_FRACTION) * (
            held["total"] + EMBEDDING_WEIGHT * embedding
        ) + COURSES_FRACTION * new["total"]
        return {"held_rec": held["rec"], "held_embedding": embedding} | new | {"total": total}

    def rate(step: float) -> float:
        return PEAK_RATE_FRACTION * stage_motion.warm_restarts(steps, stage_motion.peak_of(batch), 1)(step)

    state.prepare = lambda at: (lanes.draw(), ahead_lanes.draw())
    both = map(torch.cat, zip(rows, ahead, strict=True))
    train(session, "ground", state, both, losses, rate, length)
    module.load_state_dict(state.average.values)
    return module.eval()


def _drawn_out(z: Tensor, neutral: Tensor) -> Tensor:
    """Return Z^t `(B, n)` with random parts moved up to twice as far from `neutral` `(6, n / 6)`."""
    parts = z.unflatten(1, neutral.shape)
    size = (len(z), len(neutral), 1)
    farther = torch.rand(size, device=z.device) * (torch.rand(size, device=z.device) < DRAWN_OUT_FRACTION)
    return (parts + farther * (parts - neutral)).flatten(1)
