// A patch's number comes from here: gl_PrimitiveID is not to be trusted after tessellation on llvmpipe, which counts anew in every batch.
#include "resample.glsl"
flat out uint number_of_patch;

void main() {
    number_of_patch = uint(gl_InstanceID) * GROUP + uint(gl_VertexID) / 3u;
    gl_Position = vec4(0.0);
}
