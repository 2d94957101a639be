#version 330
// A straight stroke with round ends, or a dot where both ends meet: on the ground in metres, or facing the eye in pixels.
#include "common.glsl"
in vec3 in_start;
in vec3 in_end;
in vec3 in_normal;   // of the ground
in vec2 in_radius;   // outer, and that of the hole in the middle (0: none)
in vec4 in_color;    // sRGB, opacity
out vec2 local;      // across and along, from the start
flat out float reach;
flat out vec2 radius;
flat out vec4 ink;

const float LIFT = 0.010;    // metres over the ground
const float NEARER = 4e-4;   // of the depth range

void main() {
    vec2 corner = vec2((gl_VertexID & 1) * 2 - 1, gl_VertexID >> 1);
    radius = in_radius;
    ink = in_color;
#if ON_GROUND
    float pad = in_radius.x * 1.2;
    vec3 helper = abs(in_normal.x) < 0.9 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 0.0, 1.0);
    vec3 along = in_end - in_start;
    reach = length(along);
    along = reach > 1e-4 ? along / reach : normalize(cross(helper, in_normal));
    local = vec2(corner.x * pad, mix(-pad, reach + pad, corner.y));
    vec3 place = in_start + local.x * cross(in_normal, along) + local.y * along + LIFT * in_normal;
    gl_Position = view_projection * vec4(place, 1.0);
    gl_Position.z -= NEARER * gl_Position.w;
#else
    float pad = in_radius.x + 1.0;
    vec4 a = view_projection * vec4(in_start, 1.0);
    vec4 b = view_projection * vec4(in_end, 1.0);
    vec2 from = a.xy / a.w * 0.5 * viewport.xy;
    vec2 along = b.xy / b.w * 0.5 * viewport.xy - from;
    reach = length(along);
    along = reach > 1e-2 ? along / reach : vec2(0.0, 1.0);
    local = vec2(corner.x * pad, mix(-pad, reach + pad, corner.y));
    vec2 place = from + local.x * vec2(along.y, -along.x) + local.y * along;
    bool behind = min(a.w, b.w) < 0.05;
    gl_Position = behind ? vec4(2.0, 2.0, 2.0, 1.0) : vec4(place * 2.0 * viewport.zw, -1.0, 1.0);
#endif
}
