#version 330
// A vertex of the skinned character, with its normal and colour.
#include "common.glsl"
#include "skinning.glsl"
in vec3 in_normal;
in vec3 in_color;
out vec3 position;
out vec3 normal;
out vec3 albedo;
uniform float forward;  // 1: as near as can be, for its depth alone
invariant gl_Position;

void main() {
    mat4 skin = skin_matrix();
    position = (skin * vec4(in_position, 1.0)).xyz;
    normal = mat3(skin) * in_normal;
    albedo = in_color;
    gl_Position = view_projection * vec4(position, 1.0);
    if (forward > 0.5) gl_Position.z = -0.9999 * gl_Position.w;
}
