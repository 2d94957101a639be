"""One source file to training clips: retarget, label, cut, clean the feet, put ground under them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.errors import FileError, SportError
from runtime.safe_read import open_npz
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON
from training.data import cutting, height_patches, labels, relief
from training.data.catalog import BY_NAME, skeleton_of
from training.data.clip_files import TrainingClip
from training.data.foot_cleaning import clean_feet
from training.data.height_patches import Patches
from training.data.record import ClipSource, Refusal
from training.data.report import ClipSummary, summarise
from training.data.retarget import FPS, FootCalibration, SourceMotion, load_source, retarget
from training.data.source_skeletons import SourceSkeleton

_PFNN_GAITS = (Gait.STAND, Gait.WALK, Gait.JOG, Gait.JOG, Gait.CROUCH, Gait.JUMP, Gait.CROUCH, Gait.OTHER)


@dataclass(frozen=True)
class ImportJob:
    """One file and what must be known to import it."""

    clip: ClipSource
    feet: FootCalibration
    held_out: bool
    out: Path  # folder of the clips


@dataclass(frozen=True)
class _Motion:
    """A retargeted take with its labels."""

    hips: Array
    local: Array
    contacts: NDArray[np.uint8]
    gait: Array
    positions: Array

    def cut(self, start: int, end: int) -> _Motion:
        part = slice(start, end)
        return _Motion(
            self.hips[part], self.local[part], self.contacts[part], self.gait[part], self.positions[part]
        )

    def moved(self, hips: Array, local: Array) -> _Motion:
        positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
        return replace(self, hips=hips, local=local, positions=positions)


def load(clip: ClipSource) -> tuple[SourceSkeleton, SourceMotion]:
    """Read a file and bring it to 60 Hz; FileError when it cannot be read or its skeleton is unknown."""
    record = BY_NAME[clip.source]
    motion = record.read(clip.path)
    skeleton = skeleton_of(clip, motion)
    reference = record.read(clip.path.with_name(skeleton.reference)) if skeleton.reference else None
    return skeleton, load_source(motion, skeleton, record.first_frame, reference)


def import_clip(job: ImportJob) -> tuple[list[ClipSummary], list[Refusal]]:
    """Import one file, write its clips and their mirror images, and say what became of it."""
    try:
        return _import_clip(job)
    except SportError as error:
        return [], [Refusal(job.clip.name, job.clip.source, str(error))]


def _import_clip(job: ImportJob) -> tuple[list[ClipSummary], list[Refusal]]:
    clip = job.clip
    skeleton, source = load(clip)
    offset = ANKLE_HEIGHT - job.feet.ankle_height if clip.terrain == "rollout" else None
    retargeted = retarget(source, job.feet, offset, flex_toes=not skeleton.has_toe_rotation)
    positions, _ = SPORT_SKELETON.forward_kinematics(retargeted.hips, retargeted.local)
    rollout = _read_rollout(clip) if clip.terrain == "rollout" else None
    contacts, gait = _label(clip, positions, rollout)
    motion = _Motion(retargeted.hips, retargeted.local, contacts, gait, positions)

    start, end = cutting.lead_in(positions, clip.content, has_tpose=BY_NAME[clip.source].has_tpose)
    bad = cutting.spikes(motion.hips, motion.local, positions, clip.tier)
    parts = _split(job, cutting.segments(start, end, bad))
    summaries: list[ClipSummary] = []
    for number, (a, b, split) in enumerate(parts):
        name = clip.name if len(parts) == 1 else f"{clip.name}_{number}"
        for item in _versions(job, name, split, motion.cut(a, b), rollout):
            item.save(job.out)
            summaries.append(summarise(item))
    return summaries, _losses(clip, len(positions), parts, bad)


def _versions(
    job: ImportJob, name: str, split: str, motion: _Motion, rollout: _Rollout | None
) -> list[TrainingClip]:
    """The clip, its copy on hills or stairs where it was captured on a floor and moves, and the mirror images."""
    clip = job.clip
    generator = np.random.default_rng(int(cutting.hash_fraction(name) * 2**48))
    on_terrain: tuple[_Motion, Patches, str] | None = None
    if rollout is not None:
        patches = height_patches.crop_rollout(rollout.heights, rollout.cell, motion.positions)
        motion = _clean(motion, patches)
    elif clip.terrain == "contacts":
        patches = relief.ground_from_contacts(motion.positions, motion.contacts)
        motion = _clean(motion, patches)
    else:
        motion = motion.moved(*clean_feet(motion.hips, motion.local, motion.contacts, _level))
        patches = relief.fit_around_steps(motion.positions, motion.contacts, generator)
        if _travels(motion) and BY_NAME[clip.source].slide == 1.0:
            on_terrain = _on_terrain(motion, generator)
    result = [_training_clip(clip, name, split, motion, patches)]
    if on_terrain is not None:
        lifted, ground, kind = on_terrain
        item = _training_clip(clip, name + "_t", split, lifted, ground)
        result.append(replace(item, content=f"{clip.content} on {kind}"))
    return [version for item in result for version in (item, item.mirror())]


def _training_clip(
    clip: ClipSource, name: str, split: str, motion: _Motion, patches: Patches
) -> TrainingClip:
    return TrainingClip(
        name, motion.hips, motion.local, motion.contacts, motion.gait, clip.style, clip.content, clip.source, split,
        clip.tier, patches,
    )  # fmt: skip


def _level(x: Array, z: Array) -> Array:
    return np.zeros_like(x)


def _clean(motion: _Motion, patches: Patches) -> _Motion:
    return motion.moved(*clean_feet(motion.hips, motion.local, motion.contacts, patches.terrain().height))


def _travels(motion: _Motion) -> bool:
    """Whether the clip goes anywhere: relief under a standing figure teaches nothing new."""
    ground_path = motion.positions[:, 0, [0, 2]]
    return bool(np.linalg.norm(ground_path.max(0) - ground_path.min(0)) > 1.0)


def _on_terrain(motion: _Motion, generator: np.random.Generator) -> tuple[_Motion, Patches, str] | None:
    patches, kind = relief.hills_or_stairs(motion.positions, motion.contacts, generator)
    hips = motion.hips.copy()
    hips[:, 1] += relief.root_lift(motion.positions, motion.contacts, patches)
    lifted = _clean(replace(motion, hips=hips), patches)
    if cutting.spikes(lifted.hips, lifted.local, lifted.positions, "exact").any():
        return None  # a leg too short for this ground snaps
    return lifted, patches, kind


def _split(job: ImportJob, parts: list[tuple[int, int]]) -> list[tuple[int, int, str]]:
    """Give each part its split; a long take that is unique in its style and content gives its tail to evaluation."""
    if not BY_NAME[job.clip.source].long_takes:
        return [(a, b, "held_out" if job.held_out else "train") for a, b in parts]
    result = []
    for a, b in parts:
        if b - a >= cutting.TAIL_SECONDS * FPS:
            result += cutting.tail_split(a, b)
        else:
            result.append((a, b, "train"))
    return result


def _losses(
    clip: ClipSource, frames: int, parts: list[tuple[int, int, str]], bad: NDArray[np.bool_]
) -> list[Refusal]:
    kept = sum(b - a for a, b, _ in parts)
    if not parts:
        return [
            Refusal(
                clip.name, clip.source, f"nothing of {cutting.MIN_SECONDS} s left of {frames / FPS:.1f} s"
            )
        ]
    lost = []
    if bad.any():
        lost.append(Refusal(clip.name, clip.source, f"spikes cut: {int(bad.sum())} frames"))
    if frames - kept - int(bad.sum()) > FPS:
        lost.append(Refusal(clip.name, clip.source, f"lead-in and gaps cut: {(frames - kept) / FPS:.1f} s"))
    return lost


@dataclass(frozen=True)
class _Rollout:
    """What accompanies a rollout: its height map in metres and the network's labels."""

    heights: Array
    cell: float
    gait: Array
    contact: Array


