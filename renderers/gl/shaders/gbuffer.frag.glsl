#include "materials.glsl"
#include "texture.glsl"
uniform mat4 clip_matrix;
uniform vec4 window;  // of the pixels drawn: lower left corner and size
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

// From where a point of the World falls to the centre of this pixel, in pixels.
vec2 miss(vec3 point) {
    vec4 clip = clip_matrix * vec4(point, 1.0);
    return gl_FragCoord.xy - window.xy - (clip.xy / clip.w * 0.5 + 0.5) * window.zw;
}

// GPUs snap corners to 1/256 of a pixel, and what they interpolate belongs to a place that far from the centre: a step within the
// triangle's plane takes it there. Kept only if it comes nearer: derivatives at a silhouette may reach behind the eye.
vec3 centred(vec3 found) {
    vec2 d = miss(found);
    vec3 moved = found + d.x * dFdx(found) + d.y * dFdy(found);
    vec2 left = miss(moved);
    return dot(left, left) < dot(d, d) ? moved : found;
}

void main() {
    vec3 place = centred(world_position);
    int triangle = first_triangle + gl_PrimitiveID;
    int material = triangle_material[triangle];
    vec3 n = world_normal;
    // Opposite vertex normals cancel somewhere between them; the plane's own normal stands in there.
    if (dot(n, n) < 1e-12) n = cross(dFdx(world_position), dFdy(world_position));
    n = normalize(n);
    if (dot(n, eye - place) < 0.0) n = -n;
    vec3 colour = materials[material].base;
    if (textured) colour *= sample_image(uv);
    position = vec4(place, 1.0);
    normal = vec4(n, gl_FrontFacing ? 1.0 : -1.0);
    base = vec4(colour, 1.0);
    ids = ivec2(triangle, material);
}
