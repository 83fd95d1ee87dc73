// The surface that each texel sees, as a G-buffer; light is 0 and 1 / distance. Texels with other textures keep what they have.
#include "surface.glsl"
#include "texture.glsl"
#include "hemicube_texel.glsl"
uniform isampler2D triangle_map;
uniform int texture_index;  // -1: none
uniform float nearest;
layout(location = 0) out vec4 position;
layout(location = 1) out vec4 normal;
layout(location = 2) out vec4 base;
layout(location = 3) out ivec2 ids;
layout(location = 4) out vec4 light;

vec3 vertex_normal(int triangle, int corner) {
    int start = 8 * int(vertex_index[3 * triangle + corner]) + 3;
    return vec3(vertex_data[start], vertex_data[start + 1], vertex_data[start + 2]);
}

vec2 vertex_uv(int triangle, int corner) {
    int start = 8 * int(vertex_index[3 * triangle + corner]) + 6;
    return vec2(vertex_data[start], vertex_data[start + 1]);
}

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec3 start, d;
    int triangle = texelFetch(triangle_map, at, 0).x;
    if (triangle < 0 || !texel_ray(at, start, d)) discard;
    int material = triangle_material[triangle];
    if (materials[material].texture_index != texture_index) discard;
    vec3 a = vertex_position(triangle, 0), e = vertex_position(triangle, 1) - a, f = vertex_position(triangle, 2) - a;
    vec3 p = cross(d, f), away = start - a, q = cross(away, e);
    float facing = dot(e, p);
    float t = dot(f, q) / facing, u = clamp(dot(away, p) / facing, 0.0, 1.0), v = clamp(dot(d, q) / facing, 0.0, 1.0 - u);
    if (facing == 0.0 || !(t > 0.0)) discard;
    vec3 n = (1.0 - u - v) * vertex_normal(triangle, 0) + u * vertex_normal(triangle, 1) + v * vertex_normal(triangle, 2);
    if (dot(n, n) < 1e-12) n = cross(e, f);
    n = normalize(n);
    if (dot(n, d) > 0.0) n = -n;
    vec3 colour = materials[material].base;
    if (texture_index >= 0) {
        vec2 uv = (1.0 - u - v) * vertex_uv(triangle, 0) + u * vertex_uv(triangle, 1) + v * vertex_uv(triangle, 2);
        colour *= sample_image(uv);
    }
    position = vec4(a + u * e + v * f, 1.0);
    normal = vec4(n, 1.0);
    base = vec4(colour, 1.0);
    ids = ivec2(triangle, material);
    light = vec4(0.0, 0.0, 0.0, 1.0 / max(t * length(d), nearest));
}
