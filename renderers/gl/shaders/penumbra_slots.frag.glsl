// Attenuation functions in fixed slots, as published: every slot is read, no search; layout in renderers/transport/penumbra/slots.py.
uniform sampler2D points;       // xyz in the pyramid's frame
uniform usampler2DArray slots;  // per 16 vertices: two layers of depths, one of shares
uniform vec3 grid;              // u_0, v_0, pitch
uniform vec2 range;             // near, far

out float hidden;

float value_at(ivec2 pixel, float z) {
    float value = 0.0;
    vec2 before = vec2(-1.0, 0.0);
    bool found = false;
    for (int group = 0; group < GROUPS; group++)
        for (int k = 0; k < 16; k++) {
            uint pair = texelFetch(slots, ivec3(pixel, 3 * group + k / 8), 0)[(k % 8) / 2];
            uint four = texelFetch(slots, ivec3(pixel, 3 * group + 2), 0)[k / 4];
            vec2 here = vec2(unpackUnorm2x16(pair)[k % 2], unpackUnorm4x8(four)[k % 4]);
            if (!found && here.x >= z) {
                found = true;
                value = before.x < 0.0 ? 0.0 : mix(before.y, here.y, (z - before.x) / (here.x - before.x));
            }
            before = here;
        }
    return found ? value : before.y;
}

void main() {
    vec3 p = texelFetch(points, ivec2(gl_FragCoord.xy), 0).xyz;
    ivec2 size = textureSize(slots, 0).xy;
    vec2 g = (p.xy / p.z - grid.xy) / grid.z;
    hidden = -1.0;
    if (!(p.z >= range.x && p.z <= range.y) || any(lessThan(g, vec2(0.0))) || any(greaterThan(g, vec2(size)))) return;
    float z = (p.z - range.x) / (range.y - range.x);
    vec2 corner = floor(g - 0.5), w = g - 0.5 - corner;
    hidden = 0.0;
    for (int b = 0; b < 2; b++)
        for (int a = 0; a < 2; a++) {
            ivec2 pixel = clamp(ivec2(corner) + ivec2(a, b), ivec2(0), size - 1);
            hidden += (a == 1 ? w.x : 1.0 - w.x) * (b == 1 ? w.y : 1.0 - w.y) * value_at(pixel, z);
        }
    hidden = clamp(hidden, 0.0, 1.0);
}
