"""The constants of one frame: camera, sun, shadow and fog, and their uniform block."""

import math
from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array
from runtime.pose import Pose
from viewer.render.camera import Camera, look_at

SUN_DIRECTION = np.array([0.480, 0.768, 0.424])  # unit, towards the sun; 50 degrees high
FOG_BEGIN_M, FOG_END_M = 7.0, 46.0
SHADOW_MARGIN_M = 0.35  # flesh around joints
GROUND_MARGIN_M = 0.45  # margin of the darkening around feet and bodies
SHADOW_REACH_M = 9.0  # of terrain shadows around the character
SHADOW_TEXEL_M = 0.007  # of the shadow map: finer ones are not visible
TEXEL_STEP = 64  # the map's size is a multiple of this
UNIFORM_BYTES = 2 * 64 + 7 * 16  # two matrices and seven vectors


@dataclass(frozen=True)
class RenderFrame:
    """Data of the frame being drawn, shared by all passes."""

    size: tuple[int, int]  # pixels
    eye: Array  # (3,) metres
    view_projection: Array  # (4, 4)
    radians_per_pixel: float
    cast: Array  # (n, 3) metres: the characters' joints, and their shadows on the ground
    shadow_texels: int  # per side of the shadow map
    uniforms: bytes  # the block `Frame` of common.glsl

    def ground_box(self, reach_m: float) -> tuple[Array, Array]:
        """Return the min and max (x, z) `(2,)` around characters and shadows, extending at least `reach_m`."""
        if not len(self.cast):
            return np.zeros(2), np.zeros(2)
        low, high = self.cast[:, ::2].min(0), self.cast[:, ::2].max(0)
        spare = np.maximum(GROUND_MARGIN_M, reach_m - 0.5 * (high - low))
        return low - spare, high + spare

    def screen_box(self, points: Array, margin_m: float) -> tuple[int, int, int, int]:
        """Return the pixel box (x, y, width, height; y up) of `points` `(n, 3)`; the full frame if one is behind the camera."""
        width, height = self.size
        if not len(points):
            return 0, 0, 0, 0
        clip = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ self.view_projection.T
        if np.any(clip[:, 3] < 0.05):
            return 0, 0, width, height
        pixels = (0.5 + 0.5 * clip[:, :2] / clip[:, 3:]) * self.size
        margin = margin_m / (self.radians_per_pixel * clip[:, 3:])
        x0, y0 = np.clip(np.floor((pixels - margin).min(0)), 0, self.size).astype(int)
        x1, y1 = np.clip(np.ceil((pixels + margin).max(0)), 0, self.size).astype(int)
        return int(x0), int(y0), int(x1 - x0), int(y1 - y0)


def make_frame(
    camera: Camera, size: tuple[int, int], poses: list[Pose], shadow_reach_m: float, most_texels: int
) -> RenderFrame:
    """Return the data of a frame for a camera and shadow-casting poses; the shadow map has at most `most_texels` a side."""
    aspect = size[0] / max(size[1], 1)
    view, projection = camera.view_matrix(), camera.projection_matrix(aspect)
    eye = np.asarray(camera.position, np.float32)
    view_projection = (projection @ view).astype(np.float32)
    cast = _shadow_points(poses)
    shadow, texels = _fit_shadow(poses, camera.target, shadow_reach_m, most_texels)
    half_height = camera.half_height
    scale = max(1.0, 0.14 * camera.distance)
    vectors = np.zeros((7, 4), np.float32)
    vectors[0, :3] = eye
    vectors[1, :3] = view[0, :3] * half_height * aspect
    vectors[2, :3] = view[1, :3] * half_height
    vectors[3, :3] = -view[2, :3] - camera.shift * vectors[1, :3] - camera.shift_up * vectors[2, :3]
    vectors[4, :3] = SUN_DIRECTION
    vectors[5] = size[0], size[1], 1 / size[0], 1 / size[1]
    vectors[6] = camera.target[0], camera.target[2], FOG_BEGIN_M * scale, FOG_END_M * scale
    uniforms = view_projection.tobytes() + shadow.astype(np.float32).tobytes() + vectors.tobytes()
    return RenderFrame(size, eye, view_projection, 2 * half_height / size[1], cast, texels, uniforms)


def _shadow_points(poses: list[Pose]) -> Array:
    """Return the joints and where their shadows fall on level ground `(n, 3)`."""
    if not poses:
        return np.zeros((0, 3))
    points = np.concatenate([pose.positions for pose in poses]).astype(float)
    ground = np.concatenate([np.full(len(p.positions), p.root_position[1]) for p in poses])
    fall = np.maximum(points[:, 1] - ground, 0.0)[:, None] * (SUN_DIRECTION / SUN_DIRECTION[1])
    return np.concatenate([points, points - 1.15 * fall])  # a little farther: the ground may drop


def _fit_shadow(poses: list[Pose], focus: Array, reach_m: float, most_texels: int) -> tuple[Array, int]:
    """Return the matrix `(4, 4)` from the world to the shadow map around the poses, 0 to 1, and the map's texels a side."""
    points = np.concatenate([pose.positions for pose in poses] or [focus[None]]).astype(float)
    centre = 0.5 * (points.min(0) + points.max(0))
    radius = float(np.max(np.linalg.norm(points - centre, axis=1))) + SHADOW_MARGIN_M
    radius = max(math.ceil(radius * 4) / 4, reach_m)  # quantised, so that edges do not shimmer
    texels = min(most_texels, math.ceil(2 * radius / SHADOW_TEXEL_M / TEXEL_STEP) * TEXEL_STEP)
    view = look_at(centre + SUN_DIRECTION, centre).astype(float)
    texel = 2 * radius / texels
    depth = radius + 6.0
    m = np.eye(4)
    m[:3, :3] = view[:3, :3]
    m[:2, 3] = -np.round((view[:2, :3] @ centre) / texel) * texel
    m[2, 3] = -(view[2, :3] @ centre)
    clip = np.diag([0.5 / radius, 0.5 / radius, -0.5 / depth, 1.0])
    clip[:3, 3] = 0.5
    return clip @ m, texels
