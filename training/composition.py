"""Composition during training: arms, torso and head of other clips on a base clip, at matching gait phase.

Stored layered clips hold some thousand combinations of parts; here every sample is a new combination. A random
`CompositionPlan` says for each sample which parts are replaced, by which clips, and the offset of their clocks from the
base's. Contacts, root, legs and phases are the base's. Posture edits are parts of edited clips; edits of rhythm and
weight move hips and feet, so clips with them are bases, and their torso is never transferred or replaced.

Rotations of a part are relative to its parent: arms and head to the chest (Spine1), the torso above the hips to the
facing direction of the root.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.motion.features import FPS, INPUT, OUTPUT, L
from runtime.skeleton import PART_JOINTS, PART_NAMES, SPORT_SKELETON, J
from training.augmentation.catalogue import PartEdit, catalogue, edits_of_key
from training.augmentation.gait import left_landings, step_phase
from training.frames import FIRST_OF_UPPER as FIRST
from training.frames import FIXED_POINT_SCALE, LAYERED, FrameTable, smooth
from training.gpu import constant, rows_of
from training.kinematics import bone_chains, matrices, turned_back
from training.styles import StyleTexts

PARTS = ("left_arm", "right_arm", "torso", "head")  # that can be taken from another clip
UPPER = J - FIRST
CHEST = SPORT_SKELETON.index("Spine1") - FIRST
JOINTS_OF = [[j - FIRST for j in PART_JOINTS[part] if j >= FIRST] for part in PARTS]
_FROM_CHEST = [j for k, part in enumerate(PARTS) if part != "torso" for j in JOINTS_OF[k]]
CLIP_CLOCK_LENGTH = 4096.0  # offset between the clocks of consecutive clips, so that they never overlap
MIN_LANDINGS = 3  # of the left foot, for a clip to count as stepping
STEADY_SPEED_FRACTION = 0.7  # of a clip's median moving speed: above, the upper body swings fully
COMPOSED_FRACTION = 0.5  # fraction of samples with at least one part of another clip
# near a start, stop, turn or change of gait, which are mostly captured in neutral style
COMPOSED_MOMENTS_FRACTION = 0.8
CHANGED_PART_PROBABILITY = 0.5  # that a part of a composed sample is replaced
# fraction of composed samples whose parts all come from one clip, as a style's upper body
SAME_CLIP_FRACTION = 0.4
EDITED_PART_FRACTION = 0.5  # fraction of single parts that are exact edits; the others are captured
MAX_TEMPO = 1.6  # largest ratio of two cadences at which a part is sped up or slowed down
MIN_CLIP_FRAMES = FPS  # of a clip from which parts are taken
_OF_HIPS = ("sway", "bounce")  # edits of posture that move the hips too
_GIVEN = {part: k for k, part in enumerate(PARTS)}


@dataclass
class UpperBody:
    """Upper bodies `(N, 20, 6)` of all frames and the clocks that synchronise them.

    `clock` `(N,)` increases within a clip: gait cycles, integer where the left foot lands, or seconds where `steps`
    `(clips,)` is false. `activity` `(N,)` is 0 where a stepping clip stands and 1 at its usual speed. `mean`
    `(clips, 20, 6)` is a clip's mean pose while it moves.
    """

    hung: Tensor  # int16
    clock: Tensor  # float64
    activity: Tensor
    mean: Tensor
    steps: Tensor
    cadence: Tensor  # (clips,) cycles a second

    @staticmethod
    def of(table: FrameTable) -> UpperBody:
        """Read the upper bodies of all clips of a table."""
        clips = len(table.styles)
        clock, activity = np.empty(len(table)), np.empty(len(table), np.float32)
        mean, steps = np.empty((clips, UPPER, 6), np.float32), np.zeros(clips, bool)
        cadence = np.ones(clips, np.float32)
        for clip in range(clips):
            rows = slice(int(table.start[clip]), int(table.start[clip + 1]))
            y = np.asarray(table.y[rows], np.float32)
            own = np.asarray(table.upper[rows], np.float32) / FIXED_POINT_SCALE
            contacts = (y[:, OUTPUT["contacts"]] > 0.5).astype(np.uint8)
            landings = left_landings(contacts)
            steps[clip] = len(landings) >= MIN_LANDINGS
            beat = step_phase(contacts) if steps[clip] else np.arange(len(y)) / FPS
            clock[rows] = clip * CLIP_CLOCK_LENGTH + beat - np.floor(beat[0])
            activity[rows] = _activity(y, table.x[rows]) if steps[clip] else 1.0
            if steps[clip]:
                cadence[clip] = FPS / np.median(np.diff(landings))
            moving = activity[rows] >= 0.9
            mean[clip] = own[moving if moving.any() else ~moving].mean(0)
        tensors = (torch.as_tensor(v) for v in (table.upper, clock, activity, mean, steps, cadence))
        return UpperBody(*tensors)

    def to(self, device: torch.device) -> UpperBody:
        return UpperBody(*(value.to(device) for value in vars(self).values()))

    def at(self, low: Tensor, high: Tensor, weight: Tensor, joints: Tensor) -> Tensor:
        """Interpolate 6D rotations `(B, n, 6)` of joints between frames `low` and `high` `(B,)`, not orthonormal."""
        a = self.hung[low[:, None], joints].float()
        b = self.hung[high[:, None], joints].float()
        return torch.lerp(a, b, weight.float()[:, None, None]) / FIXED_POINT_SCALE


def _activity(y: Array, x: Array) -> Array:
    """Return the fraction `(T,)` of its usual swing that an upper body has, from root speed in y `(T, 473)`, x `(T, 342)`."""
    speed = smooth(np.linalg.norm(y[:, OUTPUT["root"]][:, :2], axis=1)[:, None], 10.0)[:, 0]
    standing = np.asarray(x[:, INPUT["gait"]], np.float32).reshape(len(x), L, -1)[:, L // 2, Gait.STAND]
    moving = standing < 0.5
    usual = float(np.median(speed[moving])) if moving.any() else 1.0
    return np.clip(speed / max(STEADY_SPEED_FRACTION * usual, 0.05), 0.0, 1.0)


def acts_on_base(edit: PartEdit) -> bool:
    """Return whether a torso edit moves hips or feet, so that it cannot be transferred to another body."""
    return edit.kind in _OF_HIPS or (edit.does.of_steps and edit.kind != "shoulders")


@dataclass
class CompositionPlan:
    """For every sample: which of `PARTS` are changed `(B, 4)`, their clips `(B, 4)`, and the offset `(B, 4)` from the base's
    clock to the clip's, in cycles, or in seconds for clips that do not step."""

    changed: Tensor
    clips: Tensor
    shift: Tensor

    @staticmethod
    def nothing(count: int, device: torch.device) -> CompositionPlan:
        """Return a plan that changes no part of `count` samples."""
        whole = torch.zeros(count, len(PARTS), device=device)
        return CompositionPlan(whole.bool(), whole.long(), whole.double())

    def __getitem__(self, rows: Tensor | slice) -> CompositionPlan:
        return CompositionPlan(self.changed[rows], self.clips[rows], self.shift[rows])

    def repeated(self, times: int) -> CompositionPlan:
        """Return the plan with each sample repeated `times` times in a row."""
        return CompositionPlan(*(value.repeat_interleave(times, 0) for value in vars(self).values()))

    def words(self, base: Tensor) -> Tensor:
        """Return the clip whose description applies to each body part, `(B, 6)` in the order of `PART_NAMES`."""
        given = torch.where(self.changed, self.clips, base[:, None])
        return torch.stack([given[:, _GIVEN[part]] if part in _GIVEN else base for part in PART_NAMES], dim=1)


