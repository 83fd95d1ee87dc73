// The G-buffer as later passes read it, and the World's triangles.
#include "materials.glsl"
layout(std430, binding = 2) readonly buffer Vertices { float vertex_data[]; };  // position, normal, uv: 8 floats a vertex
layout(std430, binding = 3) readonly buffer Indices { uint vertex_index[]; };
uniform sampler2D position_map;
uniform sampler2D normal_map;
uniform sampler2D base_map;
uniform isampler2D id_map;
uniform vec3 eye;

struct Pixel {
    vec3 position;
    vec3 normal;  // shading normal, turned to the viewer
    vec3 base;
    vec3 view;    // unit, towards the eye
    int triangle;
    int material;
};

// False on the background.
bool fetch_pixel(ivec2 where, out Pixel pixel) {
    ivec2 ids = texelFetch(id_map, where, 0).xy;
    if (ids.x < 0) return false;
    vec3 position = texelFetch(position_map, where, 0).xyz;
    pixel = Pixel(position, texelFetch(normal_map, where, 0).xyz, texelFetch(base_map, where, 0).rgb, normalize(eye - position), ids.x, ids.y);
    return true;
}

vec3 vertex_position(int triangle, int corner) {
    int start = 8 * int(vertex_index[3 * triangle + corner]);
    return vec3(vertex_data[start], vertex_data[start + 1], vertex_data[start + 2]);
}

vec3 geometric_normal(int triangle) {
    vec3 a = vertex_position(triangle, 0);
    return normalize(cross(vertex_position(triangle, 1) - a, vertex_position(triangle, 2) - a));
}
