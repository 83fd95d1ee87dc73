// One decision a part, with the part's own share of the area.
#include "resample.glsl"
layout(triangles) in;
layout(points, max_vertices = 1) out;
flat in uvec2 lattice[];
flat in uint from_patch[];

uint code(uvec2 at) {
    return (at.x << 16) | at.y;
}

uint of_lattice(uvec3 codes, uint key) {
    return number(codes.x, key) ^ number(codes.y, key) ^ number(codes.z, key);
}

// (u, v) of the first corner of a quarter of a quarter of …, and its signed size.
vec3 cell(uint path, uint cuts) {
    vec3 at = vec3(0.0, 0.0, 1.0);
    for (uint k = 0u; k < cuts; ++k) {
        at.z *= 0.5;
        uint digit = (path >> (2u * (cuts - 1u - k))) & 3u;
        if ((digit & 1u) != 0u) at.x += at.z;
        if ((digit & 2u) != 0u) at.y += at.z;
        if (digit == 3u) at.z = -at.z;
    }
    return at;
}

void main() {
    Patch own = patches[from_patch[0]];
    // ascending, so that the point doesn't depend on where the tessellator starts
    uvec3 c = uvec3(code(lattice[0]), code(lattice[1]), code(lattice[2]));
    c = uvec3(min(c.x, min(c.y, c.z)), max(min(c.x, c.y), min(max(c.x, c.y), c.z)), max(c.x, max(c.y, c.z)));
    ivec2 p = ivec2(c.x >> 16, c.x & 0xFFFFu), q = ivec2(c.y >> 16, c.y & 0xFFFFu) - p, r = ivec2(c.z >> 16, c.z & 0xFFFFu) - p;
    int n = int(own.level);
    precise float chance = own.ratio * float(abs(q.x * r.y - q.y * r.x)) / float(9 * n * n);
    uint keep = of_lattice(c, own.keep_number) ^ shift.x;
    if (!kept(keep, carry ? min(chance, 1.0) : chance)) return;
    uint place = of_lattice(c, own.place_number) ^ shift.y;
    vec2 b = placed(place);
    vec3 at = cell(own.path, own.cuts);
    precise vec2 inside = vec2(p) + b.x * vec2(q) + b.y * vec2(r);
    precise vec2 where = at.xy + at.z * (inside / float(3 * n));
    append(own.triangle, uvec2(keep, place), chance, where);
}
