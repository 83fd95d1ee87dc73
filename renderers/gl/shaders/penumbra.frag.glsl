// Packed attenuation functions at one point per fragment; twin of renderers/transport/penumbra/lookup.py.
uniform sampler2D points;    // xyz in the pyramid's frame
uniform isampler2D index;    // per pixel: first vertex, number of vertices
uniform sampler2D vertices;  // depth and value, one function after another, wrapped to rows of ROW
uniform vec3 grid;           // u_0, v_0, pitch
uniform vec2 range;          // near, far

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

void main() {
    vec3 p = texelFetch(points, ivec2(gl_FragCoord.xy), 0).xyz;
    ivec2 size = textureSize(index, 0);
    vec2 g = (p.xy / p.z - grid.xy) / grid.z;
    hidden = -1.0;
    if (!(p.z >= range.x && p.z <= range.y) || any(lessThan(g, vec2(0.0))) || any(greaterThan(g, vec2(size)))) return;
#ifdef BILINEAR
    vec2 corner = floor(g - 0.5), w = g - 0.5 - corner;
    hidden = 0.0;
    for (int b = 0; b < 2; b++)
        for (int a = 0; a < 2; a++) {
            ivec2 pixel = clamp(ivec2(corner) + ivec2(a, b), ivec2(0), size - 1);
            hidden += (a == 1 ? w.x : 1.0 - w.x) * (b == 1 ? w.y : 1.0 - w.y) * value_at(pixel, p.z);
        }
    hidden = clamp(hidden, 0.0, 1.0);
#else
    hidden = value_at(min(ivec2(g), size - 1), p.z);
#endif
}
