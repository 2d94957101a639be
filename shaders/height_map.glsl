// A vertex of the height map: its place in the grid follows from its number (see viewer/render/terrain_mesh.py).

uniform vec2 grid_origin;   // x, z of row 1, column 1
uniform float grid_cell;    // metres
uniform ivec2 grid_size;    // rows and columns, ring included
uniform float apron;        // metres the ring lies outside
in float in_height;

vec3 grid_position() {
    ivec2 cell = ivec2(gl_VertexID / grid_size.y, gl_VertexID % grid_size.y);
    vec2 inside = vec2(clamp(cell, ivec2(1), grid_size - 2));
    vec2 xz = grid_origin + grid_cell * (inside - 1.0) + apron * (vec2(cell) - inside);
    return vec3(xz.x, in_height, xz.y);
}
