// Screen-space directional occlusion: light of the open sky, or (BOUNCE) of the surfaces that block it.
#include "surface.glsl"
#include "brdf.glsl"
layout(std430, binding = 4) readonly buffer Pattern { vec4 pattern[]; };  // direction about +Z, share of the radius
uniform int sample_count;
uniform int side;
uniform float radius;
uniform float bias;
uniform mat3 world_to_camera;
uniform vec2 scale;   // pixels per tangent
uniform vec2 middle;  // of the picture, in pixels
uniform vec2 offset;  // of the sample in its pixel
#ifdef BOUNCE
uniform sampler2D sent_map;
uniform float eps_b;
uniform float area;
#else
uniform sampler2D sky_map;
uniform bool sky_image;
uniform vec3 sky_radiance;
uniform mat3 world_to_sky;
#endif
layout(location = 0) out vec4 radiance;

// Columns: two axes across the unit normal, and the normal itself (Duff et al. 2017).
mat3 frame_of(vec3 n) {
    float s = n.z >= 0.0 ? 1.0 : -1.0, a = -1.0 / (s + n.z), b = n.x * n.y * a;
    return mat3(vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3(b, s + n.y * n.y * a, -n.y), n);
}

// Whether a surface seen in the sample's own pixel lies before it; `seen` is that pixel.
bool blocked(Pixel own, vec3 point, out ivec2 seen) {
    vec3 at = world_to_camera * (point - eye);
    seen = ivec2(floor(at.xy / -at.z * scale + middle + 0.5 - offset));
    if (at.z >= 0.0 || any(lessThan(seen, ivec2(0))) || any(greaterThanEqual(seen, textureSize(id_map, 0)))) return false;
    if (texelFetch(id_map, seen, 0).x < 0) return false;
    vec3 q = texelFetch(position_map, seen, 0).xyz;
    vec3 way = q - own.position;
    return (world_to_camera * (q - eye)).z > at.z && dot(way, own.normal) > bias * length(way);
}

#ifndef BOUNCE
vec3 sky_texel(int column, int row, ivec2 size) {
    return texelFetch(sky_map, ivec2(column % size.x, row), 0).rgb;
}

// renderers/scene/environment.py
vec3 sky_light(vec3 direction) {
    if (!sky_image) return sky_radiance;
    ivec2 size = textureSize(sky_map, 0);
    vec3 d = world_to_sky * direction;
    float x = mod(atan(d.x, -d.z) / (2.0 * PI) * float(size.x) - 0.5, float(size.x));
    float y = acos(clamp(d.y, -1.0, 1.0)) / PI * float(size.y - 1);
    int column = int(x) % size.x, row = min(int(y), size.y - 2);
    vec3 upper = mix(sky_texel(column, row, size), sky_texel(column + 1, row, size), fract(x));
    vec3 lower = mix(sky_texel(column, row + 1, size), sky_texel(column + 1, row + 1, size), fract(x));
    return mix(upper, lower, y - float(row)) * sky_radiance;
}
#endif

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy);
    Pixel pixel;
    if (!fetch_pixel(here, pixel)) discard;
    Material m = materials[pixel.material];
    mat3 frame = frame_of(pixel.normal);
    int first = ((here.y % side) * side + here.x % side) * sample_count;
    vec3 sum = vec3(0.0);
    for (int i = 0; i < sample_count; ++i) {
        vec4 local = pattern[first + i];
        vec3 direction = frame * local.xyz;
        ivec2 seen;
        bool hit = blocked(pixel, pixel.position + direction * (local.w * radius), seen);
#ifdef BOUNCE
        if (!hit) continue;
        vec3 way = texelFetch(position_map, seen, 0).xyz - pixel.position;
        float r2 = max(dot(way, way), 1e-18);
        vec3 light = way * inversesqrt(r2);
        float cosines = max(dot(pixel.normal, light), 0.0) * max(-dot(texelFetch(normal_map, seen, 0).xyz, light), 0.0);
        if (cosines <= 0.0) continue;
        sum += brdf(m, pixel.base, pixel.normal, pixel.view, light) * texelFetch(sent_map, seen, 0).rgb * (cosines / max(r2, eps_b) * area);
#else
        if (!hit) sum += brdf(m, pixel.base, pixel.normal, pixel.view, direction) * sky_light(direction) * (local.z * 2.0 * PI / float(sample_count));
#endif
    }
    radiance = vec4(sum, 0.0);
}
