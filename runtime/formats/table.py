"""The one table of formats: what a file's ending says is written, with which options, and by what.

Command, window, batch and `convert` go by it. Films are in it too, but they are drawn by `viewer.filming`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.errors import UsageError

if TYPE_CHECKING:
    from runtime.formats.prepare import ExportOptions, PreparedTake
    from runtime.takes.clip import Clip
    from runtime.terrain.height_map import Terrain

Writer = Callable[["PreparedTake", Path, "ExportOptions", "Terrain | None"], str]


def _write_bvh(take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None) -> str:
    from runtime.formats.bvh_clip import save_take_bvh

    save_take_bvh(take, path, options)
    return describe(take, path)


def _write_glb(take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None) -> str:
    from runtime.formats.glb import save_glb

    save_glb(take, path, options, terrain)
    return describe(take, path)


def _write_fbx(take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None) -> str:
    from runtime.formats.fbx import save_fbx

    save_fbx(take, path, options, terrain)
    return describe(take, path)


def _check_fbx(path: Path) -> None:
    from runtime.formats.fbx import check_fbx

    check_fbx(path)


def _write_usd(take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None) -> str:
    from runtime.formats.usd import save_usd

    save_usd(take, path, options, terrain)
    return describe(take, path)


def _check_usd(path: Path) -> None:
    from runtime.formats.usd import check_usd

    check_usd(path)


def _write_npz(take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None) -> str:
    from runtime.formats.arrays import save_npz

    save_npz(take, path)
    return describe(take, path)


def _write_csv(take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None) -> str:
    from runtime.formats.arrays import save_csv

    save_csv(take, path)
    return describe(take, path)


def _write_parquet(take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None) -> str:
    from runtime.formats.arrays import save_parquet

    save_parquet(take, path)
    return describe(take, path)


def _check_parquet(path: Path) -> None:
    from runtime.formats.arrays import check_parquet

    check_parquet(path)


def _write_page(take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None) -> str:
    from runtime.formats.page import save_page

    save_page(take, path, options, terrain)
    return describe(take, path)


def _write_ground(take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None) -> str:
    from runtime.formats.ground import save_ground

    if terrain is None:
        raise UsageError(f"{path}: the take has no ground.", "Choose one with --terrain.")
    save_ground(path, terrain, take, options.unit)
    return f"{path}: ground {terrain.name} in {options.unit}"


MOTION = frozenset({"fps", "loop", "strides", "in_place", "ground_root", "at_origin", "rest_frame"})
CHARACTER = frozenset({"character", "joint_map", "fit_to_motion"})
# without effect on a format that lacks them: a command may write several files, and only some have them
INDIFFERENT = frozenset({"fps", "unit", "euler_order", "start_s", "end_s", *CHARACTER})


@dataclass(frozen=True)
class Format:
    """A format of a take: its ending, its name in the window, what the file is, and what it can do.

    `options` are the fields of `ExportOptions` that change the file. `keeps_motion`: the take can be read or played
    from it, so that it counts as saved. `check` says before the work what is missing. `write` is None for a film.
    `write` returns a sentence about the file. `ignores` are options that change nothing here and are no mistake.
    """

    suffix: str
    name: str
    text: str
    options: frozenset[str]
    write: Writer | None = None
    check: Callable[[Path], None] = lambda path: None
    keeps_motion: bool = False
    ignores: frozenset[str] = frozenset()

    @property
    def film(self) -> bool:
        """Whether it is drawn, by `viewer.filming`."""
        return self.write is None


_ARRAYS = frozenset({"fps", "loop", "strides", "in_place", "at_origin"})
_FILM = frozenset({"loop", "strides"}) | CHARACTER
_SKINNED = MOTION | CHARACTER | {"with_ground", "engine", "humanoid_names", "animation_only", "with_takes"}
_USD = MOTION | CHARACTER | {"with_ground", "animation_only"}
_TABLE = (
    Format(".bvh", "BVH: motion", "motion of the 31-joint skeleton", MOTION | {"unit", "euler_order"}, _write_bvh, keeps_motion=True),
    Format(".glb", "GLB: character with motion", "character with motion (glTF binary)", _SKINNED, _write_glb, keeps_motion=True),
    Format(".fbx", "FBX: through Blender", "character with motion, through Blender", _SKINNED, _write_fbx, _check_fbx, keeps_motion=True),
    Format(".usdz", "USDZ: character with motion", "character with motion and textures (UsdSkel, packed)", _USD, _write_usd, _check_usd),
    Format(".usd", "USD: character with motion", "the same without textures, one binary layer", _USD, _write_usd, _check_usd),
    Format(".html", "HTML: page to look at", "page with character and ground, plays in any browser", MOTION | CHARACTER | {"with_takes"}, _write_page),
    Format(".npz", "NPZ: arrays", "positions, rotations, root, contacts, phase as NumPy arrays", _ARRAYS, _write_npz, ignores=MOTION),
    Format(".csv", "CSV: table", "the same, a row a frame", _ARRAYS, _write_csv, ignores=MOTION),
    Format(".parquet", "Parquet: table", "the same, through pandas", _ARRAYS, _write_parquet, _check_parquet, ignores=MOTION),
    Format(".mp4", "MP4: film", "film (H.264)", _FILM),
    Format(".png", "PNG: numbered frames", "film as numbered frames, name_00000.png and on", _FILM),
    Format(".webp", "WebP: animation", "animated WebP", _FILM),
    Format(".gif", "GIF: animation", "animated GIF", _FILM),
    Format(".obj", "OBJ: the ground alone", "ground under the take", frozenset({"unit", "at_origin"}), _write_ground, ignores=MOTION - {"in_place"}),
)  # fmt: skip
FORMATS = {format.suffix: format for format in _TABLE}


@dataclass(frozen=True)
class Written:
    """A file that was written, and a sentence about it."""

    path: Path
    text: str


def format_of(path: Path) -> Format:
    """The format that a file's name says; UsageError lists those that are written."""
    found = FORMATS.get(path.suffix.lower())
    if found is not None:
        return found
    if path.is_dir():
        raise UsageError(f"{path}: this is a folder.", "Add the name of a file.")
    known = ", ".join(f"{f.suffix} ({f.text})" for f in _TABLE)
    what = f"nothing writes files that end in {path.suffix}" if path.suffix else "a name without an ending"
    raise UsageError(f"{path}: {what}.", f"Choose {known}.")


