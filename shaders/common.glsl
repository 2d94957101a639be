// What every pass shares: the frame's constants, the studio's light and colours, and their encoding.
// Lengths in metres, colours linear until encode_srgb.

layout(std140, row_major) uniform Frame {
    mat4 view_projection;
    mat4 shadow_from_world;
    vec4 camera_position;
    vec4 camera_right;    // half the view's width at distance 1
    vec4 camera_up;       // half its height
    vec4 camera_forward;
    vec4 sun_direction;   // towards the sun
    vec4 viewport;        // width, height in pixels, and their inverses
    vec4 fog;             // focus x, focus z, radius where it begins, radius where all is fog
};

const vec3 HORIZON = vec3(0.560, 0.640, 0.700);
const vec3 ZENITH = vec3(0.095, 0.215, 0.440);
const vec3 GLOW = vec3(0.300, 0.200, 0.090);  // of the air around the sun
const vec3 SUN_LIGHT = vec3(1.06, 0.975, 0.85);
const vec3 SKY_LIGHT = vec3(0.66, 0.73, 0.82);
const vec3 GROUND_LIGHT = vec3(0.36, 0.34, 0.32);

vec3 sky_color(vec3 direction) {
    float up = clamp(direction.y, 0.0, 1.0);
    float near = max(dot(direction, sun_direction.xyz), 0.0);
    float glow = near * near * near;
    vec3 air = mix(HORIZON, ZENITH, 1.0 - exp(-3.4 * up)) + glow * glow * GLOW;
    return mix(air, vec3(1.6, 1.5, 1.3), smoothstep(0.9990, 0.9996, near));  // the sun, twice as wide as it is
}

// Light from above and from below, before the sun.
vec3 ambient_light(vec3 normal) {
    float down = 0.5 - 0.5 * normal.y;
    return mix(SKY_LIGHT, GROUND_LIGHT, down * down);
}

// The ground fades into the horizon around the focus, not around the eye: a distant camera still sees its subject.
float fog_amount(vec3 position) {
    float t = clamp((distance(position.xz, fog.xy) - fog.z) / (fog.w - fog.z), 0.0, 1.0);
    return t * (2.0 - t);
}

// Linear to sRGB within 0.002, without a power function (software rendering pays for each).
vec3 encode_srgb(vec3 linear) {
    vec3 s1 = sqrt(clamp(linear, 0.0, 1.0));
    vec3 s2 = sqrt(s1);
    vec3 s3 = sqrt(s2);
    return 0.585122381 * s1 + 0.783140355 * s2 - 0.368262736 * s3;
}
