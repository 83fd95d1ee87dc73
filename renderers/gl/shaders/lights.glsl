// One light sample (renderers/gl/lights.py): irradiance it sends to a facing plane at x, shadows left out.
const int POINT = 0, SPOT = 1, DIRECTIONAL = 2, AREA = 3;
uniform int light_kind;
uniform vec3 light_position;
uniform vec3 light_axis;  // unit, the way the light travels
uniform vec3 light_intensity;
uniform vec2 light_cosines;  // spot: inner, outer

// l: unit, from x to the light.
vec3 incident(vec3 x, out vec3 l) {
    if (light_kind == DIRECTIONAL) {
        l = -light_axis;
        return light_intensity;
    }
    vec3 d = light_position - x;
    float r2 = max(dot(d, d), 1e-20);
    l = d * inversesqrt(r2);
    float cosine = dot(-l, light_axis), shape = 1.0;
    if (light_kind == AREA) shape = max(cosine, 0.0);
    if (light_kind == SPOT) {
        // glTF: squared, linear in the cosine
        shape = clamp((cosine - light_cosines.y) / max(light_cosines.x - light_cosines.y, 1e-6), 0.0, 1.0);
        shape *= shape;
    }
    return light_intensity * (shape / r2);
}
