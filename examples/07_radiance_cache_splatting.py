"""One bounce in the Cornell box from some thousand records: the picture, and where the records lie.

Run it from the repository root: `python examples/07_radiance_cache_splatting.py [out.png]`. Left: the image. Right: indirect light
with a dot at every record.
"""

import sys
from collections import Counter

import numpy as np

import renderers
from renderers.frame import Stopwatch
from renderers.images import write_png
from renderers.method import Context
from renderers.methods.rcs import passes_of
from renderers.transport.primary import cast_gbuffer

scene, size = renderers.load_scene("cornell-box"), (256, 256)
method = renderers.get_method("rcs")
settings = method.Settings(a=0.25, rays=1024)
frame = method.render(scene, settings, size=size)
for timing in frame.timings:
    print(f"{timing.name:10s} {timing.wall_s:7.3f} s")
print(f"{frame.counters['records']} records, {frame.counters['rays'] / 1e6:.1f} M rays")

# The same by hand, to see the records.
world, watch, counters = scene.world(), Stopwatch(), Counter[str]()
gbuffer = cast_gbuffer(world, size)
cache = passes_of(world, settings, Context(size, 0, 0, watch), counters).diffuse
canvas = cache.filled(gbuffer, gbuffer.covered, watch, counters)
panel = np.zeros((size[1] * size[0], 3))
panel[canvas.rows] = canvas.irradiance / np.pi
places = {tuple(p) for p in cache.records.position.astype(np.float32).tolist()}
dots = [row for row, p in zip(canvas.rows, canvas.position.tolist(), strict=True) if tuple(p) in places]
panel[dots] = [1.0, 0.2, 0.0]

exposure = 1 / float(np.percentile(frame.layers["beauty"], 98))
out = sys.argv[1] if len(sys.argv) > 1 else "07_radiance_cache_splatting.png"
write_png(out, np.concatenate([frame.layers["beauty"], panel.reshape(size[1], size[0], 3)], axis=1), exposure)
print(f"wrote {out}")
