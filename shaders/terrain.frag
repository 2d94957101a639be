#version 330
// Ground: hemisphere and sun light, a metre grid that keeps its width in perspective, height and slope tints, fog.
#include "common.glsl"
#include "grid.glsl"
#include "ground_normal.glsl"
uniform float grid_strength;  // 0 hides the grid
in vec3 position;
in vec3 normal;
out vec4 color;

const vec3 GROUND = vec3(0.470, 0.485, 0.500);
const vec3 HIGH_GROUND = vec3(0.575, 0.560, 0.530);
const vec3 STEEP_GROUND = vec3(0.440, 0.455, 0.475);
const vec3 LINE = vec3(0.210, 0.250, 0.300);

void main() {
    vec3 n = ground_normal(position, normal);
    vec3 albedo = mix(GROUND, HIGH_GROUND, clamp(position.y * 0.35, -0.5, 1.0));
    albedo = mix(STEEP_GROUND, albedo, smoothstep(0.55, 0.95, n.y));
    vec2 lines = metre_grid(position.xz);
    albedo = mix(albedo, LINE, grid_strength * max(0.45 * lines.x, 0.75 * lines.y));
    float sun = max(dot(n, sun_direction.xyz), 0.0);
    vec3 light = albedo * (0.68 * ambient_light(n) + 0.74 * sun * SUN_LIGHT);
    color = vec4(encode_srgb(mix(light, HORIZON, fog_amount(position))), 1.0);
}
