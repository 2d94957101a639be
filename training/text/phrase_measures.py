"""Numeric meaning of phrases in descriptions, measured on the captured clips whose captions use them.

    python -m training.text.phrase_measures --clips RUN/clips [--disagreements]

The pose edits of the runtime measure every steady stretch of a clip as they measure a walk of the network, so that
targets and measurements are comparable. `assets/prompts/phrase_measures.json` contains the range of each target for every
captured style and gait, for every phrase of edits.toml in captions (over the styles whose captions use it), and the usual
range in a gait. `--disagreements` lists captions whose hand-written meaning contradicts their capture.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array, Flags
from runtime.assets import asset_path
from runtime.atomic import write_atomic
from runtime.edits.body import BodyEdits
from runtime.edits.request import ARM, GAITS, MAX_TARGET, PACE, PARTS, SHAPE, TRUNK, EditRequest
from runtime.errors import FileError, run_command
from runtime.measures.signals import smoothed, smoothed_facing
from runtime.measures.table import TARGETS, kind_of, targets_of
from runtime.motion.features import FPS
from runtime.motion.style import NEUTRAL_M_PER_S
from runtime.prompts.captured import PHRASE_MEASURES, captions_by_style, captured
from runtime.prompts.edit_targets import HAND, phrases, spoken
from runtime.prompts.library_data import load_styles
from runtime.safe_read import open_npz
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.footplants import stretches
from training.frames import PLAIN

ASKED_WEIGHT = 1e-5  # of the requested edit: measures without changing the pose
LABELS = {"walk": 1, "jog": 2, "crouch": 3}  # columns of a clip's gait
# words for a gait in a clip's content; slow runs are labelled as walks
_CONTENTS = {"walk": ("walk",), "jog": ("run", "jog", "dash"), "crouch": ("crouch",)}
LEAD_S, MIN_STRETCH_S, EVERY_S = 0.8, 1.3, 0.2  # skipped, shortest length and sampling interval of a stretch
MIN_SPEED_M_PER_S, MAX_TURN_RAD_PER_S, MAX_OFF_RAD = 0.25, 0.7, 0.45  # of steady walking straight ahead
TWISTING_FACTOR = 3.0  # on the limits of turn and direction, in clips with less steady walking than this:
MIN_STEADY_S, MIN_STEADY_FRACTION = 20.0, 0.25  # for example drunk or angry walks
CLIPS_OF_STYLE, MAX_STRETCH_S = 12, 10.0  # at most, per style and content; per stretch
_NOT_AHEAD = ("back", "left", "right", "side", "turn", "jump", "idle", "stand", "transition", "terrain")
SPREAD_PERCENT = (30.0, 50.0, 70.0)  # low end, median and high end of a target
QUARTILES_PERCENT = (25.0, 75.0)  # of the medians of several styles
UNMEASURED = (HAND, "shrug")
USUAL = ("lean", "bounce")  # targets of the trunk, measured for all styles
HAND_RANGE = "hand_range"  # of an arm, in addition to its targets
FAR_OFF = {row.name: row.far for row in TARGETS if row.far}
Reading = dict[str, dict[str, float]]  # part, target
Spread = dict[str, dict[str, list[float]]]  # part, target: percentiles `SPREAD_PERCENT`
Ends = dict[str, dict[str, list[float]]]  # part, target: first and last of these


def read_clip(path: Path) -> tuple[str, dict[str, list[Reading]]]:
    """Return the style of a clip, and the readings of its steady stretches by gait."""
    with open_npz(path, "Run the importer again.") as clip:
        style = str(clip["style"])
        hips, local, contacts = clip["hips_positions"], clip["local_rotations"], clip["contacts"]
        gaits, named = clip["gait"], _gaits_named(str(clip["content"]))
    yaw = smoothed_facing(SPORT_SKELETON.forward_kinematics(hips, local)[0])
    velocity = np.gradient(smoothed(hips[:, [0, 2]], 0.5), axis=0) * FPS
    steady = _steady(yaw, velocity)
    least = min(MIN_STEADY_S * FPS, MIN_STEADY_FRACTION * len(steady))
    if sum(part.stop - part.start for part in _stretches(steady)) < least:
        steady = _steady(yaw, velocity, TWISTING_FACTOR)
    found: dict[str, list[Reading]] = {}
    for gait in named:
        alone = len(named) == 1
        for part in _stretches(steady if alone else steady & (gaits[:, LABELS[gait]] > 0.5)):
            rows = _read(hips[part], local[part], contacts[part], yaw[part], velocity[part], gait == "jog")
            found.setdefault(gait, []).extend(rows)
    return style, {gait: rows for gait, rows in found.items() if rows}


def _gaits_named(content: str) -> list[str]:
    """Return the gaits named in a clip's content; a crouched walk is a crouch."""
    named = [gait for gait, words in _CONTENTS.items() if any(word in content for word in words)]
    return ["crouch"] if "crouch" in named else named


