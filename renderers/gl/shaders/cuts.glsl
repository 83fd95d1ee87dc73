// Light of one virtual light within its support; payload: position, normal, intensity, bounds, shape (transport/cuts.py).
uniform int family;           // 0 hat, 1 two hats, 2 ridge, 3 roulette
uniform float inverse_bound;  // 1 / eps_b, the largest float when eps_b is 0

// cy · clip(min((a - low) · rise, (high - a) · fall), 0, 1) with a = cube / cy, without the division.
float hat(int item, int row, float cube, float cy) {
    float rising = (cube - payload(item, row) * cy) * payload(item, row + 1);
    float falling = (payload(item, row + 2) * cy - cube) * payload(item, row + 3);
    return max(0.0, min(cy, min(rising, falling)));
}

float ridge(int item, float cube, float cy) {
    float nu = payload(item, 11);
    float mid = payload(item, 12) * log(1.0 + cube / max(cy, 1e-12) * payload(item, 13));
    float low = max(0.0, mid - 1.0);
    float height = nu < mid ? (nu - low) / max(mid - low, 1e-12) : mid + 1.0 - nu;
    return cy * max(0.0, height) / min(1.0, (mid + 1.0) * 0.5);
}

float roulette(int item, float cube, float cy) {
    float x = cube / max(cy, 1e-12) * payload(item, 12);
    float near = min(x, 1.5);
    float flank = max(0.0, near - 0.5);
    return cy * x * clamp(1.5 - payload(item, 11) * x, 0.0, 1.0) / max(near - 0.5 * flank * flank, 1e-30);
}

vec4 contribution(Pixel pixel, int item, vec4 sphere) {
    vec3 v = vec3(payload(item, 0), payload(item, 1), payload(item, 2)) - pixel.position;
    float r2 = dot(v, v);
    float cx = dot(pixel.normal, v);
    float cy = -dot(vec3(payload(item, 3), payload(item, 4), payload(item, 5)), v);
    if (cx <= 0.0 || cy <= 0.0 || r2 <= 1e-18) return vec4(0.0);
    float cube = r2 * sqrt(r2);
    float weighted;
    if (family == 3) weighted = roulette(item, cube, cy);
    else if (family == 2) weighted = ridge(item, cube, cy);
    else {
        weighted = hat(item, 11, cube, cy);
        if (family == 1) weighted = weighted * payload(item, 19) + hat(item, 15, cube, cy) * payload(item, 20);
    }
    if (weighted <= 0.0) return vec4(0.0);
    float g = cx * weighted / r2 * min(1.0 / r2, inverse_bound);
    vec3 intensity = vec3(payload(item, 6), payload(item, 7), payload(item, 8));
    return vec4(brdf(materials[pixel.material], pixel.base, pixel.normal, pixel.view, v * inversesqrt(r2)) * g * intensity, 1.0);
}
