// Light of one sample reflected to the eye, shadow-mapped.
#include "surface.glsl"
#include "brdf.glsl"
#include "lights.glsl"
#include "shadow.glsl"
layout(location = 0) out vec4 radiance;

void main() {
    Pixel pixel;
    if (!fetch_pixel(ivec2(gl_FragCoord.xy), pixel)) discard;
    vec3 l;
    vec3 irradiance = incident(pixel.position, l) * max(dot(pixel.normal, l), 0.0);
    if (irradiance == vec3(0.0)) discard;
    irradiance *= visibility(pixel.position, geometric_normal(pixel.triangle));
    radiance = vec4(brdf(materials[pixel.material], pixel.base, pixel.normal, pixel.view, l) * irradiance, 0.0);
}
