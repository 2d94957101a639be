#version 330
// Multiplied onto the ground: the darkness close under one character, its body and its feet.
#include "common.glsl"
const int MARKS = 3;
uniform vec4 heel[MARKS];  // ankle's sole point, and radius in metres
uniform vec4 toe[MARKS];   // toe's sole point, and strength
in vec3 position;
out vec4 color;

void main() {
    float open = 1.0;
    for (int i = 0; i < MARKS; ++i) {
        vec3 along = toe[i].xyz - heel[i].xyz;
        vec3 from_heel = position - heel[i].xyz;
        float t = clamp(dot(from_heel, along) / max(dot(along, along), 1e-6), 0.0, 1.0);
        vec3 apart = (from_heel - t * along) / heel[i].w;
        float near = max(1.0 - dot(apart, apart), 0.0);
        open *= 1.0 - toe[i].w * near * near;
    }
    color = vec4(vec3(mix(open, 1.0, fog_amount(position))), 1.0);
}
