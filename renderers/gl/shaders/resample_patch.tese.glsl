// Lattice points as integers: exact whatever the fixed-point rounding of the tessellator.
#include "resample.glsl"
layout(triangles, equal_spacing, ccw) in;
patch in uint patch_index;
flat out uvec2 lattice;
flat out uint from_patch;

void main() {
    from_patch = patch_index;
    lattice = uvec2(gl_TessCoord.yz * float(3u * patches[patch_index].level) + 0.5);
    gl_Position = vec4(0.0);
}
