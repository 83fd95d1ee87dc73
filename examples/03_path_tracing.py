"""Path-trace the Cornell box, and compare with a reference whose noise is known. Writes path_tracing.png and reference.png."""

import renderers
import renderers.reference
from renderers.images import luminance, write_png

scene = renderers.load_scene("cornell-box")
pt = renderers.get_method("pt")
frame = pt.render(scene, pt.Settings(spp=64), size=(320, 180), seed=1)
truth = renderers.reference.render(scene, "full", size=(320, 180), noise=0.02)
exposure = renderers.reference.exposure(truth)
write_png("path_tracing.png", frame.layers["beauty"], exposure)
write_png("reference.png", truth.image, exposure)

low, high = truth.interval()
y = luminance(frame.layers["beauty"])
outside = ((y < low) | (y > high))[truth.surface].mean()
print(f"reference: {truth.n} replicates of {truth.spp} paths a pixel, noise {truth.noise:.3%}")
print(f"path tracing with 64 paths: {outside:.0%} of the pixels lie outside the reference's 95 % intervals")
