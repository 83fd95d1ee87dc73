// One decision a triangle: dropped, one point, or set aside for the tessellator. Draws nothing.
#include "resample.glsl"
layout(triangles) in;
layout(points, max_vertices = 1) out;
in vec3 corner[];
flat in uint vertex[];
flat in uint keep_number[];
uniform uvec2 keys;
uniform float inverse_area;
uniform bool even;

int tessellation_level(float ratio) {
    int n = 1;
    if (even) {
        precise float sixth = ratio / 6.0;
        n = max(2, 2 * int(ceil(sqrt(sixth))));
        while (n > 2 && 1.5 * float((n - 2) * (n - 2)) >= ratio) n -= 2;
        while (1.5 * float(n * n) < ratio) n += 2;
    } else while (float((3 * n * n - n % 2) / 2) < ceil(ratio)) n += 1;
    return clamp(n, 1, 64);
}

// False where there is no room: the triangle then gets one point, with all its weight.
bool set_aside(float ratio, uvec2 own) {
    uint cuts = 0u;
    while (ratio > 6144.0 && cuts < 12u) {
        ratio *= 0.25;
        cuts += 1u;
    }
    uint many = 1u << (2u * cuts);
    uint first = atomicAdd(patch_count, many);
    if (first + many > patch_capacity) return false;
    atomicMax(instance_count, (first + many + GROUP - 1u) / GROUP);
    for (uint path = 0u; path < many; ++path)
        patches[first + path] =
            Patch(uint(gl_PrimitiveIDIn), path, cuts, ratio, number(path, own.x), number(path, own.y), uint(tessellation_level(ratio)), 0u);
    return true;
}

void main() {
    precise vec3 a = corner[1] - corner[0];
    precise vec3 b = corner[2] - corner[0];
    precise vec3 twice = vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
    precise float square = twice.x * twice.x + twice.y * twice.y + twice.z * twice.z;
    precise float ratio = 0.5 * sqrt(square) * inverse_area;
    // Positive and finite, asked of the bits: GLSL lets a compiler treat comparisons with a NaN as it likes.
    uint bits = floatBitsToUint(ratio);
    if (bits == 0u || bits >= 0x7F800000u) return;
    uint own = keep_number[0] ^ keep_number[1] ^ keep_number[2];
    bool large = ratio > 1.0;
    if (!large && !kept(own ^ shift.x, ratio)) return;
    uint place = number(vertex[0], keys.y) ^ number(vertex[1], keys.y) ^ number(vertex[2], keys.y);
    if (large && set_aside(ratio, uvec2(own, place))) return;
    append(uint(gl_PrimitiveIDIn), uvec2(own, place) ^ shift, ratio, placed(place ^ shift.y));
}