def _steady(yaw: Array, velocity: Array, times: float = 1.0) -> Flags:
    speed = np.linalg.norm(velocity, axis=1)
    turn = np.abs(np.gradient(np.unwrap(yaw))) * FPS
    off = np.arctan2(velocity[:, 0], velocity[:, 1]) - yaw
    off = np.abs((off + np.pi) % (2.0 * np.pi) - np.pi)
    return np.asarray(
        (speed > MIN_SPEED_M_PER_S)
        & (smoothed(turn[:, None], 0.5)[:, 0] < times * MAX_TURN_RAD_PER_S)
        & (smoothed(off[:, None], 0.5)[:, 0] < times * MAX_OFF_RAD)
    )


def _stretches(steady: Flags) -> Iterator[slice]:
    for first, last in stretches(steady):
        if last - first >= MIN_STRETCH_S * FPS:
            yield slice(first, int(min(last, first + MAX_STRETCH_S * FPS)))


def _read(
    hips: Array, local: Array, contacts: Array, yaw: Array, velocity: Array, jogs: bool
) -> Iterator[Reading]:
    edits, targets = BodyEdits(), np.zeros(SHAPE[1:])
    targets[...] = ASKED_WEIGHT * np.array([1.0, -MAX_TARGET, MAX_TARGET])
    targets[3:, len(ARM) :] = 0.0  # no target positions
    targets[2, len(TRUNK) :] = 0.0
    asked = targets.tolist()
    reach = _hand_ranges(hips, local)
    for k in range(len(hips)):
        request = EditRequest(asked, float(yaw[k]), (float(velocity[k, 0]), float(velocity[k, 1])), 0.0)
        edits.apply(hips[k], local[k], contacts[k].astype(float), request)
        if k >= LEAD_S * FPS and k % round(EVERY_S * FPS) == 0:
            found = reading(edits, float(np.hypot(*velocity[k])) / NEUTRAL_M_PER_S[jogs])
            for part, moved in reach.items():
                found[part][HAND_RANGE] = moved
            yield found


def _hand_ranges(hips: Array, local: Array) -> dict[str, float]:
    """Return the range of motion of each hand relative to its shoulder, metres end to end."""
    positions, _ = SPORT_SKELETON.forward_kinematics(hips - hips * [1, 0, 1], local)
    found = {}
    for side in ("Left", "Right"):
        reach = (
            positions[:, SPORT_SKELETON.index(f"{side}Hand")]
            - positions[:, SPORT_SKELETON.index(f"{side}Arm")]
        )
        away = reach - smoothed(reach, 1.1)
        found[f"{side.lower()}_arm"] = float(2.0 * np.sqrt(2.0 * (away**2).sum(1).mean()))
    return found


def reading(edits: BodyEdits, pace: float) -> Reading:
    """Return the values that the edits measured, by part and target."""
    found = {
        part: {
            name: row.shown(edits, int(part.startswith("right")))
            for name, row in targets_of(part).items()
            if row.shown is not None
        }
        for part in PARTS
    }
    found["left_leg"][PACE] = found["right_leg"][PACE] = pace
    return found


