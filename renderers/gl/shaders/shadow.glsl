// Shadow-map look-up; the policy is written down in renderers/gl/shadow.py.
uniform sampler2D shadow_map;    // tiles on top of one another
uniform int shadow_tiles;
uniform int shadow_resolution;   // texels along a tile's side
uniform bool shadow_parallel;
uniform mat3 shadow_view[6];     // world to tile; a tile looks along -Z
uniform vec3 shadow_origin;      // perspective: the light
uniform vec2 shadow_centre;      // parallel: middle and half extent of the tile in x and y
uniform vec2 shadow_half;        // perspective: tangents of the half angle
uniform float shadow_offset;     // normal offset in texels
uniform int shadow_taps;         // PCF: (2 taps + 1)² texels; 0 is the hard test
const float ROUNDING = 1e-5;     // of the scene size: positions and distances are float32, off by some 1e-6

// Tile whose axis is nearest to d.
int shadow_tile(vec3 d) {
    int best = 0;
    float depth = -1e30;
    for (int k = 0; k < shadow_tiles; ++k) {
        float z = -(shadow_view[k] * d).z;
        if (z > depth) { depth = z; best = k; }
    }
    return best;
}

// Distance at which the ray through the texel's centre meets the receiver's plane, p and g in tile space.
float receiver_distance(vec3 p, vec3 g, vec2 s, float own, float footprint) {
    float receiver;
    if (shadow_parallel) {
        float across = dot(g.xy, shadow_centre + s * shadow_half - p.xy);
        receiver = abs(g.z) > 1e-6 ? across / g.z - p.z : own;
    } else {
        vec3 c = vec3(s * shadow_half, -1.0);
        float facing = dot(g, c);
        receiver = abs(facing) > 1e-6 ? dot(g, p) / facing * length(c) : own;
    }
    return clamp(receiver, own - 40.0 * footprint, own + 40.0 * footprint);
}

// Share of the light's rays that reach x, whose geometric normal is g (either side).
float visibility(vec3 x, vec3 g) {
    vec3 d = shadow_parallel ? x : x - shadow_origin;
    int tile = shadow_tile(d);
    vec3 p = shadow_view[tile] * d;
    vec3 n = shadow_view[tile] * g;
    float scale = shadow_parallel ? 1.0 : -p.z;
    float footprint = 2.0 * max(shadow_half.x, shadow_half.y) / float(shadow_resolution) * scale;
    // towards the light: -p when it shines from a point, +Z when it is parallel
    float side = shadow_parallel ? n.z : -dot(n, p);
    p += n * (side < 0.0 ? -1.0 : 1.0) * shadow_offset * footprint;
    scale = shadow_parallel ? 1.0 : max(-p.z, 1e-9);
    float own = shadow_parallel ? -p.z : length(p);
    vec2 s = (p.xy / scale - (shadow_parallel ? shadow_centre : vec2(0.0))) / shadow_half;
    ivec2 texel = ivec2(floor((s * 0.5 + 0.5) * float(shadow_resolution)));
    float lit = 0.0;
    for (int j = -shadow_taps; j <= shadow_taps; ++j) {
        for (int i = -shadow_taps; i <= shadow_taps; ++i) {
            ivec2 t = clamp(texel + ivec2(i, j), ivec2(0), ivec2(shadow_resolution - 1));
            vec2 centre = (vec2(t) + 0.5) / float(shadow_resolution) * 2.0 - 1.0;
            float stored = texelFetch(shadow_map, t + ivec2(0, tile * shadow_resolution), 0).r;
            lit += stored >= receiver_distance(p, n, centre, own, footprint) - ROUNDING ? 1.0 : 0.0;
        }
    }
    return lit / float((2 * shadow_taps + 1) * (2 * shadow_taps + 1));
}
