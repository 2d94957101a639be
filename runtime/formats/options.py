"""Export options, each declared once: command-line argument, widget in the window, formats.

Nothing heavy is imported: `sport --help` reads this file.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runtime.assets import character_file
from runtime.errors import UsageError
from runtime.formats.engines import ENGINES, engine_of
from runtime.options import Spec
from runtime.pose import MAX_FPS, VIDEO_RATES

SKINNED = frozenset({".glb", ".fbx"})
SCENES = SKINNED | {".usdz", ".usd"}
BODIES = SCENES | {".html"}
MOTION = BODIES | {".bvh", ".vrma"}
ARRAYS = frozenset({".npz", ".csv", ".parquet"})
FILMS = frozenset({".mp4", ".png", ".webp", ".gif"})
GROUND = frozenset({".obj"})
ALL = MOTION | ARRAYS | FILMS | GROUND

GROUND_SUFFIXES = (".obj", ".glb")
UNITS_PER_METRE = {"cm": 100.0, "m": 1.0}
ROTATION_ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
MAX_STRIDES = 16  # of a loop
RATES = {rate: f"{rate:.4g} fps" for rate in VIDEO_RATES}
CAMERAS = {
    "view": "As in the window, going along",
    "keyed": "Keyed on the timeline",
    **{name: name.capitalize() for name in ("front", "follow", "side", "orbit", "still")},
}


@dataclass(frozen=True)
class ExportSpec(Spec):
    """A `Spec` with a command-line argument: `help`, `metavar`, its `parse` function, and `dest`, its name if not that of the flag.

    A value other than the default is refused for formats in neither `formats` nor `ignored_by`.
    """

    help: str = ""
    metavar: str = ""
    parse: Callable[[str], Any] = str
    dest: str = ""
    ignored_by: frozenset[str] = ALL

    @property
    def argument(self) -> str:
        """The name of the parsed argument, and of the column in a batch file."""
        return self.dest or self.flag.removeprefix("--").replace("-", "_")


def option(default: Any, formats: frozenset[str] = frozenset(), flag: str = "", **spec: Any) -> Any:
    """Return a dataclass field with its `ExportSpec`."""
    return field(default=default, metadata={"spec": ExportSpec(formats=formats, flag=flag, **spec)})


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export; `unit` applies to BVH and its ground file, while GLB and FBX are in metres.

    `start_s` and `end_s` (None: the last frame) are one argument. `character` None is the mannequin, `engine` None is
    any program. `plain`, which has no argument, removes joint scales and all but one node above the joints.
    """

    fps: float = option(
        60.0, MOTION | ARRAYS, "--fps", parse=float, metavar="F", label="Frames per second",
        choices={0.0: "as the take", **RATES},
        help="frames per second, 29.97 for example (default: 60 or the take's own, films 30)",
    )  # fmt: skip
    unit: str = option(
        "cm", GROUND | {".bvh"}, "--unit", metavar="UNIT", label="Unit",
        choices={"cm": "Centimetres", "m": "Metres"}, help="of BVH: cm or m (default: cm, or the take's own)",
    )  # fmt: skip
    euler_order: str | None = option(
        None, frozenset({".bvh"}), "--euler-order", metavar="ORDER", label="Rotations",
        choices={None: "YXZ at the hips, ZYX else", **{order: order for order in ROTATION_ORDERS}},
        hint="YXZ at hips and root avoids jumps in readers that interpolate angles",
        help="of BVH, such as ZXY (default: YXZ for root and hips, ZYX for the others)",
    )  # fmt: skip
    character: Path | None = option(
        None, BODIES | FILMS, "--character", parse=character_file, metavar="NAME|GLB",
        help="walker, or a skinned character of GLB, FBX and film",
    )  # fmt: skip
    fit_to_motion: bool = option(
        False, BODIES | FILMS, "--fit-to-motion",
        help="scale the character to the motion; otherwise it keeps its size, and steps and speed are scaled to it",
    )  # fmt: skip
    joint_map: Path | None = option(
        None, BODIES | FILMS, "--joint-map", parse=Path, metavar="JSON",
        help="joint map to use instead of the file next to it",
    )  # fmt: skip
    character_unit: str | None = option(
        None, BODIES | FILMS, "--character-unit", metavar="UNIT", label="Unit of the character",
        choices={None: "By its height", "m": "Metres", "cm": "Centimetres", "mm": "Millimetres", "in": "Inches"},
        help="of the --character file: m, cm, mm or in (default: m, or as its height suggests)",
    )  # fmt: skip
    engine: str | None = option(
        None, SKINNED, "--for", dest="engine", ignored_by=frozenset(), metavar="ENGINE", label="For",
        choices={None: "any program", **{name: name.capitalize() for name in ENGINES}},
        hint="Unit, scale, root joint and names of takes as that program expects them",
        help="GLB or FBX as unreal, unity, godot, maya or blender takes it",
    )  # fmt: skip
    humanoid_names: bool = option(
        False, SKINNED, "--humanoid-names", ignored_by=frozenset(), label="Humanoid names",
        hint="Bones named as in the humanoid of that program", help="bones named as in the engine's humanoid",
    )  # fmt: skip
    animation_only: bool = option(
        False, SCENES, "--animation-only", ignored_by=frozenset(), label="Animation only",
        hint="The skeleton and its motion, without meshes", help="GLB or FBX without meshes",
    )  # fmt: skip
    with_takes: tuple[Path, ...] = option(
        (), BODIES, "--with-take", ignored_by=frozenset(), parse=Path, metavar="TAKE",
        help="a further take in the same file",
    )  # fmt: skip
    start_s: float = option(
        0.0, flag="--range", metavar="A:B", label="Range", help="only these seconds, e.g. 2:6.5"
    )
    end_s: float | None = option(None)
    loop: bool = option(
        False, MOTION | ARRAYS | FILMS, "--loop", ignored_by=GROUND, label="Loop",
        hint="Only the best cycle of a steady walk; its seam is reported",
        help="only the best cycle of a steady walk, without a seam",
    )  # fmt: skip
    strides: int = option(
        1, MOTION | ARRAYS | FILMS, "--strides", ignored_by=GROUND, parse=int, metavar="N", label="Strides of the loop",
        choices={count: str(count) for count in (1, 2, 3, 4, 8)},
        hint="A stride is a step with each foot", help="of the loop (default: 1)",
    )  # fmt: skip
    in_place: bool = option(
        False, MOTION | ARRAYS, "--in-place", ignored_by=frozenset(), label="In place",
        hint="Remove the movement over the ground, keep the heading", help="remove the movement over the ground",
    )  # fmt: skip
    ground_root: bool = option(
        False, BODIES | {".bvh"}, "--ground-root", ignored_by=ARRAYS | GROUND, label="Root on the ground",
        hint="A root joint on the ground, above the hips", help="a root joint on the ground, above the hips",
    )  # fmt: skip
    at_origin: bool = option(
        False, MOTION | ARRAYS | GROUND, "--at-origin", ignored_by=frozenset(), label="At the origin",
        hint="Begin at the origin on height 0, facing +Z", help="begin at the origin, facing +Z",
    )  # fmt: skip
    rest_frame: bool = option(
        False, MOTION, "--rest-frame", ignored_by=ARRAYS | GROUND, label="Rest pose first",
        hint="Frame 0 is the rest pose", help="the rest pose as first frame",
    )  # fmt: skip
    with_ground: bool = option(
        False, SCENES, "--with-ground", ignored_by=frozenset(), help="the ground as a second node (GLB, FBX)"
    )
    ground_out: Path | None = option(
        None, flag="--ground-out", parse=Path, metavar="FILE", label="Ground",
        help="the ground next to the take: .obj or .glb",
    )  # fmt: skip
    film_fps: float = option(
        30.0, FILMS, label="Frames per second",
        choices={15.0: "15 fps", **{rate: text for rate, text in RATES.items() if rate <= 60.0}},
    )  # fmt: skip
    size: str = option(
        "1280x720", FILMS, "--size", metavar="WxH", label="Size", help="pixels (default: 1280x720)",
        choices={
            size: text + size
            for size, text in (
                ("640x360", ""), ("1280x720", ""), ("1920x1080", ""), ("3840x2160", "4K "), ("1080x1080", ""),
                ("720x1280", "portrait "), ("1080x1920", "portrait "),
            )
        },
    )  # fmt: skip
    camera: str = option(
        "front", FILMS, "--camera", metavar="NAME", label="Camera", choices=CAMERAS,
        help="front (default), follow, side, orbit or still",
    )  # fmt: skip
    distance: float = option(
        0.0, FILMS, "--distance", parse=float, metavar="M", label="Distance", low=0.0, high=20.0,
        help="of the camera, metres",
    )  # fmt: skip
    fov_degrees: float = option(
        0.0, FILMS, label="Field of view", low=0.0, high=90.0,
        hint="Vertical; a wider one shows more",
    )  # fmt: skip
    captions: bool = option(
        True, FILMS, "--no-captions", label="Captions", hint="The prompts under the film",
        help="leave the prompts out",
    )  # fmt: skip
    quality: str = option(
        "high", FILMS, "--quality", choices={"high": "High quality", "software": "Software"},
        label="High quality", hint="Off: faster without a graphics card", help="rendering (default: high)",
    )  # fmt: skip
    plain: bool = option(False)

    @property
    def rooted(self) -> bool:
        """Return whether the export has a root joint on the ground, by option or because the engine expects one."""
        return self.ground_root or (self.engine is not None and engine_of(self.engine).ground_root)

    @property
    def bones(self) -> Mapping[str, str]:
        """The engine's names for SPORT joints; empty without an engine."""
        return {} if self.engine is None else engine_of(self.engine).bones

    def check(self) -> None:
        """Raise UsageError that names the first option that cannot be used with the others."""
        for name, usable, problem, remedy in _RULES:
            if not usable(self):
                raise UsageError(problem(self), remedy, name)


