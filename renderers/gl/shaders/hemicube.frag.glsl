// The triangle that a texel sees. What lies within the lift of the surface itself is passed over, as rays that start above or below it do.
uniform vec2 skipped;  // heights
in float height;
layout(location = 0) out int triangle;

void main() {
    if (height > skipped.x && height < skipped.y) discard;
    triangle = gl_PrimitiveID;
}
