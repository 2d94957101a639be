#version 330
// A vertex of the ground, with its slope and how it stands out of what lies around.
#include "common.glsl"
#include "height_map.glsl"
in vec2 in_slope;
in float in_relief;
out vec3 position;
out vec3 normal;
out float relief;
invariant gl_Position;

void main() {
    position = grid_position();
    relief = in_relief;
    normal = normalize(vec3(-in_slope.x, 1.0, -in_slope.y));
    gl_Position = view_projection * vec4(position, 1.0);
}
