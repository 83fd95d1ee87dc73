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

// GPUs snap corners to 1/256 of a pixel, and what they interpolate belongs to a place that far from the centre. How many derivatives
// (within the triangle's plane) lead from it to the centre, by Newton's method; none if that comes no nearer: derivatives at a
// silhouette may reach behind the eye.
vec2 to_centre(vec3 found, mat2x3 per_pixel) {
    vec2 start = miss(found);
    vec2 way = start + miss(found + per_pixel * start);
    vec2 left = miss(found + per_pixel * way);
    return dot(left, left) < dot(start, start) ? way : vec2(0.0);
}

void main() {
    mat2x3 per_pixel = mat2x3(dFdx(world_position), dFdy(world_position));
    vec2 way = to_centre(world_position, per_pixel);
    vec3 place = world_position + per_pixel * way;
    int triangle = first_triangle + gl_PrimitiveID;
    int material = triangle_material[triangle];
    vec3 n = world_normal + mat2x3(dFdx(world_normal), dFdy(world_normal)) * way;
    // Opposite vertex normals cancel somewhere between them; the plane's own normal stands in there.
    if (dot(n, n) < 1e-12) n = cross(per_pixel[0], per_pixel[1]);
    n = normalize(n);
    if (dot(n, eye - place) < 0.0) n = -n;
    vec3 colour = materials[material].base;
    vec2 at = uv + mat2(dFdx(uv), dFdy(uv)) * way;
    if (textured) colour *= sample_image(at);
    position = vec4(place, 1.0);
    normal = vec4(n, gl_FrontFacing ? 1.0 : -1.0);
    base = vec4(colour, 1.0);
    ids = ivec2(triangle, material);
}
