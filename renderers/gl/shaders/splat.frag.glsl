// Adds what the snippet's `vec4 contribution(Pixel pixel, int item, vec4 sphere)` says of each pixel inside the item's sphere.
#include "surface.glsl"
#include "brdf.glsl"
layout(std430, binding = 4) readonly buffer Payload { float payload_data[]; };
layout(std430, binding = 5) readonly buffer Spheres { vec4 spheres[]; };
uniform int payload_width;
flat in int item;
layout(location = 0) out vec4 sum;

float payload(int of, int k) {
    return payload_data[of * payload_width + k];
}

#include "snippet.glsl"

void main() {
    Pixel pixel;
    if (!fetch_pixel(ivec2(gl_FragCoord.xy), pixel)) discard;
    vec4 sphere = spheres[item];
    vec3 d = pixel.position - sphere.xyz;
    if (dot(d, d) > sphere.w * sphere.w) discard;
    sum = contribution(pixel, item, sphere);
}
