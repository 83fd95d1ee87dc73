uniform bool parallel;
uniform vec3 origin;  // the light; parallel: unused
uniform vec3 axis;    // unit, the way the light travels
in vec3 world_position;
layout(location = 0) out float distance_;

void main() {
    distance_ = parallel ? dot(world_position, axis) : length(world_position - origin);
}
