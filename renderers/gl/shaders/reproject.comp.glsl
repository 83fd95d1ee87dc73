// Draws points as pixels: first the least depth of each, then the last of the points that have it.
#include "reprojection.glsl"
layout(std430, binding = 4) readonly buffer Points { vec4 points[]; };  // in the axes u, v, n of their plane
layout(std430, binding = 5) buffer Depths { uint depths[]; };           // bits of a positive float: ordered as it is
layout(std430, binding = 6) buffer Sources { int sources[]; };
uniform uint each;    // points of a plane
uniform int side;
uniform float half_width;
uniform bool choose;  // the second time
const float BEHIND = 1e-6, SNAP = 1e-6;

void main() {
    uint index = own_index();
    if (index >= total) return;
    vec3 p = points[index].xyz;
    if (!(p.z > BEHIND)) return;
    vec2 at = floor((p.xy / p.z / half_width + 1.0) * 0.5 * float(side) + SNAP);
    if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(at, vec2(side)))) return;
    uint pixel = (index / each) * uint(side * side) + uint(at.y) * uint(side) + uint(at.x), depth = floatBitsToUint(p.z);
    if (!choose) atomicMin(depths[pixel], depth);
    else if (depths[pixel] == depth) atomicMax(sources[pixel], int(index % each));
}
