// Bounds of square groups of pixels, one invocation a group.
#include "surface.glsl"
#include "tiles.glsl"
layout(local_size_x = 8, local_size_y = 4) in;
uniform int side;
uniform ivec2 grid;
uniform int first;
const float ROUNDING = 1e-5;

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, grid))) return;
    ivec2 start = at * side, end = min(start + side, textureSize(id_map, 0));
    vec3 low = vec3(1e30), high = vec3(-1e30), least = vec3(1e30), most = vec3(-1e30);
    for (int y = start.y; y < end.y; ++y)
        for (int x = start.x; x < end.x; ++x) {
            bool seen = texelFetch(id_map, ivec2(x, y), 0).x >= 0;
            vec3 p = texelFetch(position_map, ivec2(x, y), 0).xyz, n = texelFetch(normal_map, ivec2(x, y), 0).xyz;
            low = seen ? min(low, p) : low;
            high = seen ? max(high, p) : high;
            least = seen ? min(least, n) : least;
            most = seen ? max(most, n) : most;
        }
    vec3 centre = 0.5 * (low + high), facing = 0.5 * (least + most);
    float radius = -1.0, spread = 0.0, lowest = 1e30;
    for (int y = start.y; y < end.y; ++y)
        for (int x = start.x; x < end.x; ++x) {
            bool seen = texelFetch(id_map, ivec2(x, y), 0).x >= 0;
            vec3 p = texelFetch(position_map, ivec2(x, y), 0).xyz, n = texelFetch(normal_map, ivec2(x, y), 0).xyz;
            radius = seen ? max(radius, distance(p, centre) + ROUNDING) : radius;
            spread = seen ? max(spread, distance(n, facing)) : spread;
            lowest = seen ? min(lowest, dot(facing, p)) : lowest;
        }
    nodes[first + at.y * grid.x + at.x] = Node(vec4(centre, radius), vec4(facing, spread), lowest, 0, int[2](0, 0));
}
