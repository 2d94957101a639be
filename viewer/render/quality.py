"""How much the renderer spends on a frame."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl

SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "swiftshader")


@dataclass(frozen=True)
class Quality:
    """One preset; `SOFTWARE` and `HIGH` are the shipped ones."""

    name: str
    grid_resolution: int  # terrain vertices per side; the mesh keeps to 2 * grid_resolution ** 2 triangles
    shadow_map_size: int  # texels per side
    shadow_taps: int  # 1: one filtered tap; more: a soft edge
    terrain_casts_shadow: bool
    msaa: int  # samples per pixel; 0: none
    render_scale: float  # rendered pixels per shown pixel, along one side


SOFTWARE = Quality("software", 96, 512, 1, False, 0, 1.0)
HIGH = Quality("high", 256, 2048, 16, True, 4, 1.0)


def choose_quality(ctx: moderngl.Context) -> Quality:
    """`SOFTWARE` when OpenGL runs on the processor, else `HIGH`."""
    renderer = str(ctx.info["GL_RENDERER"]).lower()
    return SOFTWARE if any(name in renderer for name in SOFTWARE_RENDERERS) else HIGH
