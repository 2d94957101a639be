#version 330
// Softens stair-stepped edges of a finished frame: blends along the edge that local brightness shows
// (after Lottes, FXAA). For presets without multisampling, and only where the characters are.
uniform sampler2D scene;
uniform vec2 texel;  // one pixel
out vec4 color;

const float SPAN = 6.0;  // pixels
const vec3 LUMA = vec3(0.299, 0.587, 0.114);

vec3 at(vec2 offset) {
    return textureLod(scene, gl_FragCoord.xy * texel + offset * texel, 0.0).rgb;
}

void main() {
    vec3 middle = at(vec2(0.0));
    float nw = dot(at(vec2(-0.5, 0.5)), LUMA);
    float ne = dot(at(vec2(0.5, 0.5)), LUMA);
    float sw = dot(at(vec2(-0.5, -0.5)), LUMA);
    float se = dot(at(vec2(0.5, -0.5)), LUMA);
    float m = dot(middle, LUMA);
    float low = min(m, min(min(nw, ne), min(sw, se)));
    float high = max(m, max(max(nw, ne), max(sw, se)));
    if (high - low < 0.04) {
        color = vec4(middle, 1.0);
        return;
    }

    vec2 along = vec2(sw + se - nw - ne, nw + sw - ne - se);
    along.y = -along.y;
    float shorter = min(abs(along.x), abs(along.y)) + max(0.03 * (nw + ne + sw + se), 0.004);
    along = clamp(along / shorter, -SPAN, SPAN);
    vec3 near = 0.5 * (at(along * (-1.0 / 6.0)) + at(along * (1.0 / 6.0)));
    vec3 far = 0.5 * near + 0.25 * (at(-0.5 * along) + at(0.5 * along));
    float luma = dot(far, LUMA);
    vec3 blended = luma < low || luma > high ? near : far;
    color = vec4(blended, 1.0);
}
