// Light of a reflective shadow map's texels: the samples of a disc around each pixel's own place in the map.
#include "surface.glsl"
#include "brdf.glsl"
layout(std430, binding = 4) readonly buffer Samples { vec4 samples[]; };  // offsets and weight (transport/reflective.py)
uniform int sample_count;
uniform sampler2D map_position;
uniform sampler2D map_normal;
uniform sampler2D map_flux;
uniform int map_tiles;
uniform int map_resolution;
uniform bool map_parallel;
uniform mat3 map_view[6];  // world to tile
uniform vec3 map_origin;
uniform vec2 map_centre;
uniform vec2 map_half;
uniform float inverse_bound;  // 1 / eps_b, the largest float when eps_b is 0
layout(location = 0) out vec4 radiance;

// Unit d and two axes across it (Duff et al. 2017).
mat3 frame_of(vec3 d) {
    d /= sqrt(max(dot(d, d), 1e-20));
    float s = d.z >= 0.0 ? 1.0 : -1.0, a = -1.0 / (s + d.z), b = d.x * d.y * a;
    return mat3(d, vec3(1.0 + s * d.x * d.x * a, s * b, -s * d.x), vec3(b, s + d.y * d.y * a, -d.y));
}

// False outside the map.
bool texel_of(mat3 frame, vec3 own, vec4 s, out ivec2 texel) {
    int tile = 0;
    vec2 at = own.xy + s.yz;
    if (!map_parallel) {
        vec3 d = frame * s.xyz;
        float depth = -1.0;
        for (int k = 0; k < map_tiles; ++k) {
            float z = -(map_view[k] * d).z;
            if (z > depth) { depth = z; tile = k; }
        }
        if (depth <= 0.0) return false;
        at = (map_view[tile] * d).xy / depth;
    }
    texel = ivec2(floor(((at - map_centre) / map_half * 0.5 + 0.5) * float(map_resolution)));
    bool inside = all(greaterThanEqual(texel, ivec2(0))) && all(lessThan(texel, ivec2(map_resolution)));
    texel.y += tile * map_resolution;
    return inside;
}

void main() {
    Pixel pixel;
    if (!fetch_pixel(ivec2(gl_FragCoord.xy), pixel)) discard;
    mat3 frame = frame_of(pixel.position - map_origin);
    vec3 own = map_view[0] * pixel.position, sum = vec3(0.0);
    for (int i = 0; i < sample_count; ++i) {
        ivec2 texel;
        if (!texel_of(frame, own, samples[i], texel)) continue;
        vec3 d = texelFetch(map_position, texel, 0).xyz - pixel.position;
        float r2 = dot(d, d), cx = dot(pixel.normal, d), cy = -dot(texelFetch(map_normal, texel, 0).xyz, d);
        if (cx <= 0.0 || cy <= 0.0 || r2 <= 1e-18) continue;
        float g = samples[i].w / PI * cx * cy / r2 * min(1.0 / r2, inverse_bound);
        vec3 f = brdf(materials[pixel.material], pixel.base, pixel.normal, pixel.view, d * inversesqrt(r2));
        sum += f * g * texelFetch(map_flux, texel, 0).rgb;
    }
    radiance = vec4(sum, 0.0);
}
