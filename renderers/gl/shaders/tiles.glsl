// Square groups of pixels with bounds around what they see, and the list of items that may reach each (renderers/gl/splat.py).
struct Node {
    vec4 ball;    // around the positions: centre, radius; the radius is negative where nothing is seen
    vec4 facing;  // around the normals: centre, radius
    float floor;  // least position along the centre of the normals
    int count;    // length of its list
    int unused[2];
};
layout(std430, binding = 4) buffer Nodes { Node nodes[]; };
layout(std430, binding = 5) buffer Lists { int lists[]; };  // `capacity` places a node
uniform int capacity;

// An item has `texels` texels in one row of the map after another: its sphere, then its payload.
uniform sampler2D item_map;
uniform int texels;

vec4 item_texel(int item, int k) {
    int index = item * texels + k;
    return texelFetch(item_map, ivec2(index & 1023, index >> 10), 0);
}

vec4 payload(int item, int k) {
    return item_texel(item, k + 1);
}

// Whether light at a place with a normal is turned away from all of a node, or below the planes of all that the node holds.
// Three products of coordinates of size 1 carry errors of 1e-7 each: so near to the plane, lit or not would be their rounding.
bool turned_away(Node node, vec3 position, vec3 normal) {
    vec3 v = node.ball.xyz - position;
    float far = length(v) + node.ball.w;
    return dot(normal, v) + node.ball.w <= 0.0 || dot(node.facing.xyz, position) - node.floor + node.facing.w * far <= 3e-7;
}
