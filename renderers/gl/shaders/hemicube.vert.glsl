// One face of one hemicube an instance, drawn into its own rectangle of the atlas (renderers/gl/hemicube.py).
uniform vec2 scale;     // half a face's side, in clip space of the atlas
uniform bool zero_to_one;
uniform float near;
in vec3 in_position;
in vec3 in_eye;
in vec3 in_right;
in vec3 in_up;
in vec3 in_forward;
in vec3 in_lift;        // unit, the way the eye was lifted off its surface
in vec3 in_place;       // middle of the face in the atlas; -1 for a whole face, 0 for its upper half
out float height;       // above the eye's plane
out float gl_ClipDistance[4];

void main() {
    // the difference first: its digits are those of the World's coordinates
    vec3 d = in_position - in_eye;
    vec3 q = vec3(dot(d, in_right), dot(d, in_up), dot(d, in_forward));
    height = dot(d, in_lift);
    gl_ClipDistance[0] = q.z + q.x;
    gl_ClipDistance[1] = q.z - q.x;
    gl_ClipDistance[2] = q.z - q.y;
    gl_ClipDistance[3] = q.y - in_place.z * q.z;
    gl_Position = vec4(scale * q.xy + in_place.xy * q.z, zero_to_one ? near : 2.0 * near - q.z, q.z);
}
