"""`sport train layer`: edited clips from imported ones, each with six descriptions of its own.

    python -m training.augmentation.build --clips DIR --out DIR

Writes `layer_*.npz` next to (or apart from) the imported clips, and `layers.json`: for every edited clip the
descriptions of its parts, a key that names what each part does, and what the clip was made of.
"""

import argparse
import json
import logging
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from runtime.assets import asset_path
from runtime.atomic import write_atomic
from runtime.controls import Gait
from runtime.errors import run_command
from runtime.motion import features
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES
from training.arguments import LAYERED_CLIPS
from training.augmentation import recipes
from training.augmentation.catalogue import PartEdit, part_edits
from training.augmentation.edits import apply
from training.augmentation.measured_edits import rhythm_section
from training.augmentation.motion import EditedMotion, cut
from training.augmentation.pool import NEUTRAL_FRACTION, Pool, Source
from training.data import relief
from training.data.clips import Patches, TrainingClip
from training.data.labels import FOOT_JOINTS
from training.data.sources import style_library
from training.frames import LAYERED
from training.markdown import table

log = logging.getLogger("sport.train")

CLIP_S = (4.0, 7.0)
PARAPHRASES = 4
LAYERS = "layers.json"
_MADE = "layers.jsonl"  # of an unfinished build: one line per clip
LEVEL_M = 0.015  # largest ground height at contacts that counts as a level floor
BASES_FRACTION = 0.6  # of the clips, with edits of legs only: the rest is composed in training
WALKED_FRACTION = 0.5  # of a clip's frames that must be walking, for edits of steps
TRIES = 30  # number of clips drawn for edits that do not fit every clip
FORWARD_FRACTION = 0.8  # of a path that must lead where the body faces
MIN_M_PER_S = 0.3  # mean speed of a walk


def build_layer(
    pool: Pool, styles: dict[str, dict], name: str, random: np.random.Generator
) -> tuple[TrainingClip, dict[str, object]] | None:
    """Build an edited clip and its entry of `layers.json`; None if no clip is found that can show the drawn edits."""
    source, motion = _piece(pool, NEUTRAL_FRACTION, random)
    texts = _style_texts(styles, source, random)
    standing = bool(np.asarray(motion.gait)[:, Gait.STAND].mean() > 0.5)
    names = (recipes.draw_base if random.random() < BASES_FRACTION else recipes.draw)(random, standing)
    edits = [part_edits()[name] for name in names]
    if not _suits(source, motion, edits):
        found = _suitable(pool, edits, random)
        if found is None:
            return None
        source, motion = found
        texts = _style_texts(styles, source, random)
    keys: dict[str, str] = {}
    for edit in edits:
        motion = apply(motion, edit, random)
        _describe(edit, texts, keys, random)
    clip = TrainingClip(
        name=name,
        hips=motion.hips,
        local=motion.local,
        contacts=motion.contacts,
        gait=np.asarray(motion.gait),
        style=source.style,
        content=LAYERED,
        source=source.source,
        split="train",
        tier=LAYERED,
        patches=_ground(source, motion, edits, random),
        mirrored=source.mirrored,
    )
    entry = {
        "descriptions": [{p: own[k % len(own)] for p, own in texts.items()} for k in range(PARAPHRASES)],
        "keys": [keys.get(part, source.key) for part in PART_NAMES],
        "base": source.name,
        "edits": list(names),
    }
    return clip, entry


def _describe(
    edit: PartEdit, texts: dict[str, list[str]], keys: dict[str, str], random: np.random.Generator
) -> None:
    """Replace the style's sentences and keys by the edit's, or combine them with those of an earlier edit, in place."""
    for part, phrases in edit.phrases.items():
        order = random.permutation(max(len(phrases), 4)) % len(phrases)
        own = [phrases[int(k)] for k in order]
        key = edit.name if len(edit.phrases) == 1 else f"{edit.name}.{part}"
        texts[part] = _both(part, texts[part], own, random) if part in keys else own
        keys[part] = f"{keys[part]}+{key}" if part in keys else key


