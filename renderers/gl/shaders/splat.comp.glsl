// Adds to each pixel what the snippet's `vec4 contribution(Receiver receiver, Item item)` says of the items in its tile's list.
// An invocation holds a column of a tile, so that an item is fetched once for eight pixels.
#include "receiver.glsl"
#include "tiles.glsl"
layout(local_size_x = 8, local_size_y = 4) in;
layout(rgba32f, binding = 0) uniform image2D sums;
uniform ivec2 grid;
uniform int first;
#define EACH(F) F(0) F(1) F(2) F(3) F(4) F(5) F(6) F(7)

#include "snippet.glsl"

void main() {
    ivec2 at = ivec2(gl_WorkGroupID.x, gl_GlobalInvocationID.y);
    if (any(greaterThanEqual(at, grid))) return;
    int tile = first + at.y * grid.x + at.x, count = nodes[tile].count;
    if (count == 0) return;
    ivec2 corner = at * 8 + ivec2(gl_LocalInvocationID.x, 0);
    Receiver receiver[8];
    bool seen[8];
    vec4 sum[8];
#define LOAD(k) seen[k] = fetch_receiver(corner + ivec2(0, k), receiver[k]); sum[k] = imageLoad(sums, corner + ivec2(0, k));
    EACH(LOAD)
    for (int i = 0; i < count; ++i) {
        Item item = item_at(lists[tile * capacity + i]);
#define ADD(k) sum[k] += contribution(receiver[k], item);
        EACH(ADD)
    }
#define STORE(k) if (seen[k]) imageStore(sums, corner + ivec2(0, k), sum[k]);
    EACH(STORE)
}