_Rule = tuple[str, Callable[[ExportOptions], bool], Callable[[ExportOptions], str], str]
_RULES: tuple[_Rule, ...] = (  # option, condition, problem, remedy
    ("humanoid_names", lambda o: bool(o.bones) or not o.humanoid_names,
     lambda o: ": these names need an engine.", "Add --for unreal, unity, godot or maya."),
    ("fps", lambda o: 1.0 <= o.fps <= MAX_FPS,
     lambda o: f" {o.fps:g}: expected 1 to {MAX_FPS:.0f} frames per second.", "Try 60 or 30."),
    ("unit", lambda o: o.unit in UNITS_PER_METRE,
     lambda o: f" {o.unit}: expected cm or m.", "Choose one of the two."),
    ("character_unit", lambda o: o.character_unit in (None, "m", "cm", "mm", "in"),
     lambda o: f" {str(o.character_unit)[:20]}: expected m, cm, mm or in.", "Choose one of them."),
    ("euler_order", lambda o: str(o.euler_order or "XYZ").upper() in ROTATION_ORDERS,
     lambda o: f" {str(o.euler_order)[:20]}: unknown.", f"Choose {', '.join(ROTATION_ORDERS)}."),
    ("start_s", lambda o: 0.0 <= o.start_s < math.inf and (o.end_s is None or o.end_s > o.start_s),
     lambda o: f" {o.start_s:g}:{'' if o.end_s is None else f'{o.end_s:g}'}: expected 0 or more, and an end after the start.",
     "Write seconds, such as 2:6.5."),
    ("strides", lambda o: 1 <= o.strides <= MAX_STRIDES and (o.strides == 1 or o.loop),
     lambda o: f" {o.strides}: expected 1 to {MAX_STRIDES}, of a loop.", "Add --loop, or leave it out."),
    ("ground_out", lambda o: o.ground_out is None or o.ground_out.suffix.lower() in GROUND_SUFFIXES,
     lambda o: f" {o.ground_out}: expected {' or '.join(GROUND_SUFFIXES)}.", "Choose one of them."),
    ("in_place", lambda o: not (o.in_place and (o.ground_out is not None or o.with_ground)),
     lambda o: f" with a ground{'' if o.ground_out is None else ' next to it'}: the character would not move over it.",
     "Leave one of the two out."),
)  # fmt: skip
