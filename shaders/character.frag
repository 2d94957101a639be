#version 330
// Soft key light that wraps round the form, sky and ground light, a fill from over the eye's left shoulder that gives form
// to backs against the sun, a rim where the sun grazes; bright surfaces keep their form: light above the knee is compressed.
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
    vec3 to_eye = normalize(camera_position.xyz - position);
    vec3 n = normalize(normal);
    n *= dot(n, to_eye) < -0.2 ? -1.0 : 1.0;  // of open clothes the inside shows
    float facing = max(dot(n, to_eye), 0.0);
    float key = clamp((dot(n, sun_direction.xyz) + 0.35) / 1.35, 0.0, 1.0);
    key *= key;
#if SELF_SHADOW
    key *= mix(0.25, 1.0, sun_visibility(position, n));
#endif
    vec3 base = mix(albedo, tint.rgb, tint.a);
    float fill = max(dot(n, normalize(to_eye - 0.9 * camera_right.xyz + vec3(0.0, 0.45, 0.0))), 0.0);
    vec3 light = base * (0.34 * ambient_light(n) + 0.95 * key * SUN_LIGHT + 0.36 * fill * fill);
    vec3 halfway = normalize(to_eye + sun_direction.xyz);
    float gloss = max(dot(n, halfway), 0.0);
    gloss *= gloss; gloss *= gloss; gloss *= gloss; gloss *= gloss;
    float rim = (1.0 - facing) * (1.0 - facing);
    rim *= (1.0 - facing) * (0.15 + key);
    light += (0.06 * gloss + 0.30 * rim * (0.25 + base)) * SUN_LIGHT;
    color = vec4(encode_srgb(mix(compress(light), HORIZON, fog_amount(position))), opacity);
}
