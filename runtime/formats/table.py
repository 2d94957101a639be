"""The table of formats: file ending, name, writer; their options are in `runtime.formats.options`.

Command, window, batch and `convert` use it. Films are listed too, but drawn by `viewer.filming`.
"""

from __future__ import annotations

import importlib.util
import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.errors import SportError, UsageError
from runtime.formats.options import ExportOptions, ExportSpec
from runtime.options import spec_of

if TYPE_CHECKING:
    from runtime.formats.prepare import Check, PreparedTake
    from runtime.takes.clip import Clip
    from runtime.terrain.height_map import Terrain


class ExportCancelled(SportError):
    """Raised if the user cancels an export; nothing was written."""


@dataclass(frozen=True)
class Format:
    """A format of a take: its ending, its name in the window, and a description.

    `write` names the function of `runtime.formats` that writes a take; "" for a film. `needs` lists required modules,
    each with the package that contains it.
    """

    suffix: str
    name: str
    text: str
    write: str = ""
    needs: tuple[tuple[str, str], ...] = ()

    @property
    def options(self) -> frozenset[str]:
        """The fields of `ExportOptions` that affect this format."""
        names = (entry.name for entry in fields(ExportOptions))
        return frozenset(name for name in names if self.suffix in spec_of(ExportOptions, name).formats)

    @property
    def film(self) -> bool:
        """Return whether the format is a film, drawn by `viewer.filming`."""
        return not self.write

    def check_program(self, path: Path) -> None:
        """Raise UsageError if a library of this format is missing, with how to install it."""
        missing = [package for name, package in self.needs if importlib.util.find_spec(name) is None]
        if missing:
            problem = f"{path}: {' and '.join(missing)}, which writes it, is not installed."
            packages = " ".join(package for _, package in self.needs)
            raise UsageError(problem, f"Run pip install {packages}, or write a .glb or .csv.")


_TABLE = (
    Format(".bvh", "BVH: motion", "motion of the 31-joint skeleton", "bvh_clip.save_take_bvh"),
    Format(".glb", "GLB: character with motion", "character with motion (glTF binary)", "glb.save_glb"),
    Format(".fbx", "FBX: character with motion", "the same as FBX 7.4", "fbx.save_fbx"),
    Format(".usdz", "USDZ: character with motion", "character with motion and textures (UsdSkel, packed)", "usd.save_usd", (("pxr", "usd-core"),)),
    Format(".usd", "USD: character with motion", "the same without textures, one binary layer", "usd.save_usd", (("pxr", "usd-core"),)),
    Format(".vrma", "VRMA: motion for VRM avatars", "motion for any VRM avatar (VRM animation 1.0)", "vrma.save_vrma"),
    Format(".html", "HTML: interactive page", "page with character and ground, plays in any browser", "page.save_page"),
    Format(".npz", "NPZ: arrays", "positions, rotations, root, contacts, phase as NumPy arrays", "arrays.save_npz"),
    Format(".csv", "CSV: table", "the same, one row per frame", "arrays.save_csv"),
    Format(".parquet", "Parquet: table", "the same, through pandas", "arrays.save_parquet", (("pandas", "pandas"), ("pyarrow", "pyarrow"))),
    Format(".mp4", "MP4: film", "film (H.264)"),
    Format(".png", "PNG: numbered frames", "film as numbered frames, name_00000.png and on"),
    Format(".webp", "WebP: animation", "animated WebP"),
    Format(".gif", "GIF: animation", "animated GIF"),
    Format(".obj", "OBJ: the ground alone", "ground under the take", "ground.save_ground"),
)  # fmt: skip
FORMATS = {format.suffix: format for format in _TABLE}


def format_of(path: Path) -> Format:
    """Return the format for a file's ending; UsageError lists the known ones."""
    found = FORMATS.get(path.suffix.lower())
    if found is not None:
        return found
    if os.path.isdir(path):  # False for an invalid name, which writing refuses
        raise UsageError(f"{path}: this is a folder.", "Add the name of a file.")
    known = ", ".join(f"{f.suffix} ({f.text})" for f in _TABLE)
    what = f"nothing writes files that end in {path.suffix}" if path.suffix else "a name without an ending"
    raise UsageError(f"{path}: {what}.", f"Choose {known}.")


def check_export(path: Path, options: ExportOptions) -> None:
    """Check options, ending and libraries before a take is generated. Raises UsageError."""
    options.check()
    format = format_of(path)
    for entry in fields(ExportOptions):
        spec = spec_of(ExportOptions, entry.name)
        refuses = isinstance(spec, ExportSpec) and format.suffix not in spec.formats | spec.ignored_by
        if refuses and getattr(options, entry.name) != entry.default:
            able = ", ".join(suffix for suffix in FORMATS if suffix in spec.formats)
            beside = " Write the ground beside it with --ground-out." if entry.name == "with_ground" else ""
            problem = f": nothing that a {format.suffix} file has; {able} have it."
            raise UsageError(problem, f"Leave it out.{beside}", entry.name)
    format.check_program(path)


def save_motion(
    clip: Clip,
    path: Path,
    options: ExportOptions,
    terrain: Terrain | None = None,
    check: Check = lambda: None,
) -> list[str]:
    """Write a take in the format of the file's ending, and its ground if requested; return a sentence about each file.

    `terrain` is the ground of the clip; None is level ground under its lowest sole. `check` is called often and may
    cancel with an exception, which leaves no file. Films are made by `viewer.filming`. Raises UsageError, FileError.
    """
    from runtime.formats.prepare import prepare

    check_export(path, options)
    format = format_of(path)
    if format.film:
        raise UsageError(f"{path}: films are rendered by the viewer.", "Choose .bvh, .glb or .fbx.")
    take = prepare(clip, options, terrain)
    check()
    module, _, function = format.write.partition(".")
    write = getattr(importlib.import_module(f"runtime.formats.{module}"), function)
    said = write(take, path, options, terrain, check) or describe(take, path)
    unit = options.unit if format.suffix == ".bvh" else "m"
    return [said, *save_ground_beside(take, options, terrain, unit)]


def save_ground_beside(
    take: PreparedTake, options: ExportOptions, terrain: Terrain | None, unit: str = "m"
) -> list[str]:
    """Write the ground of a prepared take if the options ask for it; UsageError if it has no ground."""
    from runtime.formats.ground import save_ground

    if options.ground_out is None:
        return []
    return [save_ground(take, options.ground_out, ExportOptions(unit=unit), terrain)]


def describe(take: PreparedTake, path: Path) -> str:
    """Return a sentence about the written file: frames, rate, seconds, loop."""
    count, fps = len(take.clip), take.clip.fps
    text = f"{path}: {count} frames at {fps:g} fps, {count / fps:.1f} s"
    return text if take.clip.loop is None else f"{text}; {take.clip.loop.describe()}"
