// Light of one surfel within its sphere; payload: normal, intensity (renderers/transport/surfels.py).
uniform float inverse_bound;  // 1 / eps_b, the largest float when eps_b is 0

vec4 contribution(Pixel pixel, int item, vec4 sphere) {
    vec3 v = sphere.xyz - pixel.position;
    float r2 = dot(v, v), cx = dot(pixel.normal, v);
    float cy = -dot(vec3(payload(item, 0), payload(item, 1), payload(item, 2)), v);
    if (cx <= 0.0 || cy <= 0.0 || r2 <= 1e-18) return vec4(0.0);
    vec3 light = vec3(payload(item, 3), payload(item, 4), payload(item, 5)) * (cx * cy / r2 * min(1.0 / r2, inverse_bound));
    return vec4(brdf(materials[pixel.material], pixel.base, pixel.normal, pixel.view, v * inversesqrt(r2)) * light, 1.0);
}
