"""Stage 2: the motion generator with the MoE decoder, and losses shared with stages 3 and ground (Sec. III-F)."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor, nn

from runtime.feet.skating import SOLE_POINTS
from runtime.motion.features import FPS, INPUT, INPUT_SIZE, OUTPUT
from runtime.skeleton import J
from training import losses as terms
from training import parallel
from training.batches import FrameTensors, Normalisation, RandomRows, loss_weights
from training.composition import CompositionPlan
from training.gpu import Losses, constant
from training.kinematics import TURNS, knee_flexion, shown_joints, turns
from training.networks.generator import Generator
from training.packed_run import START
from training.presets import ModelConfig
from training.rollouts import ENERGY_FRAMES, RENEWED, SWING_FRAMES, RolloutLanes, movements, steered
from training.session import (
    MovingAverage,
    Resumable,
    Session,
    StageLength,
    TrainingState,
    load_checkpoint,
    save_checkpoint,
    train,
)
from training.styles import StyleTable


@dataclass
class MotionData:
    """Frames with normalisation, sampling weights and the Z^t of their clips, on one device."""

    frames: FrameTensors
    normal: Normalisation
    style: StyleTable
    weights: np.ndarray

    def styles(self, clips: Tensor) -> Tensor:
        """Draw Z^t `(B, 384)` of clips `(B,)`, or of one clip per part `(B, 6)`: a random paraphrase, half of the time blended with another."""
        t = torch.rand(len(clips), 1, device=clips.device)
        t = t * (torch.rand(len(clips), 1, device=clips.device) < 0.5)
        z = (1 - t) * self.style.draw(clips) + t * self.style.draw(clips)
        return z + 0.05 * torch.randn_like(z)

    def patch(self, rows: Tensor) -> Tensor:
        """Draw a terrain patch per frame; half of the time the clip's own ground."""
        random = (torch.rand(len(rows), device=rows.device) * self.frames.patches[rows]).long()
        return torch.where(torch.rand(len(rows), device=rows.device) < 0.5, random, torch.zeros_like(random))

    def input(self, rows: Tensor, patch: Tensor) -> Tensor:
        """Return normalised x of captured frames, with paths smoothed as those of a stick."""
        return self.normal.normalised(steered(self.frames.inputs(rows, patch)))

    def output(self, rows: Tensor, patch: Tensor, plan: CompositionPlan | None = None) -> Tensor:
        """Return normalised y, with parts of other clips according to `plan`."""
        return self._standardised(self.frames.outputs(rows, patch, plan))

    def pairs(self, rows: Tensor, patch: Tensor, plan: CompositionPlan) -> tuple[Tensor, Tensor]:
        """Return normalised x, with paths smoothed as those of a stick, and y."""
        x, y = self.frames.pairs(rows, patch, plan)
        return self.normal.normalised(steered(x)), self._standardised(y)

    def _standardised(self, y: Tensor) -> Tensor:
        return (y - self.normal.y_mean) / self.normal.y_deviation


def measure(frames: FrameTensors, weights: np.ndarray, session: Session, count: int = 40000) -> Normalisation:
    """Measure normalisation on `count` weighted frames, composed as in training."""
    torch.manual_seed(session.seed + 1)
    rows = next(RandomRows(weights, count, 0, frames.last, session.generator(3)))
    return Normalisation.measure(
        *frames.pairs(rows, torch.zeros_like(rows), frames.plan(rows, often=COMPOSED_FACTOR))
    )


def _corrupt(x: Tensor, level: float) -> Tensor:
    """Add noise, of random strength per sample, to the inputs that the network feeds back to itself."""
    strength = level * torch.rand(len(x), 1, device=x.device)
    return x + torch.randn_like(x) * strength * _noise_scale(x.device)


@lru_cache
def _noise_scale(device: torch.device) -> Tensor:
    """Return the relative noise strength of each entry of x `(472,)`."""
    scale = torch.ones(INPUT_SIZE, device=device)
    scale[INPUT["gait"]] = 0.0
    for name in ("heights", "trajectory_positions", "trajectory_directions"):
        scale[INPUT[name]] = 0.3
    for name in ("joint_positions", "joint_velocities"):
        scale[INPUT[name]] = 0.4  # the reduced input scale of these fields
    return scale


