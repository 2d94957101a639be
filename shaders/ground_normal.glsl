// The normal that the ground is lit by: the smooth one, except at creases such as the edge of a step: there the face's.

vec3 ground_normal(vec3 position, vec3 smooth_normal) {
    vec3 face = normalize(cross(dFdy(position), dFdx(position)));
    face = face.y < 0.0 ? -face : face;
    vec3 n = normalize(smooth_normal);
    return normalize(mix(face, n, smoothstep(0.92, 0.985, dot(face, n))));
}
