"""Import motion archives: `python -m training.data.importer --data DIR --out DIR [--workers 2]`."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from runtime import rotations
from runtime.errors import FileError, SportError, run_command
from training.data import cutting
from training.data.catalog import BY_NAME, list_clips, source_folder
from training.data.clip_import import ImportJob, import_clip, load
from training.data.record import ClipSource, Refusal
from training.data.report import ClipSummary, Report
from training.data.retarget import FootCalibration, calibrate_feet
from training.data.source_comparison import section

CALIBRATION_CLIPS = 40  # of each source, evenly spread
MAX_ARCHIVE_BYTES = 4 << 30  # unpacked


def import_all(data: Path, out: Path, workers: int = 2, free_only: bool = False) -> Report:
    """Retarget everything below `data` to `out/clips` and write `out/report.json`. FileError when nothing is there.

    `free_only` leaves out archives with a non-commercial licence.
    """
    clips, refused = list_clips(unpack(data, out / "unpacked"), free_only)
    folder = out / "clips"
    folder.mkdir(parents=True, exist_ok=True)
    held = cutting.held_out_names([(c.name, c.style, c.content) for c in clips])
    calibrations = {key: _calibrate(group) for key, group in _groups(clips).items()}
    jobs = [ImportJob(c, calibrations[c.capture], c.name in held, folder) for c in clips]
    report = Report(refused=list(refused))
    for summaries, refusals in _run(jobs, workers):
        report.clips += summaries
        report.refused += refusals
    report.calibrations = {key: _calibration_row(c) for key, c in calibrations.items()}
    report.save(out / "report.json")
    return report


def unpack(data: Path, folder: Path) -> Path:
    """`data` itself when its archives lie there unpacked, else `folder` with every `NAME.tar.xz` unpacked into it."""
    import tarfile

    archives = [a for a in (data / f"{s}.tar.xz" for s in BY_NAME) if a.is_file()]
    if not archives or all(source_folder(data, a.name.removesuffix(".tar.xz")) for a in archives):
        return data
    for archive in archives:
        target = folder / archive.name.removesuffix(".tar.xz")
        if target.is_dir():
            continue
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
    return folder


def _run(jobs: list[ImportJob], workers: int) -> Iterable[tuple[list[ClipSummary], list[Refusal]]]:
    if workers <= 1:
        yield from map(import_clip, jobs)
        return
    with ProcessPoolExecutor(workers) as pool:
        yield from pool.map(import_clip, jobs, chunksize=8)


def _groups(clips: list[ClipSource]) -> dict[str, list[ClipSource]]:
    groups: dict[str, list[ClipSource]] = {}
    for clip in clips:
        groups.setdefault(clip.capture, []).append(clip)
    return groups


def _calibrate(group: list[ClipSource]) -> FootCalibration:
    level = [c for c in group if c.terrain == "flat" or "_flat_" in c.name] or group
    chosen = level[:: max(1, len(level) // CALIBRATION_CLIPS)]
    sources = []
    for clip in chosen:
        try:
            sources.append(load(clip)[1])
        except SportError:
            continue  # import_clip meets the same error and reports it
    return calibrate_feet(sources)


def _calibration_row(c: FootCalibration) -> dict[str, Any]:
    return {
        "foot_turn_euler_yxz_degrees": np.rad2deg(rotations.to_euler(c.foot_turn, "YXZ")).round(2).tolist(),
        "toe_turn_euler_yxz_degrees": np.rad2deg(rotations.to_euler(c.toe_turn, "YXZ")).round(2).tolist(),
        "toe_offset_m": c.toe_offset.round(4).tolist(),
        "ankle_height_m": round(c.ankle_height, 4),
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the archives or their contents")
    parser.add_argument("--out", type=Path, required=True, help="where clips/ and report.json go")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--report", type=Path, help="also write the report as Markdown to this file")
    options = parser.parse_args()
    report = import_all(options.data, options.out, options.workers)
    if options.report:
        compared = section(unpack(options.data, options.out / "unpacked"), options.out / "clips")
        options.report.write_text(report.markdown() + "\n" + compared, encoding="utf-8")
    print(report.text())


if __name__ == "__main__":
    raise SystemExit(run_command("import", main))
