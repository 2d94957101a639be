#version 330
// The ground as the sun sees it.
#include "common.glsl"
#include "height_map.glsl"

void main() {
    gl_Position = vec4((shadow_from_world * vec4(grid_position(), 1.0)).xyz * 2.0 - 1.0, 1.0);
}
