// Fills each hole with the deepest of its eight neighbours, all holes at once; counts those that have no neighbour yet.
#include "reprojection.glsl"
layout(std430, binding = 4) readonly buffer DepthsBefore { uint depths[]; };
layout(std430, binding = 5) readonly buffer SourcesBefore { int sources[]; };
layout(std430, binding = 6) writeonly buffer DepthsAfter { uint filled_depths[]; };
layout(std430, binding = 7) buffer SourcesAfter { uint left; int filled_sources[]; };
uniform int side;

void main() {
    uint index = own_index();
    if (index >= total) return;
    int image = int(index) / (side * side) * side * side, row = int(index) % (side * side) / side, column = int(index) % side;
    int best = int(index);
    if (sources[index] < 0) {
        float far = -1.0;
        for (int dj = -1; dj <= 1; ++dj)
            for (int dk = -1; dk <= 1; ++dk) {
                int j = row + dj, k = column + dk, other = image + j * side + k;
                if (j < 0 || j >= side || k < 0 || k >= side || sources[other] < 0) continue;
                float depth = uintBitsToFloat(depths[other]);
                if (depth > far) { far = depth; best = other; }
            }
        if (best == int(index)) atomicAdd(left, 1u);
    }
    filled_depths[index] = depths[best];
    filled_sources[index] = sources[best];
}
