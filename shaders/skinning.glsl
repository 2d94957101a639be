// Linear blend skinning by up to 256 joint matrices (rest mesh to world).

layout(std140, row_major) uniform Joints {
    mat4 joint[256];
};
in vec3 in_position;
in uvec4 in_joints;
in vec4 in_weights;

mat4 skin_matrix() {
    return in_weights.x * joint[in_joints.x] + in_weights.y * joint[in_joints.y]
         + in_weights.z * joint[in_joints.z] + in_weights.w * joint[in_joints.w];
}
