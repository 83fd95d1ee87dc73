// Light of one sample that the surfaces in an atlas of hemicubes reflect to their eyes, shadow-mapped.
#include "surface.glsl"
#include "brdf.glsl"
#include "lights.glsl"
#include "shadow.glsl"
#include "hemicube_texel.glsl"
uniform int stride;  // of stride² texels beside one another, one takes this sample
uniform int turn;    // which
layout(location = 0) out vec4 radiance;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    ivec2 place = at % stride;
    if (place.x + stride * place.y != turn) discard;
    Pixel pixel;
    vec3 start, d;
    if (!fetch_pixel(at, pixel) || !texel_ray(at, start, d)) discard;
    vec3 l;
    vec3 irradiance = incident(pixel.position, l) * max(dot(pixel.normal, l), 0.0);
    if (irradiance == vec3(0.0)) discard;
    irradiance *= visibility(pixel.position, geometric_normal(pixel.triangle));
    radiance = vec4(brdf(materials[pixel.material], pixel.base, pixel.normal, -normalize(d), l) * irradiance * float(stride * stride), 0.0);
}
