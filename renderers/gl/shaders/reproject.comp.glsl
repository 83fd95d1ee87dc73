// Draws points into planes of side² pixels and fills holes: one work group a plane, all passes in one dispatch (renderers/gl/reprojection.py).
layout(local_size_x = 256) in;
layout(std430, binding = 4) readonly buffer Points { float points[]; };  // x, y, z in the axes of their plane
layout(std430, binding = 5) coherent buffer Images { uint images[]; };   // of each plane side² depths, then side² words
uniform uint each;  // points of a plane
uniform int side;
uniform float half_width;
const float BEHIND = 1e-6, SNAP = 1e-6;
// a depth is the bits of a positive float, which are ordered as it is; a word is 0, or the number of a point plus 1, with
const uint FILLED = 0x80000000u, PENDING = 0x40000000u;  // PENDING: the rest is the pixel that a hole will be filled from
shared uint found, left;  // whether a pass has filled a hole, and left one

void wait() {
    memoryBarrierBuffer();
    memoryBarrierShared();
    barrier();
}

// Pixel of a point, or -1.
int pixel_of(uint point, out uint depth) {
    vec3 p = vec3(points[3u * point], points[3u * point + 1u], points[3u * point + 2u]);
    depth = floatBitsToUint(p.z);
    if (!(p.z > BEHIND)) return -1;
    vec2 at = floor((p.xy / p.z / half_width + 1.0) * 0.5 * float(side) + SNAP);
    if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(at, vec2(side)))) return -1;
    return int(at.x) * side + int(at.y);
}

// The deepest known of the eight neighbours of a pixel, or -1.
int deepest(int pixel, uint depths, uint words) {
    int best = -1, row = pixel / side, column = pixel % side;
    float far = -1.0;
    for (int dj = -1; dj <= 1; ++dj)
        for (int dk = -1; dk <= 1; ++dk) {
            int j = row + dj, k = column + dk, other = j * side + k;
            if (j < 0 || j >= side || k < 0 || k >= side) continue;
            uint word = images[words + other];
            if (word == 0u || (word & PENDING) != 0u) continue;
            float depth = uintBitsToFloat(images[depths + other]);
            if (depth > far) { far = depth; best = other; }
        }
    return best;
}

void main() {
    uint lane = gl_LocalInvocationID.x, pixels = uint(side * side), first = gl_WorkGroupID.x * each;
    uint depths = gl_WorkGroupID.x * 2u * pixels, words = depths + pixels, depth;
    for (uint p = lane; p < pixels; p += 256u) {
        images[depths + p] = 0xFFFFFFFFu;
        images[words + p] = 0u;
    }
    wait();
    for (uint i = lane; i < each; i += 256u) {
        int pixel = pixel_of(first + i, depth);
        if (pixel >= 0) atomicMin(images[depths + pixel], depth);
    }
    wait();
    for (uint i = lane; i < each; i += 256u) {
        int pixel = pixel_of(first + i, depth);
        // of equally near points the last
        if (pixel >= 0 && images[depths + pixel] == depth) atomicMax(images[words + pixel], i + 1u);
    }
    for (bool again = true; again;) {
        wait();
        if (lane == 0u) found = left = 0u;
        wait();
        for (uint p = lane; p < pixels; p += 256u) {
            if (images[words + p] != 0u) continue;
            int best = deepest(int(p), depths, words);
            if (best < 0) {
                left = 1u;
                continue;
            }
            images[words + p] = PENDING | uint(best);
            found = 1u;
        }
        wait();
        for (uint p = lane; p < pixels; p += 256u) {
            uint word = images[words + p];
            if ((word & PENDING) == 0u) continue;
            uint from = word & ~PENDING;
            images[depths + p] = images[depths + from];
            images[words + p] = images[words + from] | FILLED;
        }
        again = found > 0u && left > 0u;
    }
}
