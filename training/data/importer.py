"""Import motion archives: `python -m training.data.importer --data DIR --out DIR`.

Every file is read, retargeted, labelled and cut, its feet are cleaned, and ground is fitted under it. The differences
between archives are in `training.data.sources`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.controls import Gait
from runtime.errors import FileError, SportError, run_command
from runtime.safe_read import open_npz
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON
from training.data import cutting, labels, relief
from training.data.clips import Patches, TrainingClip, crop_rollout, load_rollout_terrain, wrapped_height
from training.data.foot_cleaning import GroundHeight, clean_feet
from training.data.report import ClipSummary, Report, comparison, summarise
from training.data.retarget import FPS, FootCalibration, SourceMotion, calibrate_feet, load_source, retarget
from training.data.shown import ClipSource, Refusal
from training.data.source_skeletons import SourceSkeleton
from training.data.sources import BY_NAME, list_clips, skeleton_of, source_folder

CALIBRATION_CLIPS = 40  # of each source, evenly spread
MAX_ARCHIVE_BYTES = 4 << 30  # unpacked
_PFNN_GAITS = (Gait.STAND, Gait.WALK, Gait.JOG, Gait.JOG, Gait.CROUCH, Gait.JUMP, Gait.CROUCH, Gait.OTHER)


def import_all(data: Path, out: Path, workers: int | None = None, free_only: bool = False) -> Report:
    """Retarget everything below `data` to `out/clips` and write `out/report.json`. FileError if nothing is found.

    `free_only` omits archives with a non-commercial licence. `workers` are processes, by default one per core.
    """
    clips, refused = list_clips(unpack(data, out / "unpacked"), free_only)
    folder = out / "clips"
    folder.mkdir(parents=True, exist_ok=True)
    held = cutting.held_out_names([(c.name, c.style, c.content) for c in clips])
    groups: dict[str, list[ClipSource]] = {}
    for clip in clips:
        groups.setdefault(clip.capture, []).append(clip)
    calibrations = {key: _calibrate(group) for key, group in groups.items()}
    jobs = [ImportJob(c, calibrations[c.capture], c.name in held, folder) for c in clips]
    report = Report(refused=list(refused))
    for summaries, refusals in _run(jobs, workers):
        report.clips += summaries
        report.refused += refusals
    report.calibrations = {key: _calibration_row(c) for key, c in calibrations.items()}
    report.save(out / "report.json")
    return report


def unpack(data: Path, folder: Path) -> Path:
    """Return `data` if its archives are unpacked there, else `folder` with every `NAME.tar.xz` unpacked into it."""
    archives = [a for a in (data / f"{s}.tar.xz" for s in BY_NAME) if a.is_file()]
    if all(source_folder(data, a.name.removesuffix(".tar.xz")) for a in archives):
        return data
    for archive in archives:
        target = folder / archive.name.removesuffix(".tar.xz")
        if not target.is_dir():
            _unpack(archive, target)
    return folder


def _unpack(archive: Path, target: Path) -> None:
    """Unpack an archive into a new folder; FileError if it is damaged or too large."""
    import tarfile

    try:
        with tarfile.open(archive) as tar:
            members = tar.getmembers()
            if sum(m.size for m in members) > MAX_ARCHIVE_BYTES:
                raise FileError(
                    f"{archive}: unpacks to more than {MAX_ARCHIVE_BYTES >> 30} GB.", "Check the file."
                )
            target.mkdir(parents=True)
            tar.extractall(target, members=members, filter="data")
    except (OSError, tarfile.TarError) as error:
        raise FileError(f"{archive}: {error}.", "Fetch the archive again.") from error


def _run(jobs: list[ImportJob], workers: int | None) -> Iterable[tuple[list[ClipSummary], list[Refusal]]]:
    if workers == 1:
        yield from map(import_clip, jobs)
        return
    with ProcessPoolExecutor(workers) as pool:
        yield from pool.map(import_clip, jobs, chunksize=8)


def _calibrate(group: list[ClipSource]) -> FootCalibration:
    level = [c for c in group if c.terrain == "flat" or "_flat_" in c.name] or group
    chosen = level[:: max(1, len(level) // CALIBRATION_CLIPS)]
    sources = []
    for clip in chosen:
        try:
            sources.append(load(clip)[1])
        except SportError:
            continue  # import_clip gets the same error and reports it
    return calibrate_feet(sources)


def _calibration_row(c: FootCalibration) -> dict[str, Any]:
    return {
        "foot_turn_euler_yxz_degrees": np.rad2deg(rotations.to_euler(c.foot_turn, "YXZ")).round(2).tolist(),
        "toe_turn_euler_yxz_degrees": np.rad2deg(rotations.to_euler(c.toe_turn, "YXZ")).round(2).tolist(),
        "toe_offset_m": c.toe_offset.round(4).tolist(),
        "ankle_height_m": round(c.ankle_height, 4),
    }


@dataclass(frozen=True)
class ImportJob:
    """One file and the parameters of its import."""

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
        return _Motion(**{name: values[start:end] for name, values in vars(self).items()})

    def cleaned(self, ground: GroundHeight) -> _Motion:
        """Return the motion with cleaned feet on `ground`."""
        hips, local = clean_feet(self.hips, self.local, self.contacts, ground)
        positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
        return replace(self, hips=hips, local=local, positions=positions)


def load(clip: ClipSource) -> tuple[SourceSkeleton, SourceMotion]:
    """Read a file and bring it to 60 Hz; FileError if it cannot be read or its skeleton is unknown."""
    record = BY_NAME[clip.source]
    motion = record.read(clip.path)
    skeleton = skeleton_of(clip, motion)
    reference = record.read(clip.path.with_name(skeleton.reference)) if skeleton.reference else None
    return skeleton, load_source(motion, skeleton, record.first_frame, reference)


def import_clip(job: ImportJob) -> tuple[list[ClipSummary], list[Refusal]]:
    """Import one file, and write its clips and their mirror images; returns summaries and refusals."""
    try:
        return _import_clip(job)
    except SportError as error:
        return [], [Refusal(job.clip.name, job.clip.source, str(error))]


def _import_clip(job: ImportJob) -> tuple[list[ClipSummary], list[Refusal]]:
    clip = job.clip
    skeleton, source = load(clip)
    offset = ANKLE_HEIGHT - job.feet.ankle_height if clip.terrain == "rollout" else None
    hips, local = retarget(source, job.feet, offset, flex_toes=not skeleton.has_toe_rotation)
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    rollout = _read_rollout(clip) if clip.terrain == "rollout" else None
    contacts, gait = _label(clip, positions, rollout)
    motion = _Motion(hips, local, contacts, gait, positions)

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
    """Return the clip, a copy on hills or stairs if it moves over a floor, and mirror images of both."""
    clip = job.clip
    generator = np.random.default_rng(int(cutting.hash_fraction(name) * 2**48))
    on_terrain: tuple[_Motion, Patches, str] | None = None
    if rollout is not None:
        patches = crop_rollout(rollout.heights, rollout.cell, motion.positions)
        motion = motion.cleaned(patches.terrain().height)
    elif clip.terrain == "contacts":
        patches = relief.ground_from_contacts(motion.positions, motion.contacts)
        motion = motion.cleaned(patches.terrain().height)
    else:
        motion = motion.cleaned(lambda x, z: np.zeros_like(x))
        patches = relief.fit_around_steps(motion.positions, motion.contacts, generator)
        way = np.ptp(motion.positions[:, 0, [0, 2]], axis=0)
        # relief under a standing figure is useless for training
        if np.linalg.norm(way) > 1.0 and BY_NAME[clip.source].slide == 1.0:
            on_terrain = _on_terrain(motion, generator)

    def version(suffix: str, motion: _Motion, patches: Patches, content: str) -> TrainingClip:
        return TrainingClip(
            name + suffix, motion.hips, motion.local, motion.contacts, motion.gait, clip.style, content, clip.source,
            split, clip.tier, patches,
        )  # fmt: skip

    result = [version("", motion, patches, clip.content)]
    if on_terrain is not None:
        lifted, ground, kind = on_terrain
        result.append(version("_t", lifted, ground, f"{clip.content} on {kind}"))
    return [image for item in result for image in (item, item.mirror())]


def _on_terrain(motion: _Motion, generator: np.random.Generator) -> tuple[_Motion, Patches, str] | None:
    patches, kind = relief.hills_or_stairs(motion.positions, motion.contacts, generator)
    hips = motion.hips.copy()
    hips[:, 1] += relief.root_lift(motion.positions, motion.contacts, patches)
    lifted = replace(motion, hips=hips).cleaned(patches.terrain().height)
    if cutting.spikes(lifted.hips, lifted.local, lifted.positions, "exact").any():
        return None  # a leg is too short for this ground and snaps
    return lifted, patches, kind


def _split(job: ImportJob, parts: list[tuple[int, int]]) -> list[tuple[int, int, str]]:
    """Assign splits to parts; a long take, the only one of its style and content, has a held-out tail."""
    if not BY_NAME[job.clip.source].long_takes:
        return [(a, b, "held_out" if job.held_out else "train") for a, b in parts]
    result = []
    for a, b in parts:
        if b - a >= cutting.TAIL_S * FPS:
            result += cutting.tail_split(a, b)
        else:
            result.append((a, b, "train"))
    return result


def _losses(
    clip: ClipSource, frames: int, parts: list[tuple[int, int, str]], bad: NDArray[np.bool_]
) -> list[Refusal]:
    kept, cut = sum(b - a for a, b, _ in parts), int(bad.sum())
    reasons = []
    if not parts:
        reasons.append(f"nothing of {cutting.MIN_PART_S} s left of {frames / FPS:.1f} s")
    elif cut:
        reasons.append(f"spikes cut: {cut} frames")
    if parts and frames - kept - cut > FPS:
        reasons.append(f"lead-in and gaps cut: {(frames - kept) / FPS:.1f} s")
    return [Refusal(clip.name, clip.source, reason) for reason in reasons]


@dataclass(frozen=True)
class _Rollout:
    """Data of a rollout besides its motion: height map in metres and the network's labels."""

    heights: Array
    cell: float
    gait: Array
    contact: Array


