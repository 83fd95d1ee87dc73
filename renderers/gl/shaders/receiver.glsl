// What a splat's snippet sees of a pixel. FULL_BRDF is defined when the World has more than Lambert materials.
#include "surface.glsl"
#include "brdf.glsl"
struct Receiver {
    vec3 position;
    vec3 normal;   // shading normal, turned to the viewer
    vec3 base;
    vec3 diffuse;  // base / π
    vec3 view;     // unit, towards the eye
    Material material;
};

// False outside the picture and on the background, whose receiver then faces nothing.
bool fetch_receiver(ivec2 where, out Receiver receiver) {
    Pixel pixel = Pixel(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0, 0.0, 1.0), 0, 0);
    bool seen = all(lessThan(where, textureSize(id_map, 0))) && fetch_pixel(where, pixel);
    receiver = Receiver(pixel.position, pixel.normal, pixel.base, pixel.base / PI, pixel.view, materials[max(pixel.material, 0)]);
    return seen;
}

// f_r towards the eye, light coming from the unit vector l.
vec3 reflected(Receiver receiver, vec3 l) {
#ifdef FULL_BRDF
    return brdf(receiver.material, receiver.base, receiver.normal, receiver.view, l);
#else
    return receiver.diffuse;
#endif
}
