// What an irradiance record says about a pixel, and with which weight; twin of renderers/transport/caching/{splat_kernels,weights}.py.
// Payload: normal and radius; irradiance; then for each channel the gradients of translation, and of rotation (renderers/gl/caching.py).
// KIND: 0 ward, 1 shifted, 2 tent. GRADIENTS is defined where they are used.
uniform float accuracy;
const float HALF = 0.70710678118654752, CAP = 1e-3, RIM = 1e-6;

struct Item {
    vec4 sphere;
    vec4 normal;  // and radius
    vec3 irradiance;
#ifdef GRADIENTS
    vec3 translation[3];
    vec3 rotation[3];
#endif
};

Item item_at(int index) {
    Item item;
    item.sphere = item_texel(index, 0);
    item.normal = payload(index, 0);
    item.irradiance = payload(index, 1).xyz;
#ifdef GRADIENTS
    for (int c = 0; c < 3; ++c) {
        item.translation[c] = payload(index, 2 + c).xyz;
        item.rotation[c] = payload(index, 5 + c).xyz;
    }
#endif
    return item;
}

bool misses(Node node, int index) {
    return (distance(node.facing.xyz, payload(index, 0).xyz) - node.facing.w) * HALF > accuracy;
}

// 0 outside the zone, ahead = (distance / R, normal term).
float weight_of(vec2 ahead) {
    float e = ahead.x + ahead.y, ward = 1.0 / max(e, CAP);
#if KIND == 2
    float most = max(ahead.x, ahead.y);
    return most <= accuracy ? max(1.0 - most / accuracy, RIM) : 0.0;
#elif KIND == 1
    return e > accuracy ? 0.0 : max(ward - 1.0 / accuracy, RIM);
#else
    return e > accuracy ? 0.0 : ward;
#endif
}

vec4 contribution(Receiver receiver, Item item) {
    vec3 d = receiver.position - item.sphere.xyz;
    float reach = accuracy * item.normal.w, square = dot(d, d);
    float w = square > reach * reach ? 0.0 : weight_of(vec2(sqrt(square) / item.normal.w, distance(receiver.normal, item.normal.xyz) * HALF));
    vec3 value = item.irradiance;
#ifdef GRADIENTS
    vec3 turn = cross(item.normal.xyz, receiver.normal);
    for (int c = 0; c < 3; ++c) value[c] += dot(turn, item.rotation[c]) + dot(d, item.translation[c]);
    value = max(value, 0.0);
#endif
    return vec4(w * value, w);
}
