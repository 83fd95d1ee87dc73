// Lists of the items that may reach each node, in their order, out of the list of the node's parent; one invocation a node.
#include "receiver.glsl"
#include "tiles.glsl"
layout(local_size_x = 8, local_size_y = 4) in;
uniform ivec2 grid;
uniform int first;
uniform int parents;  // how many stand in a row; 0: all items are tested
uniform int ratio;    // nodes of a parent along each side
uniform int items;

#include "snippet.glsl"

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, grid))) return;
    int own = first + at.y * grid.x + at.x, parent = (at.y / ratio) * parents + at.x / ratio;
    Node node = nodes[own];
    int available = parents == 0 ? items : nodes[parent].count, kept = 0;
    if (node.ball.w < 0.0) available = 0;
    for (int i = 0; i < available; ++i) {
        int item = parents == 0 ? i : lists[parent * capacity + i];
        vec4 sphere = item_texel(item, 0);
        if (distance(sphere.xyz, node.ball.xyz) <= sphere.w + node.ball.w && !misses(node, item)) lists[own * capacity + kept++] = item;
    }
    nodes[own].count = kept;
}