def check_export(path: Path, options: ExportOptions, ground: Path | None = None) -> None:
    """What can be known to be wrong before a take is made: options, endings, a missing Blender. UsageError."""
    from runtime.formats.ground import GROUND_SUFFIXES

    options.check()
    format = format_of(path)
    for option in fields(options):
        if (
            option.name not in format.options | format.ignores | INDIFFERENT
            and getattr(options, option.name) != option.default
        ):
            able = ", ".join(f.suffix for f in _TABLE if option.name in f.options)
            beside = " Write the ground beside it with --ground-out." if option.name == "with_ground" else ""
            raise UsageError(
                f": nothing that a {format.suffix} file has; {able} have it.",
                f"Leave it out.{beside}",
                option.name,
            )
    format.check(path)
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
    """Write a take as its ending says (no film: `viewer.filming`), and its `ground` beside it.

    `terrain` is what it was made on; without one, the ground is the level of its lowest sole. UsageError or FileError.
    """
    from runtime.formats.prepare import prepare

    check_export(path, options, ground)
    format = format_of(path)
    if format.write is None:
        raise UsageError(f"{path}: a film is drawn, not written.", "Choose .bvh, .glb or .fbx.")
    take = prepare(clip, options, terrain)
    written = [Written(path, format.write(take, path, options, terrain))]
    if ground is not None:
        unit = options.unit if format.suffix == ".bvh" else "m"
        written.append(save_ground_beside(take, ground, terrain, unit))
    return written


def save_ground_beside(take: PreparedTake, path: Path, terrain: Terrain | None, unit: str = "m") -> Written:
    """Write the ground of a prepared take in a unit; UsageError where it has none."""
    from runtime.formats.prepare import ExportOptions

    return Written(path, _write_ground(take, path, ExportOptions(unit=unit), terrain))


def describe(take: PreparedTake, path: Path) -> str:
    """What stands in the file: frames, rate, seconds, and what the loop came to."""
    count, fps = len(take.clip), take.clip.fps
    text = f"{path}: {count} frames at {fps:g} fps, {count / fps:.1f} s"
    return text if take.loop is None else f"{text}; {take.loop.describe()}"
