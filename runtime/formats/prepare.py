"""Options of an export, and a take as they ask for it, whatever format it goes to: rate, range, loop, place, root."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.errors import UsageError
from runtime.formats.engines import engine_of
from runtime.skeleton import REST_HIPS_HEIGHT, J
from runtime.takes.clip import MAX_FPS, Clip
from runtime.takes.loop import LoopReport, make_loop
from runtime.takes.metadata import UNMOVED
from runtime.takes.root import Placement, RootTrack, root_track
from runtime.terrain.height_map import Terrain

UNITS_PER_METRE = {"cm": 100.0, "m": 1.0}
ROTATION_ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")

MAX_STRIDES = 16  # of a loop


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export; `unit` concerns BVH and the ground beside it, GLB and FBX are in metres."""

    fps: float = 60.0
    unit: str = "cm"
    euler_order: str | None = (
        None  # of BVH, one of `ROTATION_ORDERS`; None: the heading first at root and hips
    )
    in_place: bool = False  # the root stays at the origin, its heading is kept
    ground_root: bool = False  # a joint of its own above the hips, on the ground
    at_origin: bool = False  # begin at x = z = 0 on height 0, facing +Z
    rest_frame: bool = False  # the rest pose as first frame
    loop: bool = False  # only the best cycle of a steady walk
    strides: int = 1  # of that cycle
    start_s: float = 0.0
    end_s: float | None = None  # None: to the last frame
    with_ground: bool = False  # the ground as a second node (GLB, FBX)
    character: Path | None = None  # of GLB, FBX and film; None: the mannequin
    engine: str | None = None  # a key of `engines.ENGINES`: what its files must be like (GLB, FBX)
    humanoid_names: bool = False  # the bone names of the engine's humanoid
    animation_only: bool = False  # without meshes
    with_takes: tuple[Path, ...] = ()  # further takes of the same file
    plain: bool = False  # joints without scales, and one node above them
    fit_to_motion: bool = False  # the character gets the size of the motion, in place of keeping its own
    joint_map: Path | None = None  # names of its joints, see `runtime.character.joint_map.read_joint_map`

    @property
    def rooted(self) -> bool:
        """Whether there is a root joint on the ground: by itself, or since the engine wants it."""
        return self.ground_root or (self.engine is not None and engine_of(self.engine).ground_root)

    def check(self) -> None:
        """UsageError names the option that cannot be used."""
        if self.engine is not None:
            engine_of(self.engine)
        if self.humanoid_names and (self.engine is None or not engine_of(self.engine).bones):
            raise UsageError(
                ": these names are those of an engine.",
                "Add --for unreal, unity, godot or maya.",
                "humanoid_names",
            )
        if not 1.0 <= self.fps <= MAX_FPS:
            raise UsageError(
                f" {self.fps:g}: expected 1 to {MAX_FPS:.0f} frames per second.", "Try 60 or 30.", "fps"
            )
        if self.unit not in UNITS_PER_METRE:
            raise UsageError(f" {self.unit}: expected cm or m.", "Choose one of the two.", "unit")
        if self.euler_order is not None and self.euler_order.upper() not in ROTATION_ORDERS:
            raise UsageError(
                f" {self.euler_order[:20]}: unknown.", f"Choose {', '.join(ROTATION_ORDERS)}.", "euler_order"
            )
        if not self.start_s >= 0.0 or (self.end_s is not None and not self.end_s > self.start_s):
            end = "" if self.end_s is None else f"{self.end_s:g}"
            raise UsageError(
                f" {self.start_s:g}:{end}: expected 0 or more, and an end after the start.",
                "Write seconds, such as 2:6.5.",
                "start_s",
            )
        if not 1 <= self.strides <= MAX_STRIDES or (self.strides > 1 and not self.loop):
            raise UsageError(
                f" {self.strides}: expected 1 to {MAX_STRIDES}, of a loop.",
                "Add --loop, or leave it out.",
                "strides",
            )
        if self.in_place and self.with_ground:
            raise UsageError(
                " with a ground: the character would not move over it.",
                "Leave one of the two out.",
                "in_place",
            )


