// One quad an item: the exact bounds of its sphere on the screen, wherever the sphere lies around the camera.
layout(std430, binding = 5) readonly buffer Spheres { vec4 spheres[]; };  // centre, radius; world space
uniform mat4 view_matrix;
uniform vec2 tangents;  // of the half angles; y negative, as the picture stands upside down
uniform vec2 shift;     // sub-pixel shift in clip space
uniform vec2 pixel;     // one pixel in clip space
flat out int item;

// Interval of a sphere's projection x / depth on one axis; everything when it reaches behind the eye's plane.
vec2 interval(float x, float depth, float radius) {
    float t2 = x * x + depth * depth - radius * radius;
    if (depth <= radius || t2 <= 0.0) return vec2(-1e30, 1e30);
    float t = sqrt(t2);
    return vec2((x * t - radius * depth) / (depth * t + radius * x), (x * t + radius * depth) / (depth * t - radius * x));
}

void main() {
    item = gl_InstanceID;
    vec4 sphere = spheres[item];
    vec3 centre = (view_matrix * vec4(sphere.xyz, 1.0)).xyz;
    vec2 x = interval(centre.x, -centre.z, sphere.w) / tangents.x + shift.x;
    vec2 y = interval(centre.y, -centre.z, sphere.w) / tangents.y + shift.y;
    // a pixel more on each side makes up for rounding here and in the rasteriser; the fragment tests the sphere exactly
    vec2 low = clamp(vec2(min(x.x, x.y), min(y.x, y.y)) - pixel, -1.0, 1.0);
    vec2 high = clamp(vec2(max(x.x, x.y), max(y.x, y.y)) + pixel, -1.0, 1.0);
    if (-centre.z + sphere.w < 0.0) high = low;  // behind the eye altogether
    vec2 corner = mix(low, high, vec2(gl_VertexID & 1, gl_VertexID >> 1));
    gl_Position = vec4(corner, 0.0, 1.0);
}