def stage2_loss(data: MotionData, target: Tensor, predicted: Tensor) -> dict[str, Tensor]:
    """Return Eq. 10 to 13: weighted MSE of M and the contact term, with squared foot velocities from the predicted j^v."""
    reconstruction = terms.motion(target, predicted, loss_weights(target.device))
    normal = data.normal
    field = OUTPUT["joint_velocities"]
    velocity = predicted[:, field] * normal.y_deviation[field] + normal.y_mean[field]
    feet = velocity.unflatten(-1, (-1, 3))[:, constant(SOLE_POINTS, target.device)]
    field = OUTPUT["contacts"]
    labels = target[:, field] * normal.y_deviation[field] + normal.y_mean[field]
    return {"rec": reconstruction, "contact": terms.contact(labels, feet.square().sum(-1))}


CONTACT_WEIGHT = 0.1
ADDED_WEIGHTS = {  # of losses that are not in the paper
    "shown": 0.3,
    "unrest": 0.05,
    "swing": 0.05,
    "own_swing": 0.05,
    "offset": 1.5,
    "bend": 0.3,  # of knee flexion; in rollouts also of its distribution
    "turn": 1.0,  # of pelvis, shoulders, head and feet: only a centimetre at the joints, little in Eq. 11
}
# of captured frames: with more, the network relies less on its own pose, and swings shrink
MAX_INPUT_NOISE = 0.12
LANES_FRACTION = 0.5  # of a batch that continues from the network's own output
LANE_FRAMES = 90.0  # mean length of such a rollout
FOREIGN_POSE_FRACTION = 0.4  # of captured samples with another clip's pose: else poses outweigh words
# relative to stage 1: whole captured bodies are learnt more slowly than composed ones
COMPOSED_FACTOR = 0.65


@dataclass
class MixedBatch:
    """Captured frames with noise, then rollout lanes."""

    z: Tensor
    x: Tensor  # normalised
    target: Tensor  # normalised y


def mixed_batch(data: MotionData, rows: Tensor, lanes: RolloutLanes) -> MixedBatch:
    """Return the first part of `rows`, captured or composed, followed by the lanes."""
    fresh = rows[: len(rows) - len(lanes.rows)]
    patch, plan = data.patch(fresh), data.frames.plan(fresh, often=COMPOSED_FACTOR)
    x, y = data.pairs(fresh, patch, plan)
    x = from_other_poses(x, FOREIGN_POSE_FRACTION)
    in_lanes = data.normal.normalised(steered(lanes.inputs()))
    clips = [plan.words(data.frames.clip[fresh]), lanes.plan.words(data.frames.clip[lanes.rows])]
    return MixedBatch(
        z=data.styles(torch.cat(clips)),
        x=torch.cat([_corrupt(x, MAX_INPUT_NOISE), _corrupt(in_lanes, 0.2 * MAX_INPUT_NOISE)]),
        target=torch.cat([y, data.output(lanes.rows, lanes.patch, lanes.plan)]),
    )


def from_other_poses(x: Tensor, fraction: float) -> Tensor:
    """Return x `(B, 472)` with the previous pose of a `fraction` of the rows taken from other rows.

    Without this a network learns to keep its present pose, and adopts a new style late or never.
    """
    changed = torch.rand(len(x), 1, device=x.device) < fraction
    others = torch.rand(len(x), device=x.device).argsort()
    result = x.clone()
    for name in ("joint_positions", "joint_velocities"):
        result[:, INPUT[name]] = torch.where(changed, x[others, INPUT[name]], x[:, INPUT[name]])
    return result


def full_precision(device: torch.device) -> torch.autocast:
    """Return the context of single precision after the networks: a fed-back pose with three digits jitters."""
    return torch.autocast(device.type, enabled=False)


TURN_UNIT_RAD = 0.15
MAX_TURN_UNITS = 4.0  # clips the error, for example of a head that points to the other side
TURN_WEIGHT = 6.0  # of an angle relative to a joint coordinate
SETTLED_FRAMES = 10  # time for a rollout that started in another pose to reach its clip's


