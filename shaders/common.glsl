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

const vec3 HORIZON = vec3(0.430, 0.490, 0.550);
const vec3 ZENITH = vec3(0.150, 0.240, 0.370);
const vec3 SUN_LIGHT = vec3(1.00, 0.955, 0.88);
const vec3 SKY_LIGHT = vec3(0.66, 0.73, 0.82);
const vec3 GROUND_LIGHT = vec3(0.36, 0.34, 0.32);

vec3 sky_color(vec3 direction) {
    float up = clamp(direction.y, 0.0, 1.0);
    return mix(HORIZON, ZENITH, 1.0 - exp(-2.6 * up));
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
