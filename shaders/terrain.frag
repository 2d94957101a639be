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

// darker and cooler than any skin or mannequin, relief from teal in the hollows to ochre on the heights
const vec3 GROUND = vec3(0.146, 0.170, 0.186);
const vec3 HIGH_GROUND = vec3(0.430, 0.325, 0.170);
const vec3 LOW_GROUND = vec3(0.020, 0.078, 0.110);
const vec3 LINE = vec3(0.006, 0.011, 0.018);
const float WALL = 0.68;      // of the light on what is too steep to stand on, so that edges read in the sun too
const float STEEPER = 1.7;  // slopes are lit as if they were so much steeper

void main() {
    vec3 n = ground_normal(position, normal);
    float stands = mix(WALL, 1.0, smoothstep(0.30, 0.75, n.y));
    n = normalize(n * vec3(STEEPER, 1.0, STEEPER));
    float height = clamp((position.y - level.x) * level.y, -1.0, 1.0);
    vec3 albedo = mix(GROUND, height > 0.0 ? HIGH_GROUND : LOW_GROUND, abs(height));
    vec2 lines = metre_grid(position.xz * metres);
    albedo = mix(albedo, LINE, grid_strength * max(0.55 * lines.x, 0.85 * lines.y));
    float sun = max(dot(n, sun_direction.xyz), 0.0);
    float fogged = fog_amount(position);
    float pool = 1.08 - 0.16 * smoothstep(0.0, fog.z, distance(position.xz, fog.xy));  // brightest where the focus stands
    vec3 light = albedo * (0.50 * ambient_light(n) + 0.98 * sun * SUN_LIGHT) * (stands * pool * (1.0 + relief));
    color = vec4(encode_srgb(mix(light, HORIZON, fogged)), 1.0);
}
