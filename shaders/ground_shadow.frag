#version 330
// Multiplied onto the ground: the sun's shadow, and the darkness close under feet and bodies.
#include "common.glsl"
#include "ground_normal.glsl"
#include "shadow.glsl"
const int MAX_FEET = 32;
uniform int foot_count;
uniform vec4 foot_heel[MAX_FEET];  // ankle's sole point, and radius in metres
uniform vec4 foot_toe[MAX_FEET];   // toe's sole point, and strength
in vec3 position;
in vec3 normal;
out vec4 color;

const vec3 SHADOW = vec3(0.56, 0.60, 0.66);  // what is left of the light, in sRGB

float occlusion() {
    float open = 1.0;
    for (int i = 0; i < foot_count; ++i) {
        vec3 along = foot_toe[i].xyz - foot_heel[i].xyz;
        vec3 from_heel = position - foot_heel[i].xyz;
        float t = clamp(dot(from_heel, along) / max(dot(along, along), 1e-6), 0.0, 1.0);
        vec3 apart = (from_heel - t * along) / foot_heel[i].w;
        float near = max(1.0 - dot(apart, apart), 0.0);
        open *= 1.0 - foot_toe[i].w * near * near;
    }
    return open;
}

void main() {
    vec3 n = ground_normal(position, normal);
    float lit = sun_visibility(position, n);
    float facing = smoothstep(0.0, 0.25, dot(n, sun_direction.xyz));
    vec3 shade = mix(SHADOW, vec3(1.0), mix(1.0, lit, facing)) * occlusion();
    color = vec4(mix(shade, vec3(1.0), fog_amount(position)), 1.0);
}
