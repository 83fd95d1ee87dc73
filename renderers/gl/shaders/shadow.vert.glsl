uniform mat4 clip_matrix;
in vec3 in_position;
out vec3 world_position;

void main() {
    world_position = in_position;
    gl_Position = clip_matrix * vec4(in_position, 1.0);
}
