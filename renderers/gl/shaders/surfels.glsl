// Light of one surfel within its sphere; payload: normal, intensity (renderers/transport/surfels.py).
uniform float inverse_bound;  // 1 / eps_b, the largest float when eps_b is 0

struct Item {
    vec4 sphere;
    vec3 normal, intensity;
};

Item item_at(int index) {
    return Item(item_texel(index, 0), payload(index, 0).xyz, payload(index, 1).xyz);
}

bool misses(Node node, int index) {
    return turned_away(node, item_texel(index, 0).xyz, payload(index, 0).xyz);
}

vec4 contribution(Receiver receiver, Item item) {
    vec3 v = item.sphere.xyz - receiver.position;
    float r2 = dot(v, v), inverse = inversesqrt(max(r2, 1e-18)), square = inverse * inverse;
    float cx = max(0.0, dot(receiver.normal, v)), cy = max(0.0, -dot(item.normal, v));
    float g = r2 > 1e-18 && r2 <= item.sphere.w * item.sphere.w ? cx * cy * square * min(square, inverse_bound) : 0.0;
    return vec4(reflected(receiver, v * inverse) * (g * item.intensity), g > 0.0 ? 1.0 : 0.0);
}
