#version 330
// Ink within the radius of a stroke, with soft edges.
in vec2 local;
flat in float reach;
flat in vec2 radius;
flat in vec4 ink;
out vec4 color;

void main() {
    float apart = length(local - vec2(0.0, clamp(local.y, 0.0, reach)));
    float soft = 0.75 * fwidth(apart);
    float cover = 1.0 - smoothstep(radius.x - soft, radius.x + soft, apart);
    if (radius.y > 0.0) cover *= smoothstep(radius.y - soft, radius.y + soft, apart);
    color = vec4(ink.rgb, ink.a * cover);
}