@dataclass
class UpperBodyPose:
    """Upper body relative to the root: 6D rotations `(B, 20, 6)`, positions and velocities `(B, 20, 3)`."""

    rotations: Tensor
    positions: Tensor
    velocities: Tensor


class Composer:
    """Draws plans and composes poses from them, on one device; see the module."""

    def __init__(
        self, table: FrameTable, texts: StyleTexts, y: Tensor, moments: np.ndarray, device: torch.device
    ) -> None:
        """`y` `(N, 473)` are the table's outputs on `device`; `moments` `(N,)` marks frames near changes of gait."""
        self.upper = UpperBody.of(table).to(device)
        self.y = y
        self.clip = torch.as_tensor(table.clip.astype(np.int64), device=device)
        self.first = torch.as_tensor(table.start[:-1], device=device)
        self.last = torch.as_tensor(table.start[1:] - 1, device=device)
        self.moments = torch.as_tensor(moments, device=device)
        self.keys = torch.as_tensor(texts.keys, device=device)
        fixed = np.array([any(map(acts_on_base, edits_of_key(name))) for name in texts.names], bool)
        self.fixed_torso = torch.as_tensor(fixed[texts.keys[:, PART_NAMES.index("torso")]], device=device)
        # pairs of edits that never occur together in training: both parts, and both keys
        self.forbidden = torch.as_tensor(_forbidden(texts), device=device).view(-1, 2, 2)
        self._captured, self._edited = _givers(table, texts, device)
        chains, offsets = bone_chains(device)
        # of the upper joints; parents are the hips (0) or these joints (from 1)
        self._chains, self._offsets = chains[FIRST:, FIRST:], offsets[FIRST:]
        self._parents = torch.as_tensor(
            [max(p - FIRST + 1, 0) for p in SPORT_SKELETON.parents[FIRST:]], device=device
        )

    # --- plans --------------------------------------------------------------------------------------------------------

    def draw(self, rows: Tensor, ahead: int = 0, often: float = 1.0) -> CompositionPlan:
        """Draw a plan for base frames `rows` `(B,)`; clips of its parts last `ahead` more frames, or as long as the base.

        `often` scales the fractions of composed samples, `COMPOSED_FRACTION` and `COMPOSED_MOMENTS_FRACTION`.
        """
        count, device = len(rows), rows.device
        composed_fraction = often * torch.where(
            self.moments[rows], COMPOSED_MOMENTS_FRACTION, COMPOSED_FRACTION
        )
        composed = torch.rand(count, device=device) < composed_fraction
        changed = torch.rand(count, len(PARTS), device=device) < CHANGED_PART_PROBABILITY
        changed |= (~changed.any(1, keepdim=True)) & (
            torch.arange(len(PARTS), device=device) == torch.randint(len(PARTS), (count, 1), device=device)
        )
        changed &= composed[:, None] & (rows >= self.first[self.clip[rows]] + 2)[:, None]
        plan = CompositionPlan(
            changed, self._draw_clips(count, device), torch.zeros(count, len(PARTS), device=device)
        )
        return self._allowed(rows, self._matched(rows, plan, ahead))

    def _draw_clips(self, count: int, device: torch.device) -> Tensor:
        captured = weighted(self._captured, (count, len(PARTS)))
        edited = torch.stack([weighted(own, (count,)) for own in self._edited], dim=1)
        clips = torch.where(
            torch.rand(count, len(PARTS), device=device) < EDITED_PART_FRACTION, edited, captured
        )
        same = torch.rand(count, 1, device=device) < SAME_CLIP_FRACTION
        return torch.where(same, captured[:, :1], clips)

    def _matched(self, rows: Tensor, plan: CompositionPlan, ahead: int) -> CompositionPlan:
        """Return the plan with its clock offsets, without parts whose cadence or length does not fit."""
        upper, base = self.upper, self.clip[rows]
        ending = torch.minimum(rows + ahead, self.last[base])
        now, then = (self._base_clock(r, plan.clips) for r in (rows, ending))
        low = upper.clock[self.first[plan.clips]] - plan.clips * CLIP_CLOCK_LENGTH
        high = upper.clock[self.last[plan.clips]] - plan.clips * CLIP_CLOCK_LENGTH
        stepping = upper.steps[plan.clips]
        least, most = low - now, high - then
        # one number per sample: parts of the same clip stay synchronous
        random = torch.rand(len(rows), 1, dtype=torch.float64, device=rows.device)
        free = least + random * (most - least)
        whole = least.ceil() + (random * (most.floor() - least.ceil() + 1)).floor()
        shift = torch.where(stepping, whole, free)
        tempo = upper.cadence[base][:, None] / upper.cadence[plan.clips]
        alike = (tempo < MAX_TEMPO) & (tempo > 1.0 / MAX_TEMPO) | ~upper.steps[base][:, None] | ~stepping
        fits = alike & (shift >= least) & (shift <= most)
        return replace(plan, changed=plan.changed & fits, shift=shift)

    def _base_clock(self, rows: Tensor, clips: Tensor) -> Tensor:
        """Return the base's clock `(B, n)` at frames `rows` `(B,)` in the unit of each of `clips` `(B, n)`: cycles, or seconds."""
        base = self.clip[rows]
        cycles = self.upper.clock[rows] - base * CLIP_CLOCK_LENGTH
        seconds = (rows - self.first[base]).double() / FPS
        return torch.where(self.upper.steps[clips], cycles[:, None], seconds[:, None])

    def _allowed(self, rows: Tensor, plan: CompositionPlan) -> CompositionPlan:
        """Remove torsos that must not be transferred or replaced, and held-out pairs of edits, from a plan."""
        torso = PARTS.index("torso")
        base = self.clip[rows]
        changed = plan.changed.clone()
        changed[:, torso] &= ~(self.fixed_torso[base] | self.fixed_torso[plan.clips[:, torso]])
        clips = replace(plan, changed=changed).words(base)
        keys = self.keys[clips, constant(range(len(PART_NAMES)), rows.device)]
        pairs = (keys[:, self.forbidden[..., 0]] == self.forbidden[..., 1]).all(-1)  # (B, pairs)
        return replace(plan, changed=changed & ~pairs.any(1)[:, None])  # the base itself has no such pair

    def lasts(self, rows: Tensor, plan: CompositionPlan) -> Tensor:
        """Return whether the clips of all changed parts have frames at the base frames `rows`, `(B,)`."""
        clock = self._base_clock(rows, plan.clips) + plan.shift
        high = self.upper.clock[self.last[plan.clips]] - plan.clips * CLIP_CLOCK_LENGTH
        return (~plan.changed | (clock <= high)).all(1)

    # --- poses --------------------------------------------------------------------------------------------------------

    def poses(self, rows: Tensor, plan: CompositionPlan, before: int = 0) -> list[UpperBodyPose]:
        """Return composed poses of base frames `rows` and of the `before` frames that precede them, latest first."""
        with torch.autocast(rows.device.type, enabled=False):  # velocities are small differences
            return self._poses(rows, plan, before)

    def _poses(self, rows: Tensor, plan: CompositionPlan, before: int) -> list[UpperBodyPose]:
        count = before + 2
        index = torch.cat([rows - k for k in range(count)])
        whole = CompositionPlan(*(torch.cat([value] * count) for value in vars(plan).values()))
        turned, positions = self._posed(index, whole)
        from_hips = (positions - positions[:, :1]).unflatten(0, (count, len(rows)))  # joint 0 here: the hips
        result = []
        for k in range(before + 1):
            at = slice(k * len(rows), (k + 1) * len(rows))
            y = self.y[rows - k].float()
            turn = self.y[rows - k - 1][:, OUTPUT["root"]][:, 2].float() / FPS
            moved = (from_hips[k] - turned_back(from_hips[k + 1], turn)) * FPS
            velocities = moved + y[:, OUTPUT["joint_velocities"]][:, None, :3]
            result.append(UpperBodyPose(turned[at], positions[at, 1:], velocities[:, 1:]))
        return result

    def rotations(self, rows: Tensor, plan: CompositionPlan) -> Tensor:
        """Return facing-relative rotation matrices `(B, 20, 3, 3)` of the upper body at base frames `rows`."""
        upper = self.upper
        hung = upper.hung[rows].float() / FIXED_POINT_SCALE
        for k, own in enumerate(JOINTS_OF):
            at, joints = rows_of(plan.changed[:, k]), constant(own, rows.device)
            body = hung[at]
            given = self._given(rows[at], plan.clips[at, k], plan.shift[at, k], joints)
            changed = plan.changed[at, k, None, None]
            hung[at] = body.index_copy(1, joints, torch.where(changed, given, body[:, joints]))
        turned = matrices(hung)
        hangs = constant(_FROM_CHEST, rows.device)
        return turned.index_copy(1, hangs, turned[:, CHEST, None] @ turned[:, hangs])

    def _given(self, rows: Tensor, clips: Tensor, shift: Tensor, joints: Tensor) -> Tensor:
        """Return the poses of clips `(n,)` at base frames `rows`, blended towards the clip's mean where the base stands."""
        upper = self.upper
        wanted = self._base_clock(rows, clips[:, None])[:, 0] + shift + clips * CLIP_CLOCK_LENGTH
        high = torch.searchsorted(upper.clock, wanted)
        high = torch.minimum(torch.maximum(high, self.first[clips] + 1), self.last[clips])
        low = high - 1
        weight = (wanted - upper.clock[low]) / (upper.clock[high] - upper.clock[low])
        given = upper.at(low, high, weight.clamp(0.0, 1.0), joints)
        swings = torch.where(upper.steps[clips], upper.activity[rows], 1.0)[:, None, None]
        swings = torch.where(
            upper.steps[self.clip[rows]][:, None, None] | ~upper.steps[clips][:, None, None], swings, 0.0
        )
        return torch.lerp(upper.mean[clips[:, None], joints], given, swings)

    def _posed(self, rows: Tensor, plan: CompositionPlan) -> tuple[Tensor, Tensor]:
        """Return root-relative 6D rotations `(B, 20, 6)`, and positions `(B, 21, 3)` of the hips and these joints."""
        turned = self.rotations(rows, plan)
        y = self.y[rows]
        hips = y[:, OUTPUT["joint_positions"]][:, :3].float()
        pelvis = matrices(y[:, OUTPUT["joint_rotations"]][:, None, :6].float())
        world = torch.cat([pelvis, turned], dim=1)
        bones = (world[:, self._parents] @ self._offsets[:, :, None])[..., 0]
        positions = hips[:, None] + torch.cat([torch.zeros_like(bones[:, :1]), self._chains @ bones], dim=1)
        return torch.cat([turned[..., 0], turned[..., 1]], dim=-1), positions


