// Hemispherical harmonics on the device, twin of renderers/transport/hemispherical/{basis,brdf_table}.py. Needs HSH_ORDER (>= 1)
// and a function `float hsh_table(int row, int column, int i)` that reads a BRDF table's texel.

const int HSH_COUNT = HSH_ORDER * HSH_ORDER;

// H_i at a unit direction of the local frame; 2 sqrt(mu / (1 + mu)) (d.x + i d.y) has neither a pole nor a cancellation.
void hsh_basis(vec3 d, out float values[HSH_COUNT]) {
    float mu = clamp(d.z, 0.0, 1.0);
    float x = 2.0 * mu - 1.0;
    vec2 turn = 2.0 * sqrt(mu / (1.0 + mu)) * d.xy;
    vec2 power = vec2(1.0, 0.0);
    float first = 0.3989422804;  // 1 / sqrt(2 pi)
    for (int m = 0; m < HSH_ORDER; ++m) {
        if (m > 0) {
            power = vec2(power.x * turn.x - power.y * turn.y, power.x * turn.y + power.y * turn.x);
            first *= -sqrt(float(2 * m + 1) / float(m == 1 ? 1 : 2 * m));  // the sqrt 2 of m != 0 enters at m = 1
        }
        float older = 0.0, newer = first, step = 0.0;
        for (int l = m; l < HSH_ORDER; ++l) {
            if (l > m) {
                float following = sqrt(float(4 * l * l - 1) / float(l * l - m * m));
                float next = following * (x * newer - step * older);
                older = newer;
                newer = next;
                step = 1.0 / following;
            }
            values[l * (l + 1) + m] = power.x * newer;
            if (m > 0) values[l * (l + 1) - m] = power.y * newer;
        }
    }
}

// Lower texel and weight of the upper one on each axis, for a table of size^2 outgoing directions on the paraboloid map.
void hsh_place(vec3 outgoing, int size, out ivec2 corner, out vec2 weight) {
    vec2 uv = 0.5 * (1.0 + outgoing.xy / (outgoing.z + 1.0));
    vec2 place = clamp(uv * float(size) - 0.5, 0.0, float(size - 1));
    corner = min(ivec2(place), ivec2(size - 2));
    weight = place - vec2(corner);
}

// BRDF coefficient i between four texels.
float hsh_coefficient(int i, ivec2 corner, vec2 weight) {
    float upper = mix(hsh_table(corner.y, corner.x, i), hsh_table(corner.y, corner.x + 1, i), weight.x);
    float lower = mix(hsh_table(corner.y + 1, corner.x, i), hsh_table(corner.y + 1, corner.x + 1, i), weight.x);
    return mix(upper, lower, weight.y);
}
