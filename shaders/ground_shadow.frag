#version 330
// Multiplied onto the ground: the sun's shadow.
#include "common.glsl"
#include "ground_normal.glsl"
#include "shadow.glsl"
in vec3 position;
in vec3 normal;
out vec4 color;

const vec3 SHADOW = vec3(0.56, 0.60, 0.66);  // what is left of the light, in sRGB

void main() {
    vec3 n = ground_normal(position, normal);
    float lit = sun_visibility(position, n);
    float facing = smoothstep(0.0, 0.25, dot(n, sun_direction.xyz));
    vec3 shade = mix(SHADOW, vec3(1.0), mix(1.0, lit, facing));
    color = vec4(mix(shade, vec3(1.0), fog_amount(position)), 1.0);
}
