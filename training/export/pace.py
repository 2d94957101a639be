"""Data of the runtime besides weights: speeds of styles, phase rates at rest, the neutral style, and the first frame."""

import re
from collections import defaultdict

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view

from runtime.controls import Gait
from runtime.motion.features import FPS, INPUT, OUTPUT, PHASE_OFFSETS, C, L
from runtime.skeleton import PART_NAMES
from training.frames import LAYERED, PLAIN, FrameTable, smooth
from training.styles import StyleTable

STRAIGHT_RAD = np.deg2rad(20.0)  # between velocity and facing direction
STEADY_TURN_RAD_PER_S = 0.35  # of the root, smoothed over a second
MIN_FRAMES = 90  # straight ahead, for a clip to count for its style's pace
DRAWS = 240  # samples of words per captured style, so that styles count equally
# Weights in the fit relative to all captured styles: edits of steps, which have their own pace, and other edits.
PACED_WEIGHT, LAYERED_WEIGHT = 0.15, 0.05
# Probability that a part is another clip's in the composed half of the fit; legs are not exchanged: they set the pace.
OTHERS = {"left_arm": 0.5, "right_arm": 0.5, "torso": 0.4, "head": 0.5}
NEUTRAL_OTHERS_FRACTION = 0.3  # of these parts are neutral
FALLBACKS = {Gait.WALK: 1.3, Gait.JOG: 2.6}  # m/s
# of the neutral walk, with which the program starts and whose words are in many sentences
PLAIN_WEIGHT = 4.0
FORWARD_CONTENTS = {Gait.WALK: ("walk forward",), Gait.JOG: ("run forward", "jog forward")}

# m/s; at other speeds a forward take starts, stops or turns back
FORWARD_SPEEDS = {Gait.WALK: (0.55, 2.2), Gait.JOG: (1.2, 8.0)}


def style_speeds(table: FrameTable, style: StyleTable, paced: np.ndarray, ridge: float = 0.15) -> np.ndarray:
    """Fit a ridge regression `(n + 1, 2)` from the n numbers of Z^t to a style's straight walking and jogging speed, m/s.

    Side steps, turns, starts and stops are excluded, because they would slow down a full stick. Half of the samples have
    arms, torso and head of other clips, as composed in training, so that these do not affect the pace. `paced` `(clips,)`
    bool marks edits of steps.
    """
    torch.manual_seed(0)
    columns, neutral, random = [], neutral_style(table, style), np.random.default_rng(0)
    for label, fallback in FALLBACKS.items():
        clips, targets, weights = _paces(table, label, paced)
        index = torch.as_tensor(clips, device=style.index.device)
        own = style.draw(index).cpu().numpy()  # (0, n) if no clip has the gait
        inputs = np.concatenate([own, _composed(own, neutral, random)])
        columns.append(ridge_regression(inputs, np.tile(targets, 2), np.tile(weights, 2), ridge, fallback))
    return np.stack(columns, 1).astype(np.float32)


