// How much of the sun reaches a point, from the depth map seen from the sun.

uniform sampler2DShadow shadow_map;

const vec2 DISC[16] = vec2[](
    vec2(-0.942, -0.399), vec2(0.946, -0.769), vec2(-0.094, -0.929), vec2(0.345, 0.294),
    vec2(-0.916, 0.458), vec2(-0.815, -0.879), vec2(-0.383, 0.277), vec2(0.975, 0.756),
    vec2(0.443, -0.975), vec2(0.537, -0.474), vec2(-0.265, -0.419), vec2(0.792, 0.191),
    vec2(-0.242, 0.997), vec2(-0.814, 0.914), vec2(0.200, 0.786), vec2(0.144, -0.141));

float sun_visibility(vec3 world, vec3 normal) {
#if SHADOW_TAPS > 1
    // what receives may cast too: step off the surface by more than a texel, or it shades itself in stripes
    float across = length(vec3(shadow_from_world[0][0], shadow_from_world[1][0], shadow_from_world[2][0]));
    world += normal * 1.5 / (across * float(textureSize(shadow_map, 0).x));
#endif
    vec3 p = (shadow_from_world * vec4(world, 1.0)).xyz;
    vec2 from_middle = abs(p.xy - 0.5);
    float outside = smoothstep(0.42, 0.5, max(from_middle.x, from_middle.y));  // no hard edge where the map ends
#if SHADOW_TAPS == 1
    return max(texture(shadow_map, p), outside);
#else
    float radius = 1.6 / float(textureSize(shadow_map, 0).x);
    float sum = 0.0;
    for (int i = 0; i < 16; ++i) sum += texture(shadow_map, vec3(p.xy + radius * DISC[i], p.z));
    return max(sum / 16.0, outside);
#endif
}
