"""Ground: a finished generator learns courses from its own crossings, and stays what it is everywhere else.

On captured and composed samples it is held to what it gave before (learning without forgetting, Li and Hoiem 2016): to
its y and to its embedding E, so that words, the gains by which they are drawn out, and the denoiser keep their meaning. On
clips of `training.courses.clips` it is trained as in stage 2, with the heights as they are.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import mse_loss

from training.batches import RandomRows
from training.frames import FrameTable
from training.networks.generator import Generator
from training.networks.phase import PeriodicAutoencoder
from training.presets import ModelConfig
from training.session import (
    Losses,
    MovingAverage,
    Resumable,
    Session,
    TrainingState,
    load_checkpoint,
    train,
)
from training.stages import motion as stage_motion
from training.stages.motion import MotionData
from training.stages.phase import ENCODED, encode_all

SHARE = 0.35  # of the samples are on courses
EMBEDDING_WEIGHT = 1.0
# Share of the held samples' parts whose codes are up to twice as far from neutral, as calibration draws them.
DRAWN_OUT = 0.5
PEAK = 0.5  # of stage 2's learning rate
KNOWN_FRAMES = 6000  # of the capture, whose phases tell their scale


def course_phases(
    session: Session,
    config: ModelConfig,
    courses: FrameTable,
    table: FrameTable,
    phase: np.ndarray,
    folder: Path,
) -> np.ndarray:
    """Phases `(N, 5, 2)` of course clips, on the scale of those `phase` of the captured `table`; kept in `folder`."""
    stored = folder / "phase.npy"
    if stored.exists():
        found = np.load(stored, allow_pickle=False)
        if len(found) == len(courses):
            return found
    saved = load_checkpoint(session.out / "phase_final.pt")
    module = PeriodicAutoencoder(config).to(session.device)
    module.load_state_dict(saved["module"])
    inside = replace(session, out=folder)

    def encoded(of: FrameTable, count: int) -> np.ndarray:
        velocities = torch.as_tensor(np.array(of.velocities[:count])).to(session.device)
        first = torch.as_tensor(of.start[of.clip[:count]]).to(session.device)
        last = torch.as_tensor(of.start[of.clip[:count] + 1] - 1).to(session.device)
        result = encode_all(inside, module, velocities, float(saved["scale"]), first, last)
        (folder / ENCODED).unlink(missing_ok=True)
        return result

    count = int(table.start[min(int(np.searchsorted(table.start, KNOWN_FRAMES)), len(table.start) - 1)])
    ratio = np.square(encoded(table, count)).mean((0, 2)) / np.square(phase[:count]).mean((0, 2))
    result = (encoded(courses, len(courses)) / np.sqrt(ratio)[:, None]).astype(np.float32)
    np.save(stored, result)
    return result


def run_ground(
    session: Session,
    data: MotionData,
    courses: MotionData,
    module: Generator,
    neutral: np.ndarray,
    steps: int,
    batch: int,
    max_minutes: float | None = None,
) -> Generator:
    """Train encoder, modulator and E_d of `module` on `courses`, held to themselves on `data`; the denoiser stays.

    `neutral` is Z^t `(6, n / 6)` of neutral walking.
    """
    torch.manual_seed(session.seed + 4)
    teacher = Generator(module.config).to(session.device)
    teacher.load_state_dict(module.state_dict())
    teacher.requires_grad_(False).eval()
    plain = torch.as_tensor(neutral, dtype=torch.float32, device=session.device)
    stage_motion.without_dropout(module)
    parameters = [p for n, p in module.named_parameters() if not n.startswith("denoiser")]
    optimizer = torch.optim.AdamW(parameters, lr=1e-3, weight_decay=1e-4, fused=True)
    state = TrainingState(module, optimizer, MovingAverage(module, stage_motion.decay_of(steps)))
    on_courses = round(SHARE * batch)
    rows = RandomRows(data.weights, batch - on_courses, 1, data.frames.last, session.batch_generator(12))
    lanes = stage_motion.lanes_of(session, data, batch - on_courses, 13)
    ahead = RandomRows(courses.weights, on_courses, 1, courses.frames.last, session.batch_generator(14))
    ahead_lanes = stage_motion.lanes_of(session, courses, on_courses, 15)

    def losses(item: object, step: int) -> Losses:
        assert isinstance(item, Tensor)
        held, embedding = _held(data, teacher, module, item, lanes, plain)
        mixed = stage_motion.mixed_batch(courses, next(ahead), ahead_lanes, stage_motion.NOISE)
        new, _ = stage_motion.mixture_losses(courses, module, mixed, ahead_lanes)
        total = (1.0 - SHARE) * (held["total"] + EMBEDDING_WEIGHT * embedding) + SHARE * new["total"]
        return {"held_rec": held["rec"], "held_embedding": embedding} | new | {"total": total}

    def rate(step: int) -> float:
        return PEAK * stage_motion.warm_restarts(steps, stage_motion.peak_of(batch), 1)(step)

    sources: dict[str, Resumable] = {"rows": rows, "lanes": lanes, "ahead": ahead, "ahead_lanes": ahead_lanes}
    train(session, "ground", state, rows, losses, steps, rate, batch, max_minutes, sources)
    module.load_state_dict(state.average.values)
    return module.eval()


def _held(
    data: MotionData,
    teacher: Generator,
    module: Generator,
    rows: Tensor,
    lanes: stage_motion.RolloutLanes,
    neutral: Tensor,
) -> tuple[Losses, Tensor]:
    """Losses against the teacher's y on the same inputs, and the embeddings' distance."""
    mixed = stage_motion.mixed_batch(data, rows, lanes, stage_motion.NOISE)
    mixed.z = _drawn_out(mixed.z, neutral)
    with torch.no_grad():
        known, alpha = teacher.embed(mixed.x, mixed.z)
        with stage_motion.full_precision(known.device):
            mixed.target = teacher.mixture_decoder(known.float(), alpha.float())
    found, e = stage_motion.mixture_losses(data, module, mixed, lanes)
    return found, mse_loss(e, known.float())


def _drawn_out(z: Tensor, neutral: Tensor) -> Tensor:
    """Z^t `(B, n)` whose parts are by chance up to twice as far from `neutral` `(6, n / 6)`."""
    parts = z.unflatten(1, neutral.shape)
    size = (len(z), len(neutral), 1)
    farther = torch.rand(size, device=z.device) * (torch.rand(size, device=z.device) < DRAWN_OUT)
    return (parts + farther * (parts - neutral)).flatten(1)
