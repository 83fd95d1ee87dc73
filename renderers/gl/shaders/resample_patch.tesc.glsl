#include "resample.glsl"
layout(vertices = 3) out;
flat in uint number_of_patch[];
patch out uint patch_index;

void main() {
    if (gl_InvocationID != 0) return;
    patch_index = number_of_patch[0];
    // level 0, of the empty places of the last group, culls the patch
    float n = float(patches[patch_index].level);
    gl_TessLevelOuter[0] = gl_TessLevelOuter[1] = gl_TessLevelOuter[2] = gl_TessLevelInner[0] = n;
}
