#version 330
// The sky behind everything, by the direction of the view.
#include "common.glsl"
in vec2 ndc;
out vec4 color;

void main() {
    vec3 ray = camera_forward.xyz + ndc.x * camera_right.xyz + ndc.y * camera_up.xyz;
    float grain = fract(52.98 * fract(dot(gl_FragCoord.xy, vec2(0.0671, 0.00584)))) - 0.5;  // or a clear sky has bands
    color = vec4(encode_srgb(sky_color(normalize(ray))) + grain / 255.0, 1.0);
}
