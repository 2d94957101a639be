#version 330
// The sky behind everything, by the direction of the view.
#include "common.glsl"
in vec2 ndc;
out vec4 color;

void main() {
    vec3 ray = camera_forward.xyz + ndc.x * camera_right.xyz + ndc.y * camera_up.xyz;
    color = vec4(encode_srgb(sky_color(normalize(ray))), 1.0);
}