def _both(part: str, ones: list[str], others: list[str], random: np.random.Generator) -> list[str]:
    """Return sentences that combine those of two edits, in either order."""
    pairs = [
        (one, other) if random.random() < 0.5 else (other, one)
        for one, other in zip(ones, others, strict=False)
    ]
    return [f"{first}, {second.removeprefix(part.replace('_', ' ') + ' ')}" for first, second in pairs]


def _piece(pool: Pool, neutral: float, random: np.random.Generator) -> tuple[Source, EditedMotion]:
    """Draw a clip, neutral with the given probability, and some seconds of it."""
    source = pool.draw(random, neutral)
    frames = int(random.uniform(*CLIP_S) * features.FPS)
    length = len(source.motion.hips)
    start = int(random.integers(max(1, length - frames)))
    return source, cut(source.motion, start, min(start + frames, length))


def _style_texts(
    styles: dict[str, dict], source: Source, random: np.random.Generator
) -> dict[str, list[str]]:
    """Return the descriptions of a captured style by part, shuffled separately for each part."""
    descriptions = [PartDescriptions.from_mapping(d) for d in styles[source.style]["descriptions"]]
    if source.mirrored:
        descriptions = [d.mirrored() for d in descriptions]
    orders = {part: random.permutation(len(descriptions))[:PARAPHRASES] for part in PART_NAMES}
    return {part: [getattr(descriptions[int(k)], part) for k in own] for part, own in orders.items()}


def _suits(source: Source, motion: EditedMotion, edits: list[PartEdit]) -> bool:
    """Return whether edits can be visible: scaled swings need a neutral style, edits of feet a walk on a floor."""
    walked = np.asarray(source.motion.gait)[:, Gait.WALK].mean()
    if any(e.does.scales for e in edits) and not source.style.startswith("neutral"):
        return False
    if any(e.does.of_steps for e in edits) and walked < WALKED_FRACTION:
        return False
    return not any(e.does.moves_feet for e in edits) or walks_on_a_floor(motion)


def _suitable(
    pool: Pool, edits: list[PartEdit], random: np.random.Generator
) -> tuple[Source, EditedMotion] | None:
    """Draw another clip and a piece of it that suit the edits; None after `TRIES` draws."""
    neutral = 1.0 if any(e.does.scales for e in edits) else NEUTRAL_FRACTION
    pieces = (_piece(pool, neutral, random) for _ in range(TRIES))
    return next((piece for piece in pieces if _suits(*piece, edits)), None)


def walks_on_a_floor(motion: EditedMotion) -> bool:
    """Return whether a motion walks forward on level ground, so that its feet can be moved."""
    feet = motion.joints[0][:, FOOT_JOINTS]
    ground = motion.ground.height(feet[..., 0], feet[..., 2])
    standing = motion.contacts.astype(bool)
    if not standing.any() or np.abs(ground[standing]).max() > LEVEL_M:
        return False
    step = np.diff(motion.path, axis=0)
    along = np.sum(step * motion.axes.ahead[1:], axis=1)
    gone = np.linalg.norm(step[:, [0, 2]], axis=1)
    return bool(
        gone.sum() > MIN_M_PER_S * len(gone) / features.FPS and along.sum() > FORWARD_FRACTION * gone.sum()
    )


def _ground(
    source: Source, motion: EditedMotion, edits: list[PartEdit], random: np.random.Generator
) -> Patches:
    """Return the clip's own ground, or new relief around the footsteps if feet were moved."""
    if any(e.does.moves_feet for e in edits):
        return relief.fit_around_steps(motion.joints[0], motion.contacts, random)
    return _near(source.patches, motion.hips)


def _near(patches: Patches, hips: np.ndarray, margin: float = 2.5) -> Patches:
    """Crop the ground to within `margin` metres of the path."""
    _count, n, m = patches.heights.shape
    if n <= 2:
        return patches
    x0, z0 = patches.origin
    low = np.floor((hips[:, [0, 2]].min(0) - margin - (x0, z0)) / patches.cell).astype(int)
    high = np.ceil((hips[:, [0, 2]].max(0) + margin - (x0, z0)) / patches.cell).astype(int) + 1
    low, high = np.clip(low, 0, (n - 2, m - 2)), np.clip(high, 2, (n, m))
    piece = patches.heights[:, low[0] : high[0], low[1] : high[1]]
    return Patches(piece, (x0 + low[0] * patches.cell, z0 + low[1] * patches.cell), patches.cell)