def _read_rollout(clip: ClipSource) -> _Rollout:
    path = clip.path.with_suffix(".npz")
    with open_npz(path, "Unpack the archive again.") as data:
        terrain = f"terrain_{str(data['terrain']).removeprefix('terrain_')}.npz"
        gait, contact = data["gait"].astype(np.float64), data["contact"].astype(np.float64)
    heights, cell = height_patches.load_rollout_terrain(path.parent / terrain)
    return _Rollout(heights, cell, gait, contact)


def _label(clip: ClipSource, positions: Array, rollout: _Rollout | None) -> tuple[NDArray[np.uint8], Array]:
    """Contacts `(T, 4)` and gait `(T, 6)` of a whole take."""
    if rollout is not None:
        return _label_rollout(rollout, positions)
    if clip.terrain == "contacts":
        contacts = labels.contacts_without_ground(positions)
        ground = labels.smooth(positions[:, labels.FOOT_JOINTS, 1].min(1), 1.0)
    else:
        contacts = labels.foot_contacts(positions, np.zeros((len(positions), 4)), BY_NAME[clip.source].slide)
        ground = np.zeros(len(positions))
    if clip.source == "pfnn":
        return contacts, _pfnn_gait(clip.path.with_suffix(".gait"), len(positions))
    return contacts, labels.label_gait(positions[:, 0], contacts, ground, clip.content)


def _label_rollout(rollout: _Rollout, positions: Array) -> tuple[NDArray[np.uint8], Array]:
    feet = positions[:, labels.FOOT_JOINTS]
    ground = height_patches.wrapped_height(rollout.heights, rollout.cell, feet[..., 0], feet[..., 2])
    contacts = labels.foot_contacts(positions, ground)
    contacts |= ((rollout.contact[: len(contacts)] > 0.5) & (feet[..., 1] - ground < 0.15)).astype(np.uint8)
    gait = labels.smooth(np.clip(rollout.gait[: len(positions)], 0.0, None), 0.1)
    return contacts, gait / gait.sum(1, keepdims=True)


def _pfnn_gait(path: Path, frames: int) -> Array:
    """Gait of a PFNN take: eight columns at 120 Hz, merged as its authors do (jog and run, crouch and crawl)."""
    try:
        table = np.loadtxt(path)[::2]
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: {error}.", "Unpack the archive again.") from error
    table = np.pad(table, ((0, max(0, frames - len(table))), (0, 0)), mode="edge")[:frames]
    merged = np.zeros((frames, len(Gait)))
    for column, gait in enumerate(_PFNN_GAITS):
        merged[:, gait] += table[:, column]
    return labels.smooth(merged / merged.sum(1, keepdims=True), 0.2)
