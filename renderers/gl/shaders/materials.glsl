// The World's material table; rows are written by renderers/gl/upload.py.
const int LAMBERT = 0, PHONG = 1, GGX = 2;

struct Material {
    vec3 base;
    int kind;
    vec3 specular;
    float exponent;
    vec3 emission;
    int emits_both;
    float metallic;
    float alpha;
    int texture_index;
    int unused;
};

layout(std430, binding = 0) readonly buffer Materials { Material materials[]; };
layout(std430, binding = 1) readonly buffer TriangleMaterial { int triangle_material[]; };
