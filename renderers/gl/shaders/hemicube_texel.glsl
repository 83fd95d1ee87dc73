// Where a texel of the atlas looks from and to. Faces as in renderers/transport/caching/cube.py.
struct Eye {
    vec4 position;
    vec4 axes[3];  // two tangents, normal
};
layout(std430, binding = 6) readonly buffer Eyes { Eye eyes[]; };
uniform int size;     // texels along a face's side
uniform int columns;  // hemicubes in a row of the atlas
uniform int count;

// False beyond the last hemicube. d: not unit.
bool texel_ray(ivec2 at, out vec3 eye, out vec3 d) {
    int record = at.x / size + columns * (at.y / (3 * size)), row = at.y % (3 * size), side = (row - size) / (size / 2);
    eye = vec3(0.0);
    d = vec3(0.0, 0.0, 1.0);
    if (at.x >= columns * size || record >= count) return false;
    float x = (float(at.x % size) + 0.5) * 2.0 / float(size) - 1.0;
    if (row < size)
        d = vec3(x, (float(row) + 0.5) * 2.0 / float(size) - 1.0, 1.0);
    else {
        float up = (float((row - size) % (size / 2)) + 0.5) * 2.0 / float(size);
        if (side == 0) d = vec3(1.0, x, up);
        else if (side == 1) d = vec3(-x, 1.0, up);
        else if (side == 2) d = vec3(-1.0, -x, up);
        else d = vec3(x, -1.0, up);
    }
    eye = eyes[record].position.xyz;
    d = mat3(eyes[record].axes[0].xyz, eyes[record].axes[1].xyz, eyes[record].axes[2].xyz) * d;
    return true;
}
