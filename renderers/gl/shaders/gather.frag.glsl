// Sum over a batch of virtual point lights; FULL_BRDF is defined when the World has more than Lambert materials.
#include "surface.glsl"
#include "brdf.glsl"
struct PointLight {
    vec3 position;
    float red;
    vec3 normal;
    float green;
    vec3 unused;
    float blue;
};
layout(std140) uniform Lights { PointLight lights[BATCH]; };
uniform int count;
uniform float inverse_bound;  // 1 / eps_b, the largest float when eps_b is 0
layout(location = 0) out vec4 radiance;

void main() {
    Pixel pixel;
    if (!fetch_pixel(ivec2(gl_FragCoord.xy), pixel)) discard;
    vec3 sum = vec3(0.0);
#ifdef FULL_BRDF
    Material m = materials[pixel.material];
#endif
    for (int i = 0; i < count; ++i) {
        vec3 d = lights[i].position - pixel.position;
        float r2 = dot(d, d);
        float inverse = r2 < 1e-20 ? 0.0 : 1.0 / r2;
        // (n_x·l) / r and (-n_y·l) · r / max(eps_b, r²), with one division
        float weight = max(dot(pixel.normal, d), 0.0) * inverse * max(-dot(lights[i].normal, d), 0.0) * min(inverse, inverse_bound);
        vec3 light = vec3(lights[i].red, lights[i].green, lights[i].blue) * weight;
#ifdef FULL_BRDF
        if (weight > 0.0) sum += brdf(m, pixel.base, pixel.normal, pixel.view, d * sqrt(inverse)) * light;
#else
        sum += light;
#endif
    }
#ifndef FULL_BRDF
    sum *= pixel.base / PI;
#endif
    radiance = vec4(sum, 0.0);
}