def measured(clips: Path) -> dict[str, Any]:
    """Measure the clips in a folder; returns the content of the file. FileError if there are no clips."""
    paths = _chosen(clips)
    read: dict[str, dict[str, list[Reading]]] = defaultdict(lambda: defaultdict(list))
    for style, found in map(read_clip, paths):
        for gait, rows in found.items():
            read[style][gait] += rows
    return tree_of(read)


def tree_of(read: Mapping[str, Mapping[str, Sequence[Reading]]]) -> dict[str, Any]:
    """Return the content of the file from readings by style and gait."""
    full = {s: {g: _spread(rows) for g, rows in gaits.items() if rows} for s, gaits in read.items()}
    plain = [row for style, gaits in read.items() if style.startswith(PLAIN) for row in gaits.get("walk", ())]
    _lean_as_several_captures(full)
    styles = {s: {g: _ends(parts) for g, parts in gaits.items()} for s, gaits in full.items()}
    return {"usual": _usual(full), "phrases": _phrases(full, _spread(plain)), "styles": styles}


def _lean_as_several_captures(styles: Mapping[str, Mapping[str, Spread]]) -> None:
    """Set the lean of the neutral style to the quartiles over neutral captures, whose spines differ, in place."""
    for gait in ("walk", "jog"):
        neutral = [own for s, own in styles.items() if s.startswith(f"{PLAIN}_") and gait in own]
        if neutral and gait in styles.get(PLAIN, {}):
            middles = [own[gait]["torso"]["lean"][1] for own in neutral]
            styles[PLAIN][gait]["torso"]["lean"] = _percentiles(middles, (25.0, 50.0, 75.0))


