// How much of the sun reaches a point, from the depth map seen from the sun.

uniform sampler2DShadow shadow_map;

const float SOFT = 0.014;  // metres of a soft edge, at least
const int RIM = 4;         // taps around the rim: where they agree the others would too
const vec2 DISC[8] = vec2[](
    vec2(0.924, 0.383), vec2(-0.383, 0.924), vec2(-0.924, -0.383), vec2(0.383, -0.924),
    vec2(0.191, 0.462), vec2(-0.462, 0.191), vec2(-0.191, -0.462), vec2(0.462, -0.191));

float sun_visibility(vec3 world, vec3 normal) {
#if SHADOW_TAPS > 1
    float across = length(vec3(shadow_from_world[0][0], shadow_from_world[1][0], shadow_from_world[2][0]));
    float radius = max(1.6 / float(textureSize(shadow_map, 0).x), SOFT * across);
    // what receives may cast too: step off the surface by nearly as much, or it shades itself in stripes
    world += normal * 0.94 * radius / across;
#endif
    vec3 p = (shadow_from_world * vec4(world, 1.0)).xyz;
    vec2 from_middle = abs(p.xy - 0.5);
    float outside = smoothstep(0.42, 0.5, max(from_middle.x, from_middle.y));  // no hard edge where the map ends
#if SHADOW_TAPS == 1
    return max(texture(shadow_map, p), outside);
#else
    float sum = 0.0;
    for (int i = 0; i < RIM; ++i) sum += texture(shadow_map, vec3(p.xy + radius * DISC[i], p.z));
    int taps = sum == 0.0 || sum == float(RIM) ? RIM : 8;
    for (int i = RIM; i < taps; ++i) sum += texture(shadow_map, vec3(p.xy + radius * DISC[i], p.z));
    return max(sum / float(taps), outside);
#endif
}
