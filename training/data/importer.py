"""Import motion archives: `python -m training.data.importer --data DIR --out DIR [--workers 2]`."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.bvh import BvhMotion, read_bvh
from runtime.controls import Gait
from runtime.errors import FileError, SportError
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON
from training.data import cutting, height_patches, labels
from training.data.catalog import ClipSource, Refusal, list_clips
from training.data.clip_files import TrainingClip
from training.data.report import ClipSummary, Report, summarise
from training.data.retarget import FPS, FootCalibration, Retargeted, SourceMotion, calibrate_feet, load_source, retarget
from training.data.source_skeletons import SourceSkeleton, recognise

Array = NDArray[np.floating]

CALIBRATION_CLIPS = 16  # of each source, evenly spread
CMU_FIRST_FRAME = 3  # frame 0 is a T-pose, and the resampling to 60 Hz has smeared it over the next two


@dataclass(frozen=True)
class _Job:
    clip: ClipSource
    feet: FootCalibration
    held_out: bool
    out: Path


def import_all(data: Path, out: Path, workers: int = 2) -> Report:
    """Retarget everything below `data` to `out/clips` and write `out/report.json`. FileError when nothing is there."""
    clips, refused = list_clips(data)
    folder = out / "clips"
    folder.mkdir(parents=True, exist_ok=True)
    held = cutting.held_out_names([(c.name, c.style) for c in clips])
    calibrations = {key: _calibrate(group) for key, group in _groups(clips).items()}
    jobs = [_Job(c, calibrations[_group_key(c)], c.name in held, folder) for c in clips]
    report = Report(refused=list(refused))
    for summaries, refusals in _run(jobs, workers):
        report.clips += summaries
        report.refused += refusals
    report.calibrations = {key: _calibration_row(c) for key, c in calibrations.items()}
    report.save(out / "report.json")
    return report


def _run(jobs: list[_Job], workers: int) -> Iterable[tuple[list[ClipSummary], list[Refusal]]]:
    if workers <= 1:
        yield from map(import_clip, jobs)
        return
    with ProcessPoolExecutor(workers) as pool:
        yield from pool.map(import_clip, jobs, chunksize=8)


def _group_key(clip: ClipSource) -> str:
    """Clips whose feet are calibrated together: one skeleton, one capture."""
    if clip.source == "bandai_namco":
        return clip.name.split("_")[0]
    return "cmu_plain" if clip.name.startswith("cmu_131") else clip.source


def _groups(clips: list[ClipSource]) -> dict[str, list[ClipSource]]:
    groups: dict[str, list[ClipSource]] = {}
    for clip in clips:
        groups.setdefault(_group_key(clip), []).append(clip)
    return groups


def _calibrate(group: list[ClipSource]) -> FootCalibration:
    level = [c for c in group if c.terrain == "flat" or "_flat_" in c.name] or group
    chosen = level[:: max(1, len(level) // CALIBRATION_CLIPS)]
    return calibrate_feet([_load(clip)[2] for clip in chosen])


def _calibration_row(c: FootCalibration) -> dict[str, list[float] | float]:
    return {
        "foot_pitch_degrees": np.rad2deg(c.foot_pitch).round(2).tolist(),
        "toe_pitch_degrees": np.rad2deg(c.toe_pitch).round(2).tolist(),
        "toe_offset_m": c.toe_offset.round(4).tolist(),
        "ankle_height_m": round(c.ankle_height, 4),
    }


def _load(clip: ClipSource) -> tuple[BvhMotion, SourceSkeleton, SourceMotion]:
    motion = read_bvh(clip.path)
    skeleton = recognise(motion, clip.path.name)
    if clip.source == "pfnn_rollouts":
        skeleton = replace(skeleton, fixed_scale=0.01)  # the terrain is in centimetres
    return motion, skeleton, load_source(motion, skeleton, first_frame=CMU_FIRST_FRAME if clip.source == "cmu" else 0)


def import_clip(job: _Job) -> tuple[list[ClipSummary], list[Refusal]]:
    """Retarget one file, write its clips and their mirror images, and say what became of it."""
    try:
        return _import_clip(job)
    except SportError as error:
        return [], [Refusal(job.clip.name, job.clip.source, str(error))]


def _import_clip(job: _Job) -> tuple[list[ClipSummary], list[Refusal]]:
    clip = job.clip
    if clip.terrain == "contacts":
        return [], [Refusal(clip.name, clip.source, "uneven ground without a height map")]
    _, skeleton, source = _load(clip)
    offset = ANKLE_HEIGHT - job.feet.ankle_height if clip.terrain == "rollout" else None
    motion = retarget(source, job.feet, offset, flex_toes=not skeleton.has_toe_rotation)
    positions, _ = SPORT_SKELETON.forward_kinematics(motion.hips, motion.local)
    contacts, gait, ground = _label(clip, motion, positions)
    start, end = cutting.lead_in(positions, clip.content)
    bad = cutting.spikes(motion.hips, motion.local, clip.tier)
    parts = _split(job, cutting.segments(start, end, bad))
    summaries: list[ClipSummary] = []
    for number, (a, b, split) in enumerate(parts):
        name = clip.name if len(parts) == 1 else f"{clip.name}_{number}"
        patches = (
            height_patches.flat_patch(positions[a:b])
            if ground is None
            else height_patches.crop_rollout(*ground, positions[a:b])
        )
        item = TrainingClip(
            name, motion.hips[a:b], motion.local[a:b], contacts[a:b], gait[a:b], clip.style, clip.content, clip.source,
            split, clip.tier, patches,
        )  # fmt: skip
        for version in (item, item.mirror()):
            version.save(job.out)
            summaries.append(summarise(version))
    return summaries, _losses(clip, len(positions), parts, bad)


def _split(job: _Job, parts: list[tuple[int, int]]) -> list[tuple[int, int, str]]:
    """Give each part its split; a long take that is unique in its style and content gives its tail to evaluation."""
    unique = job.clip.source in ("100style", "jlpm") or job.clip.name.startswith("bandai1")
    if not unique:
        return [(a, b, "held_out" if job.held_out else "train") for a, b in parts]
    result = []
    for a, b in parts:
        if b - a >= cutting.TAIL_SECONDS * FPS:
            result += cutting.tail_split(a, b)
        else:
            result.append((a, b, "train"))
    return result


def _losses(clip: ClipSource, frames: int, parts: list[tuple[int, int, str]], bad: NDArray[np.bool_]) -> list[Refusal]:
    kept = sum(b - a for a, b, _ in parts)
    if not parts:
        return [Refusal(clip.name, clip.source, f"nothing of {cutting.MIN_SECONDS} s left of {frames / FPS:.1f} s")]
    lost = []
    if bad.any():
        lost.append(Refusal(clip.name, clip.source, f"spikes cut: {int(bad.sum())} frames"))
    if frames - kept - int(bad.sum()) > FPS:
        lost.append(Refusal(clip.name, clip.source, f"lead-in and gaps cut: {(frames - kept) / FPS:.1f} s"))
    return lost


def _label(
    clip: ClipSource, motion: Retargeted, positions: Array
) -> tuple[NDArray[np.uint8], Array, tuple[Array, float] | None]:
    """Contacts, gait and, for a rollout, its height map."""
    if clip.terrain == "rollout":
        return _label_rollout(clip, positions)
    level = np.zeros((len(positions), 4))
    contacts = labels.foot_contacts(positions, level)
    if clip.source == "pfnn":
        return contacts, _pfnn_gait(clip.path.with_suffix(".gait"), len(positions)), None
    return contacts, labels.label_gait(motion.hips, contacts, level[:, 0], clip.content), None


def _label_rollout(clip: ClipSource, positions: Array) -> tuple[NDArray[np.uint8], Array, tuple[Array, float]]:
    with np.load(clip.path.with_suffix(".npz"), allow_pickle=False) as data:
        terrain = f"terrain_{str(data['terrain']).removeprefix('terrain_')}.npz"
        gait, network = data["gait"].astype(np.float64), data["contact"].astype(np.float64)
    heights, cell = height_patches.load_rollout_terrain(clip.path.parent / terrain)
    feet = positions[:, labels.FOOT_JOINTS]
    ground = height_patches.wrapped_height(heights, cell, feet[..., 0], feet[..., 2])
    contacts = labels.foot_contacts(positions, ground)
    contacts |= ((network[: len(contacts)] > 0.5) & (feet[..., 1] - ground < 0.15)).astype(np.uint8)
    gait = np.clip(gait[: len(positions)], 0.0, None)
    gait = labels.smooth(gait, 0.1)
    return contacts, gait / gait.sum(1, keepdims=True), (heights, cell)


def _pfnn_gait(path: Path, frames: int) -> Array:
    """Gait of a PFNN take: eight columns at 120 Hz, merged as its authors do (jog and run, crouch and crawl)."""
    try:
        table = np.loadtxt(path)[::2]
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: {error}.", "Unpack the archive again.") from error
    table = np.pad(table, ((0, max(0, frames - len(table))), (0, 0)), mode="edge")[:frames]
    merged = np.zeros((frames, len(Gait)))
    for column, gait in enumerate(
        (Gait.STAND, Gait.WALK, Gait.JOG, Gait.JOG, Gait.CROUCH, Gait.JUMP, Gait.CROUCH, Gait.OTHER)
    ):
        merged[:, gait] += table[:, column]
    return labels.smooth(merged / merged.sum(1, keepdims=True), 0.2)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the archives or their contents")
    parser.add_argument("--out", type=Path, required=True, help="where clips/ and report.json go")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    print(import_all(options.data, options.out, options.workers).text())


if __name__ == "__main__":
    main()