def shown_losses(normal: Normalisation, lanes: RolloutLanes, target: Tensor, y: Tensor) -> dict[str, Tensor]:
    """Return losses of the forward-kinematics pose of normalised y `(B, n)`, and of the lanes' movements.

    `shown` compares the pose with the capture; `training.losses` documents the others.
    """
    field = OUTPUT["joint_positions"]
    scale = normal.y_deviation[field]
    real = y * normal.y_deviation + normal.y_mean
    joints = shown_joints(real)
    wanted = target[:, field] * scale + normal.y_mean[field]
    weights = _shown_weights(y.device)
    result = {"shown": (weights * ((joints.flatten(1) - wanted) / scale).square()).mean()}

    count = len(lanes.rows)
    captured = target * normal.y_deviation + normal.y_mean
    wanted_joints = wanted.unflatten(1, (J, 3))
    result["turn"] = _turn(turns(real, joints), turns(captured, wanted_joints))
    result["bend"] = _bend(real, captured, count)
    own = joints[-count:]
    velocity = OUTPUT["joint_velocities"]
    moved = (own - lanes.previous_joints()).flatten(1) * FPS
    settled = _older(lanes, SETTLED_FRAMES).expand_as(moved)
    result["unrest"] = terms.unrest(moved, real[-count:, velocity], normal.y_deviation[velocity], settled)
    both = movements(real[-count:], own), movements(captured[-count:], wanted_joints[-count:])
    return result | _movement_losses(lanes, both, torch.cat([scale, scale.new_full((TURNS,), TURN_UNIT_RAD)]))


def _movement_losses(lanes: RolloutLanes, moved: tuple[Tensor, Tensor], scale: Tensor) -> dict[str, Tensor]:
    """Return losses of amplitude and mean of the lanes' `movements` relative to their clips'."""
    since = SETTLED_FRAMES + SWING_FRAMES
    kept = torch.ones_like(moved[0])
    kept[:, -TURNS:].fill_(TURN_WEIGHT)
    swings, captured = lanes.swings(*moved)
    energies = lanes.energies(swings.detach(), captured, since)
    offsets = lanes.offsets(*moved, since)
    lived = kept * _older(lanes, since + ENERGY_FRAMES)
    return {
        "swing": terms.swing(swings, captured, scale, kept * _older(lanes, since)),
        "own_swing": terms.own_swing(swings, energies, scale, lived),
        "offset": terms.offset(moved[0] - moved[1], offsets, scale, lived),
    }


def _turn(own: Tensor, wanted: Tensor) -> Tensor:
    """Return the mean square error of `turns` `(B, 9)`, in units of `TURN_UNIT_RAD`."""
    error = torch.remainder(own - wanted + math.pi, 2.0 * math.pi) - math.pi
    error = (error / TURN_UNIT_RAD).clamp(-MAX_TURN_UNITS, MAX_TURN_UNITS)
    return error.square().mean()


def _older(lanes: RolloutLanes, frames: int) -> Tensor:
    """Return `(lanes, 1)`: one where a rollout is at least `frames` old."""
    return (lanes.age >= frames).float()[:, None]


def _bend(real: Tensor, wanted: Tensor, lanes: int) -> Tensor:
    """Return the error of knee flexion, and of its distribution in the last `lanes` rows, which may be out of phase."""
    own, captured = knee_flexion(real), knee_flexion(wanted)
    error = ((own - captured) / terms.BEND_UNIT_RAD).square().mean()
    return error + terms.distribution(own[-lanes:], captured[-lanes:], terms.BEND_UNIT_RAD)


@lru_cache(2)
def _shown_weights(device: torch.device) -> Tensor:
    """Return the weight of Eq. 11 of every joint position `(93,)`."""
    weights = loss_weights(device)[OUTPUT["joint_positions"]]
    return weights / weights.mean()


def motion_losses(data: MotionData, lanes: RolloutLanes, mixed: MixedBatch, y: Tensor) -> Losses:
    """Return the losses of stage 2 for normalised y `(B, n)`, and advance the lanes with it."""
    result = stage2_loss(data, mixed.target, y) | shown_losses(data.normal, lanes, mixed.target, y)
    with torch.no_grad():
        both = (
            v[-len(lanes.rows) :] * data.normal.y_deviation + data.normal.y_mean for v in (y, mixed.target)
        )
        lanes.advance(*both)
    return result


def total_of(result: Losses) -> Tensor:
    """Return the sum of Eq. 10 and the losses that are not in the paper."""
    total = terms.stage2(result["rec"], result["contact"], CONTACT_WEIGHT)
    for name, weight in ADDED_WEIGHTS.items():
        total = total + weight * result[name]
    return total


