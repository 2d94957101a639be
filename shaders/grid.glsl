// Anti-aliased grid lines of constant width in metres, never thinner than a pixel but paler instead
// (after Ben Golus, "The Best Darn Grid Shader (Yet)").

const float MINOR_WIDTH = 0.008;  // of the 1 m cell
const float MAJOR_WIDTH = 0.0035;  // of the 5 m cell

float grid_lines(vec2 uv, vec2 pixel, float width) {
    vec2 drawn = clamp(vec2(width), pixel, vec2(0.5));
    vec2 edge = 1.5 * pixel;
    vec2 toward_line = abs(fract(uv - 0.5) - 0.5);
    vec2 lines = 1.0 - smoothstep(drawn - edge, drawn + edge, toward_line);
    lines *= clamp(width / drawn, 0.0, 1.0);
    // where a cell is smaller than a pixel the lines melt into their average
    lines = mix(lines, vec2(width), clamp(2.0 * pixel - 1.0, 0.0, 1.0));
    return lines.x + lines.y - lines.x * lines.y;
}

// How much of a place a pixel covers, along both axes.
vec2 pixel_size(vec2 xz) {
    vec2 dx = dFdx(xz);
    vec2 dy = dFdy(xz);
    return sqrt(dx * dx + dy * dy);
}

// Strength of the 1 m lines and of the 5 m lines.
vec2 metre_grid(vec2 xz, vec2 pixel) {
    return vec2(grid_lines(xz, pixel, MINOR_WIDTH), grid_lines(xz * 0.2, pixel * 0.2, MAJOR_WIDTH));
}
