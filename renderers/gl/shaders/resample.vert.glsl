#include "resample.glsl"
uniform uvec2 keys;
in vec3 in_position;
out vec3 corner;
flat out uint vertex;
flat out uint keep_number;

void main() {
    corner = in_position;
    vertex = uint(gl_VertexID);
    keep_number = number(vertex, keys.x);
    gl_Position = vec4(0.0);
}