def _read_rollout(clip: ClipSource) -> _Rollout:
    path = clip.path.with_suffix(".npz")
    with open_npz(path, "Unpack the archive again.") as data:
        terrain = f"terrain_{str(data['terrain']).removeprefix('terrain_')}.npz"
        gait, contact = data["gait"].astype(np.float64), data["contact"].astype(np.float64)
    heights, cell = load_rollout_terrain(path.parent / terrain)
    return _Rollout(heights, cell, gait, contact)


def _label(clip: ClipSource, positions: Array, rollout: _Rollout | None) -> tuple[NDArray[np.uint8], Array]:
    """Return contacts `(T, 4)` and gait `(T, 6)` of a whole take."""
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
    ground = wrapped_height(rollout.heights, rollout.cell, feet[..., 0], feet[..., 2])
    contacts = labels.foot_contacts(positions, ground)
    contacts |= ((rollout.contact[: len(contacts)] > 0.5) & (feet[..., 1] - ground < 0.15)).astype(np.uint8)
    gait = labels.smooth(np.clip(rollout.gait[: len(positions)], 0.0, None), 0.1)
    return contacts, gait / gait.sum(1, keepdims=True)


def _pfnn_gait(path: Path, frames: int) -> Array:
    """Read the gait of a PFNN take: eight columns at 120 Hz, merged as by its authors (jog and run, crouch and crawl)."""
    try:
        table = np.loadtxt(path)[::2]
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: {error}.", "Unpack the archive again.") from error
    table = np.pad(table, ((0, max(0, frames - len(table))), (0, 0)), mode="edge")[:frames]
    merged = np.zeros((frames, len(Gait)))
    for column, gait in enumerate(_PFNN_GAITS):
        merged[:, gait] += table[:, column]
    return labels.smooth(merged / merged.sum(1, keepdims=True), 0.2)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the archives or their contents")
    parser.add_argument("--out", type=Path, required=True, help="folder for clips/ and report.json")
    parser.add_argument("--workers", type=int, help="processes (default: one per core)")
    parser.add_argument("--report", type=Path, help="also write the report as Markdown to this file")
    options = parser.parse_args()
    report = import_all(options.data, options.out, options.workers)
    if options.report:
        compared = comparison(unpack(options.data, options.out / "unpacked"), options.out / "clips")
        options.report.write_text(report.markdown() + "\n" + compared, encoding="utf-8")
    print(report.text())


if __name__ == "__main__":
    raise SystemExit(run_command("import", main))
