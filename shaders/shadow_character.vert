#version 330
// The character as the sun sees it.
#include "common.glsl"
#include "skinning.glsl"

void main() {
    vec4 world = skin_matrix() * vec4(in_position, 1.0);
    gl_Position = vec4((shadow_from_world * vec4(world.xyz, 1.0)).xyz * 2.0 - 1.0, 1.0);
}
