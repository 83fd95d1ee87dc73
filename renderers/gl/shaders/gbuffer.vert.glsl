uniform mat4 clip_matrix;
in vec3 in_position;
in vec3 in_normal;
in vec2 in_uv;
out vec3 world_position;
out vec3 world_normal;
out vec2 uv;

void main() {
    world_position = in_position;
    world_normal = in_normal;
    uv = in_uv;
    gl_Position = clip_matrix * vec4(in_position, 1.0);
}
