#version 330
// Ground: sun and hemisphere light on steepened slopes, tints by height, darkness in hollows and light on edges,
// a metre grid that keeps its width in perspective, fog.
#include "common.glsl"
#include "grid.glsl"
#include "ground_normal.glsl"
uniform float grid_strength;  // 0 hides the grid
uniform float metres;         // in a unit of the scene, see Terrain.seen_by
uniform vec2 level;           // height of the start in metres, and what a metre above it counts for: -1..1 is full tint
in vec3 position;
in vec3 normal;
in float relief;
out vec4 color;

uniform sampler2D noise;      // patches and grain, 0..1, repeats
uniform float meadow;         // 0: the floor of a studio, 1: grass and earth

// darker and cooler than any skin or mannequin; a floor's relief goes from blue in the hollows to ochre on the heights
const vec3 FLOOR = vec3(0.205, 0.218, 0.226);
const vec3 HIGH_FLOOR = vec3(0.420, 0.330, 0.190);
const vec3 LOW_FLOOR = vec3(0.040, 0.098, 0.130);
const vec3 GRASS = vec3(0.112, 0.148, 0.062);
const vec3 DRY_GRASS = vec3(0.235, 0.216, 0.105);
const vec3 EARTH = vec3(0.185, 0.150, 0.108);
const vec3 LINE = vec3(0.010, 0.014, 0.018);
const float WALL = 0.68;      // of the light on what is too steep to stand on, so that edges read in the sun too
const float STEEPER = 1.7;    // slopes are lit as if they were so much steeper
const float PATCH_M = 11.0;   // that the noise covers before it repeats
const vec2 GRID_M = vec2(5.0, 13.0);        // from the focus on, the grid fades, and is gone

vec3 material(float height) {
    vec2 found = texture(noise, position.xz / PATCH_M).rg;
    float patches = found.r, grain = found.g;
    vec3 even = mix(FLOOR, height > 0.0 ? HIGH_FLOOR : LOW_FLOOR, abs(height)) * (0.955 + 0.09 * grain);
    float dry = smoothstep(0.40, 0.75, 0.75 * patches + 0.35 * height + 0.10);
    vec3 grown = mix(GRASS, DRY_GRASS, dry) * (0.72 + 0.56 * grain);
    grown = mix(grown, EARTH * (0.80 + 0.4 * grain), smoothstep(0.68, 0.84, patches + 0.25 * grain - 0.15));
    return mix(even, grown, meadow);
}

void main() {
    vec3 n = ground_normal(position, normal);
    float stands = mix(WALL, 1.0, smoothstep(0.30, 0.75, n.y));
    n = normalize(n * vec3(STEEPER, 1.0, STEEPER));
    float height = clamp((position.y - level.x) * level.y, -1.0, 1.0);
    vec3 albedo = material(height);
    float away = distance(position.xz, fog.xy);
    float ruled = grid_strength * (1.0 - smoothstep(GRID_M.x, GRID_M.y, away));
    vec2 ruler = position.xz * metres, pixel = pixel_size(ruler);
    if (ruled > 0.0) {
        vec2 lines = metre_grid(ruler, pixel);
        albedo = mix(albedo, LINE, ruled * max(0.38 * lines.x, 0.60 * lines.y));
    }
    float sun = max(dot(n, sun_direction.xyz), 0.0);
    float fogged = fog_amount(position);
    float pool = 1.08 - 0.16 * smoothstep(0.0, fog.z, away);  // brightest where the focus stands
    vec3 light = albedo * (0.50 * ambient_light(n) + 0.98 * sun * SUN_LIGHT) * (stands * pool * (1.0 + relief));
    color = vec4(encode_srgb(mix(light, HORIZON, fogged)), 1.0);
}
