"""Rendering quality presets."""

from dataclasses import dataclass, replace

import moderngl

SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "swiftshader")


@dataclass(frozen=True)
class Quality:
    """Rendering quality; the presets are `FAST`, `SOFTWARE` and `HIGH`."""

    name: str
    grid_resolution: int  # terrain vertices per side; the mesh keeps to 2 * grid_resolution ** 2 triangles
    shadow_map_size: int  # texels per side
    shadow_taps: int  # 1: one filtered tap; more: a soft edge
    # cell size in which a character's vertices are merged when drawn (0: none are), and in its shadow
    cell_m: float
    shadow_cell_m: float
    terrain_casts_shadow: bool
    self_shadow: bool  # characters receive shadows too
    msaa: int  # samples per pixel; 0: none
    # what is smoothed afterwards without multisampling: "characters", "all" or ""
    smooth_edges: str
    render_scale: float  # rendered pixels per shown pixel, along one side
    max_pixels: int  # a larger frame is rendered with this many and upscaled; 0: no limit


FAST = Quality("fast", 64, 384, 8, 0.009, 0.030, False, False, 0, "characters", 0.6, 340_000)
SOFTWARE = Quality("software", 104, 768, 8, 0.0, 0.018, False, False, 0, "characters", 1.0, 1_100_000)
HIGH = Quality("high", 256, 2048, 8, 0.0, 0.0, True, True, 4, "", 1.0, 0)
PRESETS = {preset.name: preset for preset in (FAST, SOFTWARE, HIGH)}


def is_software(ctx: moderngl.Context) -> bool:
    """Return whether OpenGL runs on the CPU."""
    renderer = str(ctx.info["GL_RENDERER"]).lower()
    return any(name in renderer for name in SOFTWARE_RENDERERS)


def choose_quality(ctx: moderngl.Context, name: str = "") -> Quality:
    """Return the preset of a name; the default is `SOFTWARE` if OpenGL runs on the CPU, else `HIGH`.

    On the CPU multisampling costs as much as the rest of a frame, so edges are smoothed instead.
    """
    software = is_software(ctx)
    preset = PRESETS[name or ("software" if software else "high")]
    return replace(preset, msaa=0, smooth_edges="all") if software and preset.msaa else preset
