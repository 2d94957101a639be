#version 330
// The scene, rendered smaller, over the whole frame.
uniform sampler2D scene;
in vec2 ndc;
out vec4 color;

void main() {
    color = vec4(texture(scene, 0.5 + 0.5 * ndc).rgb, 1.0);
}