def _chosen(clips: Path) -> list[Path]:
    """Select captured clips that move ahead, some of every style and content; FileError if there are none."""
    found: dict[tuple[str, str], list[Path]] = defaultdict(list)
    for path in sorted(clips.glob("*.npz")):
        if path.stem.startswith("layer_") or path.stem.endswith(("_m", "_t")):
            continue
        with open_npz(path, "Run the importer again.") as clip:
            style, content = str(clip["style"]), str(clip["content"])
        if not any(word in content for word in _NOT_AHEAD):
            found[style, content].append(path)
    if not found:
        raise FileError(f"{clips}: no clips (*.npz).", "Run `sport train import --data DIR --out DIR`.")
    return [path for own in found.values() for path in own[:: -(-len(own) // CLIPS_OF_STYLE)]]


def _spread(rows: Sequence[Reading]) -> Spread:
    """Return low end, median and high end of each target."""
    return {
        part: {name: _percentiles([row[part][name] for row in rows], SPREAD_PERCENT) for name in own}
        for part, own in rows[0].items()
    }


def _percentiles(values: Sequence[float], percents: Sequence[float]) -> list[float]:
    """Return percentiles of values, rounded to three digits."""
    return [
        float(f"{value:.3g}") if abs(value) < 100.0 else round(value)
        for value in np.percentile(values, percents).tolist()
    ]


def _ends(parts: Spread) -> Ends:
    return {part: {name: [r[0], r[-1]] for name, r in ranges.items()} for part, ranges in parts.items()}


def _usual(styles: Mapping[str, Mapping[str, Spread]]) -> dict[str, dict[str, list[float]]]:
    """Return the usual range of trunk targets in each gait."""
    found = {gait: _usual_in(gait, styles) for gait in GAITS}
    return {gait: own for gait, own in found.items() if own}


def _usual_in(gait: str, styles: Mapping[str, Mapping[str, Spread]]) -> dict[str, list[float]]:
    """Return usual trunk ranges: for walks the neutral style's, for other gaits the quartiles of the styles' medians."""
    if gait == "walk" and PLAIN in styles:
        own = _ends(styles[PLAIN][gait])["torso"]
        return {name: own[name] for name in USUAL}
    trunks = [own[gait]["torso"] for own in styles.values() if gait in own]
    middles = {name: [trunk[name][1] for trunk in trunks] for name in USUAL if trunks}
    return {name: _percentiles(own, QUARTILES_PERCENT) for name, own in middles.items()}


def _phrases(styles: Mapping[str, Mapping[str, Spread]], usual: Spread) -> dict[str, Any]:
    """Return ranges by kind, target, phrase and gait over the styles whose captions use the phrase, if they show it."""
    found: dict[str, Any] = {}
    for (part, name, phrase), names in sorted(_using(set(styles)).items()):
        rows = [styles[style] for style in dict.fromkeys(names)]
        ranges = {g: _over([row[g][part][name] for row in rows if g in row]) for g in GAITS}
        by_hand = phrases()[kind_of(part)][name][phrase][1]
        if ranges["walk"] and _shows(ranges["walk"], usual[part][name], by_hand):
            table = found.setdefault(kind_of(part), {}).setdefault(name, {})
            table[phrase] = {gait: own for gait, own in ranges.items() if own}
    return found


def _using(styles: Collection[str]) -> dict[tuple[str, str, str], list[str]]:
    """Return the styles whose captions use a phrase, by part, target and phrase; limbs as left ones."""
    using: dict[tuple[str, str, str], list[str]] = defaultdict(list)
    for style, part, text in _captions():
        if style in styles and not part.startswith("right_"):
            for name, (_, phrase, (_, values)) in spoken(part, text).items():
                if values and name not in UNMEASURED:
                    using[part, name, phrase].append(style)
    return using


def _captions() -> Iterator[tuple[str, str, str]]:
    """Yield style, part and text of the captions of captured styles."""
    return captions_by_style(load_styles(asset_path("prompts/styles.json")))


def _shows(range_: Sequence[float], usual: Sequence[float], by_hand: Sequence[float]) -> bool:
    """Return whether captures show a phrase: their range exceeds the usual one in the direction of the words."""
    least, most = by_hand
    low, middle, high = usual
    if least <= middle <= most:
        return True
    return range_[0] > high if least > middle else range_[1] < low


def _over(ranges: Sequence[Sequence[float]]) -> list[float]:
    """Return the range of one style; for several, the quartiles of their medians."""
    if len(ranges) < 2:
        return [ranges[0][0], ranges[0][-1]] if ranges else []
    return _percentiles([r[1] for r in ranges], QUARTILES_PERCENT)


def disagreements(styles: Mapping[str, Any]) -> Iterator[str]:
    """Yield lines on captions that differ much from their captured walk."""
    for style, part, text in dict.fromkeys(_captions()):
        own = styles.get(style, {}).get("walk", {}).get(part)
        if own is not None and not part.startswith("right_"):
            for name, (clause, phrase, (_, values)) in spoken(part, text).items():
                wrong = _far_off(part, name, phrase, values, own) if values else ""
                if wrong:
                    yield f"{style}: {clause}: {wrong} ({text})"


def _far_off(
    part: str, name: str, phrase: str, values: Sequence[float], own: Mapping[str, Sequence[float]]
) -> str:
    """Return the contradiction between a phrase and its capture, "" if they are close."""
    if name == HAND:
        far = own[HAND_RANGE][0] > values[-1] + FAR_OFF["swing"]
        return f"its hand moves by {own[HAND_RANGE]} m" if far else ""
    if name not in FAR_OFF:
        return ""
    shown = captured().phrase(kind_of(part), phrase, name)
    least, most = (shown and shown[0]) or values
    low, high = own[name]
    if low > most + FAR_OFF[name] or high < least - FAR_OFF[name]:
        return f"{name} of {least} to {most}, captured {low} to {high}"
    return ""


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Measure the numeric meaning of phrases in captions.")
    parser.add_argument("--clips", type=Path, required=True, help="folder of imported clips")
    parser.add_argument(
        "--disagreements", action="store_true", help="list captions that contradict their capture"
    )
    args = parser.parse_args(argv)
    tree = measured(args.clips)
    if args.disagreements:
        print("\n".join(disagreements(tree["styles"])))
    else:
        write_atomic(asset_path(PHRASE_MEASURES), json.dumps(tree, indent=1) + "\n")


if __name__ == "__main__":
    raise SystemExit(run_command("phrase measures", main))
