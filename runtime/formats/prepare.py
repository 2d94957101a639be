"""Prepares a take for export in any format: rate, range, loop, placement, root."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from runtime import rotations
from runtime.errors import UsageError
from runtime.feet.skating import measured_contacts
from runtime.formats.options import ExportOptions
from runtime.safe_read import printable
from runtime.skeleton import REST_HIPS_HEIGHT, J
from runtime.takes.clip import Clip
from runtime.takes.loop import make_loop
from runtime.takes.metadata import UNMOVED
from runtime.takes.root import Placement, RootTrack, root_track
from runtime.terrain.height_map import Terrain

Check = Callable[[], None]  # called often while a file is made; cancels with an exception


def go_on() -> None:
    """Do nothing; the default `Check` for exports that cannot be cancelled."""


@dataclass(frozen=True)
class PreparedTake:
    """A clip ready to be written; `root` has one entry for each of its frames.

    `placement` is the transform applied to the clip, which the ground needs too; `rest_frame`: frame 0 is the rest pose.
    """

    clip: Clip
    root: RootTrack
    placement: Placement
    rest_frame: bool


def prepare(clip: Clip, options: ExportOptions, terrain: Terrain | None = None) -> PreparedTake:
    """Apply the export `options` to a clip on its `terrain` (None: level ground under its lowest sole). Raises UsageError."""
    options.check()
    terrain = None if terrain is None or clip.placed is None else terrain.seen_by(clip.size)
    at_rate = with_contacts(on_its_ground(clip), terrain).resampled(options.fps)
    track = root_track(at_rate, terrain)
    if clip.placed is None:  # a take in place, exported with its root at the origin
        track = RootTrack(np.zeros_like(track.positions), track.yaw)
    taken, track = _in_range(at_rate, track, options)
    if options.loop:
        taken, track = make_loop(taken, track, options.strides)
    placement = _placement(clip, track, options)
    if not placement.identity:
        taken, track = placement.clip(taken), track.moved(placement)
    if options.in_place:
        taken = taken.posed(taken.hips_positions - track.positions, taken.local_rotations)
        track = RootTrack(np.zeros_like(track.positions), track.yaw)
    if options.rest_frame:
        taken, track = _with_rest_frame(taken, track)
    lost = options.in_place or clip.placed is None
    taken = replace(taken, placed=None if lost else (placement.yaw, *placement.offset))
    return PreparedTake(_printable(taken), track, placement, options.rest_frame)


def _placement(clip: Clip, track: RootTrack, options: ExportOptions) -> Placement:
    """Return the clip's placement, or the one that puts its root at the origin, facing +Z."""
    if not options.at_origin:
        return placement_of(clip)
    turn = Placement(0.0 - float(track.yaw[0]))
    x, y, z = (0.0 - float(v) for v in turn.points(track.positions[0]))
    return Placement(turn.yaw, (x, y, z))


def _printable(clip: Clip) -> Clip:
    """Return the clip with texts that can be encoded: file names may be any bytes."""
    prompts = tuple(event.rewritten(printable) for event in clip.prompts)
    return replace(clip, name=printable(clip.name), prompts=prompts)


def placement_of(clip: Clip) -> Placement:
    """Return the transform by which an export moved a clip from its place on its ground."""
    yaw, x, y, z = clip.placed or UNMOVED
    return Placement(yaw, (x, y, z))


def on_its_ground(clip: Clip) -> Clip:
    """Undo the placement of an export, so that the clip is back on its ground; clips without a placement are unchanged."""
    placement = placement_of(clip)
    return clip if placement.identity else replace(placement.inverse().clip(clip), placed=UNMOVED)


def with_contacts(clip: Clip, terrain: Terrain | None) -> Clip:
    """Return the clip with contacts measured from its motion, if it has none."""
    if clip.contacts.any():
        return clip
    ground = None if terrain is None else terrain.seen_by(clip.size)
    return replace(clip, contacts=measured_contacts(clip.world()[0], clip.fps, ground))


def frames_in_range(options: ExportOptions, count: int, fps: float) -> tuple[int, int]:
    """Return the first and last of `count` frames that the options keep; UsageError if they begin after the end."""
    first = round(options.start_s * fps)
    last = count - 1 if options.end_s is None else min(round(options.end_s * fps), count - 1)
    if not 0 <= first <= last:
        problem = f" {options.start_s:g}: the clip lasts {(count - 1) / fps:.1f} s."
        raise UsageError(problem, "Choose an earlier start.", "start_s")
    return first, last


def _in_range(clip: Clip, track: RootTrack, options: ExportOptions) -> tuple[Clip, RootTrack]:
    first, last = frames_in_range(options, len(clip), clip.fps)
    whole = (first, last) == (0, len(clip) - 1)
    return (clip, track) if whole else (clip.trim(first, last), track.cut(first, last))


def _with_rest_frame(clip: Clip, track: RootTrack) -> tuple[Clip, RootTrack]:
    """Return the clip with the rest pose one frame before it, at its start position and heading."""
    local = rotations.identity((1, J))
    local[0, 0] = rotations.from_yaw(float(track.yaw[0]))
    hips = (track.positions[:1] + np.array([0.0, REST_HIPS_HEIGHT, 0.0])).astype(np.float32)
    later = 1.0 / clip.fps
    rest = (hips, local, np.ones_like(clip.contacts[:1]))
    begun = replace(
        clip.posed(*(np.concatenate(pair) for pair in zip(rest, clip.arrays, strict=True))),
        gaits=None if clip.gaits is None else np.concatenate([clip.gaits[:1], clip.gaits]),
        prompts=tuple(replace(event, seconds=event.seconds + later) for event in clip.prompts),
    )
    return begun, RootTrack(
        np.concatenate([track.positions[:1], track.positions]), np.concatenate([track.yaw[:1], track.yaw])
    )
