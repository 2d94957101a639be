"""The exports room's slice of the state: what the export window shows, as it is chosen there."""

from __future__ import annotations

from dataclasses import dataclass, field

from runtime.formats.table import FORMATS, Format

SIZES = {"640x360": (640, 360), "1280x720": (1280, 720), "1920x1080": (1920, 1080), "1080x1080": (1080, 1080)}
GROUNDS = {"": "No ground", "inside": "Ground inside", ".obj": "OBJ beside", ".glb": "GLB beside"}


@dataclass
class ExportForm:
    """What is chosen: for motion, then for films."""

    suffix: str = ".glb"
    fps: float = 0.0  # 0: as the take
    unit: str = "cm"
    euler_order: str = ""  # "": as `format_bvh` chooses
    engine: str = ""  # "": any program
    humanoid_names: bool = False
    animation_only: bool = False
    trimmed: bool = True  # only what lies between the trim marks
    loop: bool = False
    strides: int = 1  # of the loop
    in_place: bool = False
    ground_root: bool = False
    at_origin: bool = False
    rest_frame: bool = False
    ground: str = ""  # one of `GROUNDS`
    own_character: bool = True  # where one is on the stage
    film_fps: float = 30.0
    size: str = "1280x720"
    camera: str = "front"
    distance: float = 0.0  # metres, 0 for the camera's usual one
    fov_degrees: float = 0.0  # field of view of the film, 0 for the usual one
    captions: bool = True
    quality: str = "high"

    @property
    def format(self) -> Format:
        """What is written."""
        return FORMATS[self.suffix]


@dataclass
class ExportState:
    """The export window."""

    open: bool = False
    form: ExportForm = field(default_factory=ExportForm)
    path: str = ""  # the field
    missing: str = ""  # what the format needs and is not installed, and how to get it
    progress: tuple[int, int] = (0, 0)  # frames of film done, and in all
    report: str = ""  # what became of the last export
    shown_report: str = ""  # the one of the frame before
    report_good: bool = True