@dataclass(frozen=True)
class PreparedTake:
    """A clip ready to be written; `root` has one entry for each of its frames.

    `placement` is where the ground goes with it, `loop` what the loop came to, and `rest_frame` says that frame 0 is
    the rest pose.
    """

    clip: Clip
    root: RootTrack
    placement: Placement
    loop: LoopReport | None
    rest_frame: bool


def prepare(clip: Clip, options: ExportOptions, terrain: Terrain | None = None) -> PreparedTake:
    """`clip` as `options` ask for it, on its `terrain` (None: on the level of its lowest sole). UsageError as in `check`."""
    options.check()
    terrain = None if terrain is None else terrain.seen_by(clip.size)
    at_rate, there = on_its_ground(clip).resampled(options.fps), placement_of(clip)
    track = root_track(at_rate, terrain if clip.placed is not None else None)
    first, last = _frames(at_rate, options)
    taken, report = at_rate, None
    if (first, last) != (0, len(at_rate) - 1):
        taken, track = at_rate.trim(first, last), track.cut(first, last)
    if options.loop:
        taken, track, report = make_loop(taken, track, options.strides)
    placement = _to_origin(track) if options.at_origin else there
    if not placement.identity:
        taken, track = placement.clip(taken), track.moved(placement)
    if options.in_place:
        taken = replace(taken, hips_positions=(taken.hips_positions - track.positions).astype(np.float32))
        track = RootTrack(np.zeros_like(track.positions), track.yaw)
    if options.rest_frame:
        taken, track = _with_rest_frame(taken, track)
    lost = options.in_place or clip.placed is None
    taken = replace(taken, placed=None if lost else (placement.yaw, *placement.offset))
    return PreparedTake(taken, track, placement, report, options.rest_frame)


def placement_of(clip: Clip) -> Placement:
    """Where an export has moved a clip to from its place on its ground."""
    yaw, x, y, z = clip.placed or UNMOVED
    return Placement(yaw, (x, y, z))


def on_its_ground(clip: Clip) -> Clip:
    """The clip back in its place on its ground, whatever export moved it elsewhere; what lost its ground stays."""
    placement = placement_of(clip)
    return clip if placement.identity else replace(placement.inverse().clip(clip), placed=UNMOVED)


def _frames(clip: Clip, options: ExportOptions) -> tuple[int, int]:
    first = round(options.start_s * clip.fps)
    last = len(clip) - 1 if options.end_s is None else min(round(options.end_s * clip.fps), len(clip) - 1)
    if not 0 <= first <= last:
        raise UsageError(
            f" {options.start_s:g}: the clip lasts {clip.seconds:.1f} s.",
            "Choose an earlier start.",
            "start_s",
        )
    return first, last


def _to_origin(track: RootTrack) -> Placement:
    turn = Placement(0.0 - float(track.yaw[0]))
    x, y, z = (0.0 - float(v) for v in turn.points(track.positions[0]))
    return Placement(turn.yaw, (x, y, z))


def _with_rest_frame(clip: Clip, track: RootTrack) -> tuple[Clip, RootTrack]:
    """The rest pose where the clip begins, facing as it does, one frame before it."""
    local = rotations.identity((1, J))
    local[0, 0] = rotations.from_yaw(float(track.yaw[0]))
    hips = (track.positions[:1] + np.array([0.0, REST_HIPS_HEIGHT, 0.0])).astype(np.float32)
    later = 1.0 / clip.fps
    begun = replace(
        clip,
        hips_positions=np.concatenate([hips, clip.hips_positions]),
        local_rotations=np.concatenate([local.astype(np.float32), clip.local_rotations]),
        contacts=np.concatenate([np.ones_like(clip.contacts[:1]), clip.contacts]),
        gaits=None if clip.gaits is None else np.concatenate([clip.gaits[:1], clip.gaits]),
        prompts=tuple(replace(event, seconds=event.seconds + later) for event in clip.prompts),
    )
    return begun, RootTrack(
        np.concatenate([track.positions[:1], track.positions]), np.concatenate([track.yaw[:1], track.yaw])
    )
