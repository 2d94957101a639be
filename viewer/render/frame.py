"""The constants of one picture: camera, sun, shadow and fog, and their uniform block."""

from __future__ import annotations

import math
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from runtime.pose import Pose
from viewer.camera import Camera, look_at

Array = NDArray[np.floating]

FRAME_BINDING = 0
SUN_DIRECTION = np.array([0.42, 0.80, 0.43]) / math.sqrt(0.42**2 + 0.80**2 + 0.43**2)
FOG_BEGIN_M, FOG_END_M = 7.0, 46.0
SHADOW_MARGIN_M = 0.35  # flesh around joints
SHADOW_REACH_M = 9.0  # of terrain shadows around the character


@dataclass(frozen=True)
class Frame:
    """What every pass may ask about the picture that is being drawn."""

    size: tuple[int, int]  # pixels
    eye: Array  # (3,) metres
    view_projection: Array  # (4, 4)
    radians_per_pixel: float
    shadow_low: Array  # (2,) x, z of the ground that shadows and feet may darken
    shadow_high: Array  # (2,)
    uniforms: bytes  # the block `Frame` of common.glsl


def make_frame(
    camera: Camera, size: tuple[int, int], poses: list[Pose], shadow_reach_m: float, shadow_texels: int
) -> Frame:
    """The frame of a camera and the poses that cast shadows."""
    aspect = size[0] / max(size[1], 1)
    view, projection = camera.view_matrix(), camera.projection_matrix(aspect)
    eye = np.asarray(camera.position, np.float32)
    view_projection = (projection @ view).astype(np.float32)
    shadow, low, high = _fit_shadow(poses, camera.target, shadow_reach_m, shadow_texels)
    half_height = math.tan(camera.fov_y / 2)
    scale = max(1.0, 0.14 * camera.distance)
    vectors = np.zeros((7, 4), np.float32)
    vectors[0, :3] = eye
    vectors[1, :3] = view[0, :3] * half_height * aspect
    vectors[2, :3] = view[1, :3] * half_height
    vectors[3, :3] = -view[2, :3]
    vectors[4, :3] = SUN_DIRECTION
    vectors[5] = size[0], size[1], 1 / size[0], 1 / size[1]
    vectors[6] = camera.target[0], camera.target[2], FOG_BEGIN_M * scale, FOG_END_M * scale
    uniforms = view_projection.tobytes() + shadow.astype(np.float32).tobytes() + vectors.tobytes()
    return Frame(size, eye, view_projection, 2 * half_height / size[1], low, high, uniforms)


def _fit_shadow(poses: list[Pose], focus: Array, reach_m: float, texels: int) -> tuple[Array, Array, Array]:
    """World to shadow map `(4, 4)` in 0..1 around the poses, and the ground rectangle (x, z) they may darken."""
    if poses:
        points = np.concatenate([pose.positions for pose in poses]).astype(float)
        ground = np.concatenate([np.full(len(p.positions), p.root_position[1]) for p in poses])
    else:
        points, ground = np.asarray(focus, float)[None], np.asarray(focus, float)[1:2]
    fall = np.maximum(points[:, 1] - ground, 0.0)[:, None] * (SUN_DIRECTION / SUN_DIRECTION[1])
    on_ground = points - 1.3 * fall  # a little further: the ground may drop
    both = np.concatenate([points, on_ground])
    low, high = both.min(0) - SHADOW_MARGIN_M, both.max(0) + SHADOW_MARGIN_M
    centre = 0.5 * (points.min(0) + points.max(0))
    radius = float(np.max(np.linalg.norm(points - centre, axis=1))) + SHADOW_MARGIN_M
    radius = max(math.ceil(radius * 4) / 4, reach_m)
    view = look_at(centre + SUN_DIRECTION, centre).astype(float)
    texel = 2 * radius / texels
    middle = np.round((view[:2, :3] @ centre) / texel) * texel  # whole texels: edges do not shimmer
    depth = radius + 6.0
    m = np.eye(4)
    m[:3, :3] = view[:3, :3]
    m[:2, 3] = -middle
    m[2, 3] = -(view[2, :3] @ centre)
    clip = np.diag([0.5 / radius, 0.5 / radius, -0.5 / depth, 1.0])
    clip[:3, 3] = 0.5
    reach = np.array([reach_m, reach_m])
    flat_low, flat_high = np.minimum(low[::2], centre[::2] - reach), np.maximum(high[::2], centre[::2] + reach)
    return clip @ m, flat_low, flat_high


class FrameUniforms:
    """The uniform block on the GPU."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._buffer = ctx.buffer(reserve=2 * 64 + 7 * 16, dynamic=True)

    def write(self, frame: Frame) -> None:
        """Upload and bind the frame's constants for all following passes."""
        self._buffer.write(frame.uniforms)
        self._buffer.bind_to_uniform_block(FRAME_BINDING)

    def release(self) -> None:
        """Free the buffer."""
        self._buffer.release()


def bind_frame(program: moderngl.Program) -> moderngl.Program:
    """Connect a program's block `Frame`, if it has one."""
    if "Frame" in program:
        program["Frame"].binding = FRAME_BINDING
    return program
