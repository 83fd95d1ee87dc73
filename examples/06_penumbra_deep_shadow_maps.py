"""Penumbra deep shadow maps: the soft shadow of a rectangle light beside that of one shadow map and that of shadow rays.

Run it from the repository root: `python examples/06_penumbra_deep_shadow_maps.py [out.png]`.
"""

import sys

import numpy as np

import renderers
from renderers.images import luminance, write_png

scene = renderers.load_scene("cornell-box", light="area")
settings = {
    "shadow-map": {},
    "pdsm": {"samples": 64, "resolution": 192, "map_resolution": 192},
    "ray-cast-area-light": {"samples": 64},
}

strips = []
for name, values in settings.items():
    method = renderers.get_method(name)
    frame = method.render(scene, method.Settings(**values), size=(192, 180))
    print(name, ", ".join(f"{t.name} {t.wall_s * 1e3:.0f} ms" for t in frame.timings), dict(frame.counters))
    strips.append(frame.layers["beauty"])

# Left to right: one hard shadow, attenuation functions of 64 light points, shadow rays to the same points.
strip = np.concatenate(strips, axis=1)
out = sys.argv[1] if len(sys.argv) > 1 else "06_penumbra_deep_shadow_maps.png"
write_png(out, strip, exposure=1 / float(np.quantile(luminance(strip), 0.95)))
print(f"wrote {out}")
