"""Writing a take: the motion as BVH, GLB or FBX, and the ground beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from runtime.errors import UsageError
from runtime.takes.clip import Clip
from runtime.takes.endings import ending_of
from runtime.takes.ground import GROUND_SUFFIXES, save_ground
from runtime.takes.options import ExportOptions
from runtime.takes.prepare import PreparedTake, prepare
from runtime.terrain.height_map import Terrain


@dataclass(frozen=True)
class Written:
    """A file that was written, and a sentence about it."""

    path: Path
    text: str


def check_export(path: Path, options: ExportOptions, ground: Path | None = None) -> None:
    """What can be known to be wrong before a take is made: options, endings, a missing Blender. UsageError."""
    options.check()
    ending_of(path)
    if path.suffix.lower() == ".fbx":
        from runtime.takes.fbx import check_fbx

        check_fbx(path)
    if path.suffix.lower() not in (".glb", ".fbx") and options.with_ground:
        raise UsageError(
            f"{path}: only GLB and FBX hold a ground.", "Write the ground beside it with --ground-out."
        )
    if ground is not None and ground.suffix.lower() not in GROUND_SUFFIXES:
        raise UsageError(
            f" {ground}: expected {' or '.join(GROUND_SUFFIXES)}.", "Choose one of them.", "ground"
        )
    if ground is not None and options.in_place:
        raise UsageError(
            " with a ground beside it: the take does not go over it.", "Leave one of the two out.", "in_place"
        )


def save_motion(
    clip: Clip, path: Path, options: ExportOptions, terrain: Terrain | None = None, ground: Path | None = None
) -> list[Written]:
    """Write a take as its ending says (.bvh, .glb, .fbx, or .obj for its ground alone), and its `ground` beside it.

    `terrain` is what it was made on; without one, the ground is the level of its lowest sole. UsageError or FileError.
    """
    check_export(path, options, ground)
    take = prepare(clip, options, terrain)
    suffix = path.suffix.lower()
    if suffix == ".bvh":
        from runtime.takes.bvh_take import save_take_bvh

        save_take_bvh(take, path, options)
    elif suffix == ".glb":
        from runtime.takes.glb import save_glb

        save_glb(take, path, options, terrain)
    elif suffix == ".fbx":
        from runtime.takes.fbx import save_fbx

        save_fbx(take, path, options, terrain)
    elif suffix == ".obj":
        return [_ground(path, take, terrain, options.unit)]
    else:
        raise UsageError(f"{path}: no motion is written with this ending.", "Choose .bvh, .glb or .fbx.")
    written = [Written(path, describe(take, path))]
    if ground is not None:
        written.append(_ground(ground, take, terrain, options.unit if suffix == ".bvh" else "m"))
    return written


def save_ground_of(clip: Clip, path: Path, options: ExportOptions, terrain: Terrain) -> Written:
    """Write the ground of a take alone, in metres."""
    return _ground(path, prepare(clip, options, terrain), terrain, "m")


def describe(take: PreparedTake, path: Path) -> str:
    """What stands in the file: frames, rate, seconds, and what the loop came to."""
    count, fps = len(take.clip), take.clip.fps
    text = f"{path}: {count} frames at {fps:g} fps, {count / fps:.1f} s"
    return text if take.loop is None else f"{text}; {take.loop.describe()}"


def _ground(path: Path, take: PreparedTake, terrain: Terrain | None, unit: str) -> Written:
    if terrain is None:
        raise UsageError(f"{path}: the take has no ground.", "Choose one with --terrain.")
    save_ground(path, terrain, take, unit)
    return Written(path, f"{path}: ground {terrain.name} in {unit}")