def _composed(inputs: np.ndarray, neutral: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Replace some parts of Z^t `(N, n)`, never legs, by those of other rows or of `neutral` `(6, n / 6)`."""
    count = len(inputs)
    parts = inputs.reshape(count, len(PART_NAMES), inputs.shape[1] // len(PART_NAMES))
    result = parts.copy()
    for name, chance in OTHERS.items():
        part = PART_NAMES.index(name)
        others = parts[random.permutation(count), part]
        others[random.random(count) < NEUTRAL_OTHERS_FRACTION] = neutral[part]
        taken = random.random(count) < chance
        result[taken, part] = others[taken]
    return result.reshape(inputs.shape)


def straight_speeds(table: FrameTable, label: Gait) -> np.ndarray:
    """Return the median speed `(clips,)` of each clip straight ahead in a gait; NaN for fewer than `MIN_FRAMES`."""
    gait = table.x[:, INPUT["gait"]].reshape(len(table), L, -1)[:, :, label].min(1).astype(np.float32)
    root = table.y[:, OUTPUT["root"]].astype(np.float32)
    speed = np.linalg.norm(root[:, :2], axis=1)
    result = np.full(len(table.styles), np.nan)
    for clip, span in enumerate(zip(table.start[:-1], table.start[1:], strict=True)):
        part = slice(*span)
        if part.stop - part.start < MIN_FRAMES:
            continue
        across, ahead, turn = (smooth(root[part, k : k + 1], 15.0)[:, 0] for k in range(3))
        straight = (np.abs(np.arctan2(across, ahead)) < STRAIGHT_RAD) & (np.abs(turn) < STEADY_TURN_RAD_PER_S)
        chosen = straight & (gait[part] > 0.9) & (speed[part] > 0.3)
        if chosen.sum() >= MIN_FRAMES:
            result[clip] = np.median(ahead[chosen])
    return result


def forward_speeds(table: FrameTable, label: Gait) -> dict[int, np.ndarray]:
    """Return speeds (over half a second) of every forward take in a gait, by clip, without starts and stops.

    Such takes go straight ahead, or round the room at the same pace; short ones have no starts and stops. The take's name
    decides the gait: a walk with springing steps is a walk, whatever the labels of its frames.
    """
    lowest, highest = FORWARD_SPEEDS[label]
    result = {}
    for clip, content in enumerate(table.contents):
        part = slice(table.start[clip], table.start[clip + 1])
        if content not in FORWARD_CONTENTS[label] or part.stop - part.start < FPS:
            continue
        root = table.y[part, OUTPUT["root"]][:, :2].astype(np.float32)
        mean = sliding_window_view(root, FPS // 2, axis=0).mean(-1)
        speed = np.linalg.norm(mean, axis=1)
        result[clip] = speed[(speed > lowest) & (speed < highest)]
    return result


def captured_paces(table: FrameTable, label: Gait) -> dict[str, float]:
    """Return the straight speed of each captured style, from its forward takes if it has any."""
    forward, straight = forward_speeds(table, label), straight_speeds(table, label)
    takes: dict[str, dict[str, list[np.ndarray]]] = defaultdict(lambda: defaultdict(list))
    others = defaultdict(list)
    for clip, (name, style, content) in enumerate(
        zip(table.names, table.styles, table.contents, strict=True)
    ):
        if content == LAYERED or " on " in content or table.mirrored[clip]:
            continue
        if clip in forward:
            takes[style][re.sub(r"_\d$", "", name)].append(forward[clip])  # long takes are cut into parts
        if np.isfinite(straight[clip]):
            others[style].append(straight[clip])
    paces = {style: _pace(list(takes[style].values()), others[style]) for style in sorted(set(table.styles))}
    return {style: pace for style, pace in paces.items() if pace is not None}


def _pace(takes: list[list[np.ndarray]], others: list[float]) -> float | None:
    """Return the median speed of forward takes that are long enough, or else of other clips."""
    speeds = [np.median(s) for s in map(np.concatenate, takes) if len(s) >= FPS] or others
    return float(np.median(speeds)) if speeds else None


def _paces(table: FrameTable, label: Gait, paced: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the clips of the fit `(n,)`, the pace of each in m/s and its weight."""
    paces = captured_paces(table, label)
    random = np.random.default_rng(0)
    styles = np.array(table.styles)
    layered = np.array([c == LAYERED for c in table.contents])
    clips, targets = [], []
    for name, pace in paces.items():
        own = np.flatnonzero((styles == name) & ~layered)
        clips.append(random.choice(own, DRAWS))
        targets.append(np.full(DRAWS, pace))
    captured = sum(map(len, clips))
    own_pace = straight_speeds(table, label)
    made = np.flatnonzero(layered & np.isfinite(own_pace))
    clips.append(made)
    targets.append(own_pace[made])
    weights = np.ones(captured + len(made))
    weights[:captured][styles[np.concatenate(clips)[:captured]] == PLAIN] = PLAIN_WEIGHT
    for weight, own in ((PACED_WEIGHT, paced[made]), (LAYERED_WEIGHT, ~paced[made])):
        if captured and own.any():
            weights[captured:][own] = weight * captured / own.sum()
    return np.concatenate(clips).astype(np.int64), np.concatenate(targets), weights


def neutral_style(table: FrameTable, style: StyleTable) -> np.ndarray:
    """Return the mean Z^t `(6, n / 6)` of plain captured clips, or of all clips if there are none."""
    plain = [s == PLAIN and c != LAYERED for s, c in zip(table.styles, table.contents, strict=True)]
    clips = [c for c, known in enumerate(plain) if known] or list(range(len(table.styles)))
    index = style.index[torch.as_tensor(clips, device=style.index.device)]
    return style.of(index.flatten(0, 1)).mean(0).view(6, -1).cpu().numpy()


def ridge_regression(
    inputs: np.ndarray, values: np.ndarray, weights: np.ndarray, ridge: float, fallback: float
) -> np.ndarray:
    """Return weights `(n + 1,)`, intercept last, from inputs `(N, n)` to values `(N,)`; `fallback` if there are none."""
    if len(values) < 2:
        return np.concatenate([np.zeros(inputs.shape[-1]), [fallback]])
    mean = np.average(values, weights=weights)
    weighted = inputs * weights[:, None]
    matrix = inputs.T @ weighted + ridge * weights.sum() / 100 * np.eye(inputs.shape[1])
    return np.concatenate([np.linalg.solve(matrix, weighted.T @ (values - mean)), [mean]])


def start_state(table: FrameTable, phase: np.ndarray) -> dict[str, list[float]]:
    """Return the calmest standing frame of a plain clip, the initial state: upright, with straight knees."""
    styles = np.array(table.styles)[table.clip]
    gait = table.x[:, INPUT["gait"]].reshape(len(table), L, -1)[:, :, Gait.STAND].min(1)
    contacts = table.y[:, OUTPUT["contacts"]].min(1)
    speed = np.abs(table.y[:, OUTPUT["joint_velocities"]].astype(np.float32)).mean(1)
    captured = np.array([c != LAYERED for c in table.contents])[table.clip]
    neutral = (styles == PLAIN) & ~table.mirrored[table.clip] & captured
    penalty = 10.0 * (gait < 0.9) + 5.0 * (contacts < 0.5) + 20.0 * ~neutral
    row = int(np.argmin(speed + penalty))
    first, last = table.start[table.clip[row]], table.start[table.clip[row] + 1] - 1
    window = np.clip(row + PHASE_OFFSETS, first, last)
    output = table.y[row].astype(np.float32)
    output[OUTPUT["joint_positions"]][1::3] -= table.ground[row, 0]
    return {
        "output": [round(float(v), 4) for v in output],
        "phase": [round(float(v), 4) for v in phase[window].reshape(-1)],
    }


REST_DRAWS = 6  # samples of words per standing clip
STANDING_FRACTION = 0.9  # of a clip's frames, for a standing clip
MARGIN_FRAMES = 10  # at both ends, where the autoencoder's window is incomplete
MIN_REST_FRAMES = FPS


def rest_rhythm(table: FrameTable, phase: np.ndarray, style: StyleTable) -> np.ndarray:
    """Fit a ridge regression `(n + 1, 2 C)` from the n numbers of Z^t to each channel's amplitude, then its rate (Hz), at rest.

    A standing body has no steps as a clock. The network knows how a waving hand moves at each phase, but its predicted
    phase stalls; so the runtime advances the phases of such styles by a clock.
    """
    torch.manual_seed(0)
    clips = [clip for clip in range(len(table.styles)) if _stands(table, clip)]
    found = np.array([_rhythm(phase[_inner(table, clip)]) for clip in clips]).reshape(len(clips), 2 * C)
    index = torch.as_tensor(clips * REST_DRAWS, device=style.index.device, dtype=torch.long)
    inputs = style.draw(index).cpu().numpy()  # (0, n) where no clip stands
    values, weights = np.tile(found, (REST_DRAWS, 1)), np.ones(len(index))
    columns = [ridge_regression(inputs, values[:, k], weights, 0.5, 0.0) for k in range(2 * C)]
    return np.stack(columns, 1).astype(np.float32)


def _inner(table: FrameTable, clip: int) -> slice:
    return slice(int(table.start[clip]) + MARGIN_FRAMES, int(table.start[clip + 1]) - MARGIN_FRAMES)


def _stands(table: FrameTable, clip: int) -> bool:
    frames = _inner(table, clip)
    if frames.stop - frames.start < MIN_REST_FRAMES or table.held_out[clip]:
        return False
    gait = table.x[frames, INPUT["gait"]].reshape(-1, L, len(Gait))[:, L // 2, Gait.STAND]
    return float((gait > 0.5).mean()) > STANDING_FRACTION


def _rhythm(phase: np.ndarray) -> np.ndarray:
    """Return mean amplitude `(C,)` and rate in Hz `(C,)` of phases `(T, C, 2)`."""
    phase = np.asarray(phase, np.float64)
    angle = np.unwrap(np.arctan2(phase[..., 0], phase[..., 1]), axis=0)
    turns = (angle[-1] - angle[0]) / (2 * np.pi) * FPS / (len(angle) - 1)
    return np.concatenate([np.linalg.norm(phase, axis=-1).mean(0), turns])
