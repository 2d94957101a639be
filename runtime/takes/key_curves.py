"""Animation curves of a take's pose layer and camera, and edits of single keys.

A channel is one component of a curve: an axis of a joint's rotation or offset, or a camera parameter. Its values are
in an animator's units: degrees, centimetres, and metres for the camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import astuple, dataclass, replace
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.takes.camera_keys import MAX_DISTANCE_M, MAX_PITCH, CameraKey, view_at, with_key
from runtime.takes.pose_layer import POSE_CURVES, Curve, PoseKey, PoseLayer, Tangent

MIN_DISTANCE_M = 0.1  # of the camera
CAMERA_AXES = ("yaw", "pitch", "distance", "x", "y", "z")
POSE_AXES = ("x", "y", "z")


class Channel(NamedTuple):
    """One component of an animation curve."""

    curve: Curve
    joint: int  # of the skeleton; -1 for the camera
    axis: int  # of `POSE_AXES` or `CAMERA_AXES`

    @property
    def unit(self) -> str:
        """The unit in which its values are shown."""
        if self.curve is Curve.CAMERA:
            return "°" if self.axis < 2 else "m"
        return "°" if self.curve is Curve.TURN else "cm"

    @property
    def factor(self) -> float:
        """Factor from the stored values (radians, metres) to the shown unit."""
        return {"°": math.degrees(1.0), "cm": 100.0, "m": 1.0}[self.unit]


class CurveKey(NamedTuple):
    """A key on a channel's curve, identified by its frame."""

    channel: Channel
    frame: int


