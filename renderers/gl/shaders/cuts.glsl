// Light of one virtual light within its support. Payload: position, normal and intensity, each with a number of the support's shape
// after it; its ends and more of the shape; the rest (renderers/gl/cuts.py). FAMILY: 0 hat, 1 two hats, 2 ridge, 3 roulette.
uniform float inverse_bound;  // 1 / eps_b, the largest float when eps_b is 0

struct Item {
    vec4 position, normal, intensity;
#if FAMILY < 2
    vec4 ends;
#endif
#if FAMILY == 1
    vec4 more;
    float last;
#endif
};

Item item_at(int index) {
    Item item;
    item.position = payload(index, 0);
    item.normal = payload(index, 1);
    item.intensity = payload(index, 2);
#if FAMILY < 2
    item.ends = payload(index, 3);
#endif
#if FAMILY == 1
    item.more = payload(index, 4);
    item.last = payload(index, 5).x;
#endif
    return item;
}

// A ball of radius d around a receiver bounds α from both sides; see `misses` of transport/supports.py, its twin.
bool misses(Node node, int index) {
    vec3 position = payload(index, 0).xyz, normal = payload(index, 1).xyz, v = node.ball.xyz - position;
    vec2 ends = payload(index, 3).xy;
    float d = length(v), above = dot(normal, v), near = max(0.0, d - node.ball.w), far = d + node.ball.w;
    float lowest = above - node.ball.w;
    bool beyond = near * near * near > ends.y * (above + node.ball.w);
    bool before = lowest > 0.0 && far * far * far < ends.x * lowest;
    return turned_away(node, position, normal) || beyond || before;
}

// cy · clip(min((a - low) · rise, (high - a) · fall), 0, 1) with a = cube / cy, without the division.
float hat(vec4 shape, float cube, float cy) {
    return max(0.0, min(cy, min((cube - shape.x * cy) * shape.y, (shape.z * cy - cube) * shape.w)));
}

// cy · s(cube / cy) over the density of the level.
float weighted(Item item, float cube, float cy) {
#if FAMILY == 3
    float x = cube / max(cy, 1e-12) * item.normal.w;
    float near = min(x, 1.5), flank = max(0.0, near - 0.5);
    return cy * x * clamp(1.5 - item.position.w * x, 0.0, 1.0) / max(near - 0.5 * flank * flank, 1e-30);
#elif FAMILY == 2
    float nu = item.position.w, mid = item.normal.w * log(1.0 + cube / max(cy, 1e-12) * item.intensity.w);
    float low = max(0.0, mid - 1.0);
    float height = nu < mid ? (nu - low) / max(mid - low, 1e-12) : mid + 1.0 - nu;
    return cy * max(0.0, height) / min(1.0, (mid + 1.0) * 0.5);
#else
    float sum = hat(vec4(item.position.w, item.normal.w, item.intensity.w, item.ends.z), cube, cy);
#if FAMILY == 1
    sum = sum * item.more.w + hat(vec4(item.ends.w, item.more.xyz), cube, cy) * item.last;
#endif
    return sum;
#endif
}

vec4 contribution(Receiver receiver, Item item) {
    vec3 v = item.position.xyz - receiver.position;
    float r2 = dot(v, v), safe = max(r2, 1e-18), inverse = inversesqrt(safe), square = inverse * inverse;
    float cx = max(0.0, dot(receiver.normal, v)), cy = max(0.0, -dot(item.normal.xyz, v));
    float g = cx * weighted(item, safe * safe * inverse, cy) * square * min(square, inverse_bound);
    g = r2 > 1e-18 ? g : 0.0;
    return vec4(reflected(receiver, v * inverse) * (g * item.intensity.xyz), g > 0.0 ? 1.0 : 0.0);
}
