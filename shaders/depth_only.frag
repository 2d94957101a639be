#version 330
// Nothing but depth, for the shadow map.

void main() {}
