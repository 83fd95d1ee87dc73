// Bilinear look-up of 8-bit sRGB texels: decoded by table, then filtered with full float weights. Texel centres lie at (i + 0.5) / size.
uniform sampler2D image;
uniform sampler2D srgb;
uniform ivec2 wrap;  // per axis: 0 repeat, 1 clamp, 2 mirror

int wrapped(int i, int n, int mode) {
    if (mode == 1) return clamp(i, 0, n - 1);
    int period = mode == 2 ? 2 * n : n;
    int r = i - period * int(floor(float(i) / float(period)));
    return r < n ? r : period - 1 - r;
}

vec3 texel(ivec2 i, ivec2 size) {
    vec3 stored = texelFetch(image, ivec2(wrapped(i.x, size.x, wrap.x), wrapped(i.y, size.y, wrap.y)), 0).rgb;
    ivec3 code = ivec3(stored * 255.0 + 0.5);
    return vec3(texelFetch(srgb, ivec2(code.r, 0), 0).r, texelFetch(srgb, ivec2(code.g, 0), 0).r, texelFetch(srgb, ivec2(code.b, 0), 0).r);
}

vec3 sample_image(vec2 uv) {
    ivec2 size = textureSize(image, 0);
    vec2 p = uv * vec2(size) - 0.5;
    ivec2 i = ivec2(floor(p));
    vec2 w = p - floor(p);
    vec3 low = mix(texel(i, size), texel(i + ivec2(1, 0), size), w.x);
    vec3 high = mix(texel(i + ivec2(0, 1), size), texel(i + ivec2(1, 1), size), w.x);
    return mix(low, high, w.y);
}
