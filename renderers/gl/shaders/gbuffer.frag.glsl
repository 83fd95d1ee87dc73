#include "materials.glsl"
#include "texture.glsl"
uniform vec3 eye;
uniform int first_triangle;
uniform bool textured;
in vec3 world_position;
in vec3 world_normal;
in vec2 uv;
layout(location = 0) out vec4 position;
layout(location = 1) out vec4 normal;
layout(location = 2) out vec4 base;
layout(location = 3) out ivec2 ids;

void main() {
    int triangle = first_triangle + gl_PrimitiveID;
    int material = triangle_material[triangle];
    vec3 n = world_normal;
    // Opposite vertex normals cancel somewhere between them; the plane's own normal stands in there.
    if (dot(n, n) < 1e-12) n = cross(dFdx(world_position), dFdy(world_position));
    n = normalize(n);
    if (dot(n, eye - world_position) < 0.0) n = -n;
    vec3 colour = materials[material].base;
    if (textured) colour *= sample_image(uv);
    position = vec4(world_position, 1.0);
    normal = vec4(n, gl_FrontFacing ? 1.0 : -1.0);
    base = vec4(colour, 1.0);
    ids = ivec2(triangle, material);
}
