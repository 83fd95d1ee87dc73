// Packed attenuation functions at one point per fragment; twin of renderers/transport/penumbra/lookup.py.
uniform sampler2D points;    // xyz in the pyramid's frame
uniform isampler2D index;    // per pixel: first vertex, number of vertices
uniform sampler2D vertices;  // depth and value, one function after another, wrapped to rows of ROW
uniform vec3 grid;           // u_0, v_0, pitch
uniform vec2 range;          // near, far
#ifdef NORMALS
uniform sampler2D normals;  // of the receiving surfaces, on the lit side, pyramid's frame; zeros in free space
uniform float lift;
const float REACH = 2.0, HARDLY = 1e-6;  // as in the kernel
#endif

out float hidden;

vec2 vertex(int k) { return texelFetch(vertices, ivec2(k % ROW, k / ROW), 0).xy; }

float value_at(ivec2 pixel, float z) {
    ivec2 span = texelFetch(index, pixel, 0).xy;
    int first = span.x, last = span.x + span.y, low = first, high = last;
    while (low < high) {
        int middle = (low + high) / 2;
        if (vertex(middle).x >= z) high = middle;
        else low = middle + 1;
    }
    if (low == first) return 0.0;
    vec2 before = vertex(low - 1);
    if (low == last) return before.y;
    vec2 after = vertex(low);
    return mix(before.y, after.y, (z - before.x) / (after.x - before.x));
}

#ifdef NORMALS
// Depth on the ray (uv, 1) where it meets the plane n·X = height, and the ray's weight; within reach of z.
vec2 on_plane(float z, vec3 n, float height, vec2 uv, float reach) {
    float across = dot(n, vec3(uv, 1.0));
    bool away = height >= 0.0;
    if ((across > 0.0) != away || across == 0.0) return away ? vec2(z, HARDLY) : vec2(z + reach, 1.0);
    float meets = height / across;
    if (meets < z - reach) return away ? vec2(z - reach, 1.0) : vec2(meets, HARDLY);
    if (meets > z + reach) return away ? vec2(meets, HARDLY) : vec2(z + reach, 1.0);
    return vec2(meets, 1.0);
}
#endif

void main() {
    vec3 p = texelFetch(points, ivec2(gl_FragCoord.xy), 0).xyz;
    ivec2 size = textureSize(index, 0);
    vec2 g = (p.xy / p.z - grid.xy) / grid.z;
    hidden = -1.0;
    if (!(p.z >= range.x && p.z <= range.y) || any(lessThan(g, vec2(0.0))) || any(greaterThan(g, vec2(size)))) return;
#ifdef BILINEAR
    vec2 corner = floor(g - 0.5), w = g - 0.5 - corner;
    const int taps = 2;
#else
    vec2 corner = floor(g), w = vec2(0.0);
    const int taps = 1;
#endif
#ifdef NORMALS
    vec3 n = texelFetch(normals, ivec2(gl_FragCoord.xy), 0).xyz;
    float reach = REACH * grid.z * p.z, plane = dot(n, p) + lift * (p.z + reach) * (abs(n.x) + abs(n.y));
#endif
    float total = 0.0, weights = 0.0;
    for (int b = 0; b < taps; b++)
        for (int a = 0; a < taps; a++) {
            ivec2 pixel = clamp(ivec2(corner) + ivec2(a, b), ivec2(0), size - 1);
            float weight = (a == 1 ? w.x : 1.0 - w.x) * (b == 1 ? w.y : 1.0 - w.y), z = p.z;
#ifdef NORMALS
            if (n != vec3(0.0)) {
                vec2 at = on_plane(z, n, plane, grid.xy + (vec2(pixel) + 0.5) * grid.z, reach);
                z = clamp(at.x, range.x, range.y);
                weight *= at.y;
            }
#endif
            total += weight * value_at(pixel, z);
            weights += weight;
        }
    hidden = clamp(total / weights, 0.0, 1.0);
}
