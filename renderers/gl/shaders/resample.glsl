// Numbers, decisions and output of point resampling; twin of transport/resampling/{numbers,kernels}.py, operation by operation.
struct Point {
    uint triangle;
    uint keep_number;
    uint place_number;
    float chance;
    float weight;
    float u;  // weight of the second corner
    float v;  // of the third
    float unused;
};

// A large triangle, or a quarter of a quarter of … of one, that the tessellator cuts up.
struct Patch {
    uint triangle;
    uint path;  // base-4 digits: which quarter at each step, 3 the middle one
    uint cuts;
    float ratio;
    uint keep_number;
    uint place_number;
    uint level;
    uint unused;
};

layout(std430, binding = 6) buffer Points { uint point_count; uint point_capacity; uint padding[6]; Point points[]; };
// The first four words are the indirect draw of the second pass, in instances of GROUP patches (renderers/gl/resample.py).
layout(std430, binding = 7) buffer Patches {
    uint vertex_count; uint instance_count; uint first_vertex; uint first_instance;
    uint patch_count; uint patch_capacity; uint padding_2[2]; Patch patches[];
};
uniform uvec2 shift;
uniform bool carry;

uint mixed(uint x) {
    x = (x ^ (x >> 16)) * 0x7FEB352Du;
    x = (x ^ (x >> 15)) * 0x846CA68Bu;
    return x ^ (x >> 16);
}

uint number(uint index, uint key) {
    return mixed(mixed(index) ^ key);
}

// As integers, so that small probabilities keep their digits.
bool kept(uint value, float chance) {
    return chance >= 1.0 || value < uint(chance * 4294967296.0);
}

vec2 placed(uint value) {
    precise vec2 b = (vec2(value & 0xFFFFu, value >> 16) + 0.5) * (1.0 / 65536.0);
    return b.x + b.y >= 1.0 ? 1.0 - b : b;
}

// The count runs on past the capacity; the caller then draws again with more room.
void append(uint triangle, uvec2 numbers, float ratio, vec2 where) {
    uint i = atomicAdd(point_count, 1u);
    if (i >= point_capacity) return;
    float chance = carry ? min(ratio, 1.0) : ratio;
    float weight = carry ? max(ratio, 1.0) : 1.0;
    points[i] = Point(triangle, numbers.x, numbers.y, chance, weight, where.x, where.y, 0.0);
}
