// f_r of every material kind; n turned to the viewer, v and l unit, n·l > 0. `base` is base colour × texture.
#include "materials.glsl"
const float PI = 3.14159265358979324;

// Normalised Phong (Lafortune & Willems 1994).
vec3 phong(Material m, vec3 base, vec3 n, vec3 v, vec3 l) {
    float c = max(dot(2.0 * dot(n, l) * n - l, v), 0.0);
    float lobe = m.exponent == 0.0 ? 1.0 : c > 0.0 ? pow(c, m.exponent) : 0.0;
    return base / PI + m.specular * ((m.exponent + 2.0) / (2.0 * PI) * lobe);
}

// glTF 2.0 Appendix B; (n·h)²(α²-1)+1 is written as |n×h|² + α²(n·h)², which keeps its digits at small α.
vec3 ggx(Material m, vec3 base, vec3 n, vec3 v, vec3 l) {
    vec3 h = normalize(l + v);
    float nl = dot(n, l), nv = abs(dot(n, v)), nh = dot(n, h), a2 = m.alpha * m.alpha;
    vec3 nxh = cross(n, h);
    float d = dot(nxh, nxh) + a2 * nh * nh;
    float D = a2 / (PI * d * d);
    float vis = 0.5 / max(nl * sqrt(nv * nv * (1.0 - a2) + a2) + nv * sqrt(nl * nl * (1.0 - a2) + a2), 1e-12);
    float k = 1.0 - abs(dot(v, h)), k2 = k * k;
    vec3 f0 = mix(vec3(0.04), base, m.metallic);
    vec3 F = f0 + (1.0 - f0) * (k2 * k2 * k);
    return (1.0 - F) * (base * (1.0 - m.metallic) / PI) + F * (D * vis);
}

vec3 brdf(Material m, vec3 base, vec3 n, vec3 v, vec3 l) {
    if (m.kind == PHONG) return phong(m, base, n, v, l);
    if (m.kind == GGX) return ggx(m, base, n, v, l);
    return base / PI;
}
