#version 330
// Softens stair-stepped edges of a finished frame: a pixel takes from its neighbour across the edge what an edge without
// steps would cover of it (after Lottes, FXAA 3). For presets without multisampling, and only where the characters are.
uniform sampler2D scene;
out vec4 color;

const int REACH = 8;  // pixels that an edge is followed each way
const float SUBPIXEL = 0.55;  // of what stands alone, such as a thin line, that is spread out

vec3 at(ivec2 offset) {
    return texelFetch(scene, ivec2(gl_FragCoord.xy) + offset, 0).rgb;
}

// Green stands for brightness: one channel costs less to read than three.
float luma(ivec2 offset) {
    return at(offset).g;
}

// Steps along the edge to its end, and how its brightness differs there.
vec2 end_of_edge(ivec2 along, ivec2 side, float middle, float step_of_edge) {
    int i = 0;
    float differs = 0.0;
    while (i < REACH && abs(differs) < step_of_edge) {
        ++i;
        differs = 0.5 * (luma(i * along) + luma(i * along + side)) - middle;
    }
    return vec2(i, differs);
}

void main() {
    vec3 here = at(ivec2(0));
    float m = here.g;
    float n = luma(ivec2(0, 1)), s = luma(ivec2(0, -1)), e = luma(ivec2(1, 0)), w = luma(ivec2(-1, 0));
    float contrast = max(m, max(max(n, s), max(e, w))) - min(m, min(min(n, s), min(e, w)));
    color = vec4(here, 1.0);
    if (contrast < 0.04) return;

    float ne = luma(ivec2(1, 1)), nw = luma(ivec2(-1, 1)), se = luma(ivec2(1, -1)), sw = luma(ivec2(-1, -1));
    float level = 2.0 * abs(n + s - 2.0 * m) + abs(ne + se - 2.0 * e) + abs(nw + sw - 2.0 * w);
    float upright = 2.0 * abs(e + w - 2.0 * m) + abs(ne + nw - 2.0 * n) + abs(se + sw - 2.0 * s);
    ivec2 along = level >= upright ? ivec2(1, 0) : ivec2(0, 1);
    vec2 across = level >= upright ? vec2(n, s) : vec2(e, w);
    bool first = abs(across.x - m) >= abs(across.y - m);
    float other = first ? across.x : across.y;
    ivec2 side = (first ? 1 : -1) * along.yx;
    float middle = 0.5 * (m + other), step_of_edge = 0.25 * abs(other - m);

    vec2 back = end_of_edge(-along, side, middle, step_of_edge);
    vec2 ahead = end_of_edge(along, side, middle, step_of_edge);
    vec2 nearer = back.x < ahead.x ? back : ahead;
    float share = (nearer.y < 0.0) == (m < middle) ? 0.0 : 0.5 - nearer.x / (back.x + ahead.x);
    float around = (2.0 * (n + s + e + w) + ne + nw + se + sw) / 12.0;
    float alone = smoothstep(0.0, 1.0, clamp(abs(around - m) / contrast, 0.0, 1.0));
    color = vec4(mix(here, at(side), max(share, SUBPIXEL * alone * alone)), 1.0);
}
