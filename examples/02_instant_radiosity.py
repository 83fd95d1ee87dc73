"""Instant radiosity: one bounce of light from 2,048 virtual point lights, with and without their shadows.

Run it from the repository root: `python examples/02_instant_radiosity.py [out.png]`.
"""

import sys

import numpy as np

import renderers
from renderers.images import luminance, write_png

scene = renderers.load_scene("cornell-box")
method = renderers.get_method("ir")

frames = [
    method.render(scene, method.Settings(vpls=2048, sampler="low-discrepancy", visibility=visibility), size=(192, 180))
    for visibility in ("none", "raycast")
]
for frame in frames:
    print(", ".join(f"{t.name} {t.wall_s * 1e3:.0f} ms" for t in frame.timings), dict(frame.counters))

# Left to right: direct light alone, with the bounce unoccluded, with the bounce occluded.
strip = np.concatenate([frames[0].layers["direct"], frames[0].layers["beauty"], frames[1].layers["beauty"]], axis=1)
out = sys.argv[1] if len(sys.argv) > 1 else "02_instant_radiosity.png"
write_png(out, strip, exposure=1 / float(np.quantile(luminance(strip), 0.95)))
print(f"wrote {out}")