def build_layers(clips: Path, out: Path, count: int, seed: int = 0) -> dict[str, dict]:
    """Write `count` layered clips and `layers.json` into `out`, on all cores; returns the entries by clip name.

    Each has its own random seed, so that an interrupted build resumes with the same clips.
    """
    _sources(clips)  # cached before the worker processes start
    out.mkdir(parents=True, exist_ok=True)
    made = out / _MADE
    entries = _made_so_far(made)
    with made.open("a", encoding="utf-8") as lines, ProcessPoolExecutor() as processes:
        build = partial(_one_layer, clips, out, seed)
        for name, entry in processes.map(build, range(len(entries), count), chunksize=8):
            entries[name] = entry
            lines.write(json.dumps([name, entry]) + "\n")
            lines.flush()
            if len(entries) % 200 == 0:
                log.info("%d of %d layered clips", len(entries), count)
    write_atomic(out / LAYERS, json.dumps(entries) + "\n")
    made.unlink()
    return entries


def _made_so_far(path: Path) -> dict[str, dict]:
    """Read the entries of an interrupted build; an incomplete last line is ignored."""
    if not path.exists():
        return {}
    whole = [line for line in path.read_text("utf-8").splitlines(keepends=True) if line.endswith("\n")]
    path.write_text("".join(whole), "utf-8")
    return dict(json.loads(line) for line in whole)


@lru_cache(1)
def _sources(clips: Path) -> tuple[Pool, dict[str, dict]]:
    return Pool(clips), style_library(asset_path("prompts/styles.json"))


def _one_layer(clips: Path, out: Path, seed: int, number: int) -> tuple[str, dict[str, object]]:
    """Write a layered clip into `out`; returns its name and entry."""
    random, (pool, styles) = np.random.default_rng([seed, number]), _sources(clips)
    while True:
        built = build_layer(pool, styles, f"layer_{number:05d}", random)
        if built is not None and np.isfinite(built[0].local).all():
            built[0].save(out)
            return built[0].name, built[1]


def report(entries: dict[str, dict], captured: int, rhythm: str = "") -> str:
    """Return a Markdown report: number of captured styles, and how often each edit occurs."""
    edits = Counter(e for entry in entries.values() for e in entry["edits"])
    combinations = {tuple(e["keys"]) for e in entries.values()}
    catalogue = part_edits()
    rows = ([k, str(v), next(iter(catalogue[k].phrases.values()))[0]] for k, v in sorted(edits.items()))
    lines = [
        "# Augmentation",
        "",
        f"- {captured} captured styles",
        f"- {len(edits)} parametric part edits of {len(catalogue)} ({len(catalogue) - len(edits)} held out)",
        f"- {len(combinations)} different combinations of part contents in {len(entries)} clips",
        "",
        *table(("Parametric edit", "clips", "in its words"), rows),
        rhythm,
        "",
    ]
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Make clips with parametric edits of body parts.")
    parser.add_argument("--clips", type=Path, required=True, help="folder of imported clips (*.npz)")
    parser.add_argument("--out", type=Path, help="folder to write (default: the same)")
    parser.add_argument("--count", type=int, default=LAYERED_CLIPS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--report", type=Path, help="Markdown report to write; existing layers are not made again"
    )
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    out = args.out or args.clips
    if args.report is not None and (out / LAYERS).exists():
        entries = json.loads((out / LAYERS).read_text("utf-8"))
    else:
        entries = build_layers(args.clips, out, args.count, args.seed)
    if args.report is not None:
        args.report.write_text(
            report(entries, len(Pool(args.clips).by_style), rhythm_section(args.clips)), encoding="utf-8"
        )


if __name__ == "__main__":
    raise SystemExit(run_command("augmentation", main))