def mixture_losses(
    data: MotionData, module: Generator, mixed: MixedBatch, lanes: RolloutLanes
) -> tuple[Losses, Tensor]:
    """Return the losses of a batch with E_d, including "total", and embeddings E `(B, n)`; advances the lanes."""
    e, alpha = module.embed(mixed.x, mixed.z)
    with full_precision(e.device):
        y = module.mixture_decoder(e.float(), alpha.float())
        result = motion_losses(data, lanes, mixed, y)
        return result | {"total": total_of(result)}, e.float()


def lanes_of(session: Session, data: MotionData, batch: int, salt: int) -> RolloutLanes:
    """Return the rollouts of a batch, started at random frames."""
    fresh = RandomRows(data.weights, batch, RENEWED, data.frames.last, session.batch_generator(salt))
    return RolloutLanes(data.frames, int(LANES_FRACTION * batch), LANE_FRAMES, fresh, COMPOSED_FACTOR)


def generator_state(
    module: Generator, parameters: Iterable[nn.Parameter], steps: int, sources: Mapping[str, Resumable]
) -> TrainingState:
    """Return AdamW on `parameters` with a moving average of the whole module."""
    optimizer = torch.optim.AdamW(parameters, lr=1e-3, weight_decay=1e-4, fused=True)
    # averaging time: a fifth of the stage, at most 2000 steps
    average = MovingAverage(module, min(0.9995, 1.0 - 5.0 / max(steps, 10)))
    return TrainingState(module, optimizer, average, sources)


def all_but_the_denoiser(module: Generator) -> list[nn.Parameter]:
    """Return the parameters trained by stages 2 and ground."""
    return [p for n, p in module.named_parameters() if not n.startswith("denoiser")]


def run_stage2(session: Session, config: ModelConfig, data: MotionData, length: StageLength) -> Generator:
    """Train everything but the diffusion decoder; AdamWR: cosine annealing with warm restarts (Sec. III-G)."""
    torch.manual_seed(session.seed + 2)
    steps, batch = length.steps, length.batch
    module = Generator(config).to(session.device)
    fine_tuned = (session.out / START).exists()
    if fine_tuned:  # initial weights of an earlier model, unpacked by training.packed_run
        module.load_state_dict(load_checkpoint(session.out / START)["module"])
        without_dropout(module)
    rows = RandomRows(data.weights, batch, 1, data.frames.last, session.batch_generator(4))
    lanes = lanes_of(session, data, batch, 8)
    sources: dict[str, Resumable] = {"rows": rows, "lanes": lanes}
    state = generator_state(module, all_but_the_denoiser(module), steps, sources)

    def losses(item: Tensor) -> Losses:
        return mixture_losses(data, module, mixed_batch(data, item, lanes), lanes)[0]

    def prepare(at: float) -> tuple:
        late = at >= DROPOUT_FRACTION * steps
        if late:
            without_dropout(module)
        return lanes.draw(), late

    cycles = 3 if steps >= SHORT_STEPS else 1
    rate = warm_restarts(steps, peak_of(batch) * (0.5 if fine_tuned else 1.0), cycles)
    state.prepare = prepare
    train(session, "stage2", state, rows, losses, rate, length)
    module.load_state_dict(state.average.values)
    save_checkpoint(
        session.out / "stage2_final.pt", {"module": module.state_dict(), "config": asdict(config)}
    )
    return module


def without_dropout(module: torch.nn.Module) -> None:
    """Switch dropout off for the rest of a stage: swings are no longer reduced by averaging, and rollouts jitter only as
    much as they will in use."""
    for part in module.modules():
        if isinstance(part, torch.nn.Dropout):
            part.p = 0.0


SHORT_STEPS = 6000  # below this a stage is too short for restarts
DROPOUT_FRACTION = 1 / 7  # fraction of stage 2, the first of its three cycles


def peak_of(batch: int) -> float:
    """Return the peak learning rate: 1e-3 for a batch of 256 over all processes, scaled by its square root, at most 2e-3."""
    return min(2e-3, 1e-3 * math.sqrt(batch * parallel.workers() / 256))


def warm_restarts(steps: int, peak: float, cycles: int = 3) -> Callable[[float], float]:
    """Return cosine annealing with cycles of doubling length, the last one ending at `steps`."""
    shortest = steps / (2**cycles - 1)

    def rate(step: float) -> float:
        start, length = 0.0, shortest
        while step >= start + length and length < steps:
            start, length = start + length, 2 * length
        warmup = min(1.0, (step + 1) / 200)
        return (
            peak * warmup * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * min(1.0, (step - start) / length))))
        )

    return rate
