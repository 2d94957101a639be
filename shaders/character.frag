#version 330
// Soft key light that wraps round the form, sky and ground light, a fill from the eye, a rim against the background;
// bright surfaces keep their form: light above the knee is compressed.
#include "common.glsl"
#include "shadow.glsl"
uniform vec4 tint;  // colour to mix in, and how much of it
uniform float opacity;
in vec3 position;
in vec3 normal;
in vec3 albedo;
out vec4 color;

const float KNEE = 0.55;  // linear

vec3 compress(vec3 light) {
    vec3 above = max(light - KNEE, 0.0);
    return min(light, KNEE) + (1.0 - KNEE) * above / (above + (1.0 - KNEE));
}

void main() {
    vec3 n = normalize(normal);
    vec3 to_eye = normalize(camera_position.xyz - position);
    float facing = max(dot(n, to_eye), 0.0);
    float key = clamp((dot(n, sun_direction.xyz) + 0.35) / 1.35, 0.0, 1.0);
    key *= key;
#if SELF_SHADOW
    key *= mix(0.25, 1.0, sun_visibility(position, n));
#endif
    vec3 base = mix(albedo, tint.rgb, tint.a);
    vec3 light = base * (0.42 * ambient_light(n) + 0.95 * key * SUN_LIGHT + 0.16 * facing * SUN_LIGHT);
    vec3 halfway = normalize(to_eye + sun_direction.xyz);
    float gloss = max(dot(n, halfway), 0.0);
    gloss *= gloss; gloss *= gloss; gloss *= gloss; gloss *= gloss;
    float rim = (1.0 - facing) * (1.0 - facing);
    rim *= rim * (0.5 + 0.5 * n.y);
    light += 0.06 * gloss * SUN_LIGHT + 0.40 * rim * SKY_LIGHT;
    color = vec4(encode_srgb(mix(compress(light), HORIZON, fog_amount(position))), opacity);
}
