// Images of planes of side² pixels, one after another (renderers/gl/reprojection.py). Invocations are numbered over both axes of the grid.
layout(local_size_x = 64) in;
uniform uint total;  // invocations

uint own_index() {
    return gl_GlobalInvocationID.x + gl_NumWorkGroups.x * 64u * gl_GlobalInvocationID.y;
}