@dataclass(frozen=True)
class KeyedCurves:
    """The pose layer and camera keys of a take, as curves; `frames` and `fps` are those of the take."""

    layer: PoseLayer
    cameras: tuple[CameraKey, ...]
    fps: float
    frames: int

    def channels(self) -> list[Channel]:
        """Return every channel with a key: joints in order, then the camera."""
        joints = [(curve, joint) for curve in POSE_CURVES for joint in self.layer.joints(curve)]
        joints.sort(key=lambda each: each[1])
        found = [Channel(curve, joint, axis) for curve, joint in joints for axis in range(len(POSE_AXES))]
        axes = range(len(CAMERA_AXES)) if self.cameras else ()
        return found + [Channel(Curve.CAMERA, -1, axis) for axis in axes]

    def keys(self, channel: Channel) -> dict[int, float]:
        """Return the channel's keys as frame to value, in its unit."""
        if channel.curve is Curve.CAMERA:
            values = [(key.seconds, astuple(key)[1 + channel.axis]) for key in self.cameras]
        else:
            values = [
                (key.seconds, float(value.vector[channel.axis]))
                for key in self.layer.keys
                for value in key.values(channel.curve)
                if value.joint == channel.joint
            ]
        return {self._frame(seconds): value * channel.factor for seconds, value in values}

    def values(self, channel: Channel, seconds: Array) -> Array:
        """Return the curve's values at times `(T,)` in the channel's unit."""
        if channel.curve is Curve.CAMERA:
            views = [astuple(view_at(self.cameras, float(at)))[1 + channel.axis] for at in seconds]
            return channel.factor * np.array(views, np.float64)
        return channel.factor * self.layer.values(channel.curve, channel.joint, seconds)[:, channel.axis]

    def tangent(self, key: CurveKey) -> Tangent | None:
        """Return the tangent mode of a pose key; None for the camera, whose curves are always smooth."""
        found = None if key.channel.curve is Curve.CAMERA else self.layer.key_at(key.frame, self.fps)
        return None if found is None else found.tangent

    def _frame(self, seconds: float) -> int:
        return round(seconds * self.fps)

    # --- edits

    def moved(self, chosen: Collection[CurveKey], frames: int, by: Callable[[Channel], float]) -> KeyedCurves:
        """Return the curves with keys moved by `frames`, and by `by` in the unit of each channel.

        A joint's three axes move together in time, as do all components of the camera. A moved key replaces a key at
        its new frame. Raises UsageError for values out of range.
        """
        frames = self.bounded(chosen, frames)
        layer, cameras = self.layer, list(self.cameras)
        for curve, joint, frame in _by_curve(chosen):
            if curve is Curve.CAMERA:
                cameras = [key for key in cameras if self._frame(key.seconds) != frame]
            else:
                layer = self._without(layer, curve, joint, frame)
        for (curve, joint, frame), axes in _by_curve(chosen).items():
            change = {axis: by(Channel(curve, joint, axis)) for axis in axes}
            if curve is Curve.CAMERA:
                key = next(key for key in self.cameras if self._frame(key.seconds) == frame)
                cameras = list(with_key(cameras, self._camera_moved(key, frames, change), self.fps))
            else:
                layer = self._placed(layer, curve, joint, frame, frames, change)
        return replace(self, layer=layer, cameras=tuple(cameras))

    def removed(self, chosen: Collection[CurveKey]) -> KeyedCurves:
        """Return the curves with keys removed: all axes of a joint's key, or the whole camera key."""
        layer, gone = self.layer, set[int]()
        for curve, joint, frame in _by_curve(chosen):
            if curve is Curve.CAMERA:
                gone.add(frame)
            else:
                layer = self._without(layer, curve, joint, frame)
        kept = tuple(key for key in self.cameras if self._frame(key.seconds) not in gone)
        return replace(self, layer=layer, cameras=kept)

    def inserted(self, channel: Channel, frame: int) -> KeyedCurves:
        """Return the curves with a key inserted on a channel's curve at a frame, without changing its shape there."""
        seconds = frame / self.fps
        if channel.curve is Curve.CAMERA:
            return replace(self, cameras=with_key(self.cameras, view_at(self.cameras, seconds), self.fps))
        key = self.layer.key_at(frame, self.fps) or PoseKey(seconds)
        value = self.layer.values(channel.curve, channel.joint, np.array([key.seconds]))[0]
        key = key.with_value(channel.curve, channel.joint, value)
        return replace(self, layer=self.layer.with_key(key, self.fps))

    def with_tangent(self, chosen: Collection[CurveKey], tangent: Tangent) -> KeyedCurves:
        """Return the curves with another tangent mode for pose keys."""
        layer = self.layer
        for curve, _, frame in _by_curve(chosen):
            key = None if curve is Curve.CAMERA else layer.key_at(frame, self.fps)
            if key is not None:
                layer = layer.with_key(replace(key, tangent=tangent), self.fps)
        return replace(self, layer=layer)

    def bounded(self, chosen: Collection[CurveKey], frames: int) -> int:
        """Return the frame offset limited so that all chosen keys stay within the take."""
        at = [key.frame for key in chosen] or [0]
        return max(min(frames, max(self.frames - 1 - max(at), 0)), -min(at))

    def _without(self, layer: PoseLayer, curve: Curve, joint: int, frame: int) -> PoseLayer:
        key = layer.key_at(frame, self.fps)
        if key is None:
            return layer
        left = key.without(joint, (curve,))
        return layer.with_key(left, self.fps) if left else layer.without_key(key)

    def _placed(
        self, layer: PoseLayer, curve: Curve, joint: int, frame: int, frames: int, change: dict[int, float]
    ) -> PoseLayer:
        before = self.layer.key_at(frame, self.fps)
        assert before is not None
        seconds = (frame + frames) / self.fps if frames else before.seconds
        key = layer.key_at(frame + frames, self.fps) or PoseKey(seconds, tangent=before.tangent)
        value = before.value(curve, joint)
        for axis, by in change.items():
            value[axis] += by / Channel(curve, joint, axis).factor
        return layer.with_key(key.with_value(curve, joint, value), self.fps)

    def _camera_moved(self, key: CameraKey, frames: int, change: dict[int, float]) -> CameraKey:
        values = list(astuple(key)[1:])
        for axis, by in change.items():
            values[axis] += by / Channel(Curve.CAMERA, -1, axis).factor
        values[1] = min(max(values[1], -MAX_PITCH), MAX_PITCH)
        values[2] = min(max(values[2], MIN_DISTANCE_M), MAX_DISTANCE_M)
        seconds = (self._frame(key.seconds) + frames) / self.fps if frames else key.seconds
        return CameraKey(seconds, *values)


def _by_curve(chosen: Collection[CurveKey]) -> dict[tuple[Curve, int, int], list[int]]:
    """Return axes by curve, joint and frame, in order of time."""
    found: dict[tuple[Curve, int, int], list[int]] = {}
    for (curve, joint, axis), frame in sorted(chosen, key=lambda key: (key.frame, key.channel)):
        found.setdefault((curve, joint, frame), []).append(axis)
    return found


def span_of(values: Sequence[float], least: float) -> tuple[float, float]:
    """Return the lowest and highest value with a margin of a tenth, at least `least` apart."""
    low, high = min(values, default=0.0), max(values, default=0.0)
    around = max(0.1 * (high - low), 0.5 * (least - (high - low)), 0.0)
    return low - around, high + around