def weighted(cumulative: Tensor, size: tuple[int, ...]) -> Tensor:
    """Draw random indices by cumulative weights."""
    draw = torch.rand(size, dtype=torch.float64, device=cumulative.device) * cumulative[-1]
    return torch.searchsorted(cumulative, draw).clamp_max(len(cumulative) - 1)


def _forbidden(texts: StyleTexts) -> np.ndarray:
    """Return pairs of (part, key) that never occur together in training, `(pairs, 2, 2)`."""
    number = {name: k for k, name in enumerate(texts.names)}
    pairs = [
        [(PART_NAMES.index(e.split(".")[0]), number.get(e, -1)) for e in pair]
        for pair in catalogue().held_out_pairs.values()
    ]
    return np.array([pair for pair in pairs if min(key for _, key in pair) >= 0], np.int64)


def _givers(table: FrameTable, texts: StyleTexts, device: torch.device) -> tuple[Tensor, list[Tensor]]:
    """Return cumulative weights `(clips,)` of captured clips, equal over styles, and of the clips that edit each of `PARTS`.

    Held-out clips have weight 0. If no clip edits a part, the captured ones are used.
    """
    length = np.diff(table.start)
    usable = np.logical_not(table.held_out) & (length >= MIN_CLIP_FRAMES)
    layered = np.array([content == LAYERED for content in table.contents])
    captured = usable & ~layered & (np.array(table.sources) != "pfnn_rollouts")
    captured = captured if captured.any() else usable
    weights = np.zeros(len(length))
    styles = np.array(table.styles)
    for style in np.unique(styles[captured]):
        own = captured & (styles == style)
        weights[own] = length[own] / length[own].sum()
    is_edit = np.array([bool(edits_of_key(name)) for name in texts.names])
    edited = []
    for part in PARTS:
        own = usable & layered & is_edit[texts.keys[:, PART_NAMES.index(part)]]
        edited.append((own if own.any() else weights).astype(np.float64))
    cumulative = [torch.as_tensor(np.cumsum(w), device=device) for w in (weights, *edited)]
    return cumulative[0], cumulative[1:]
