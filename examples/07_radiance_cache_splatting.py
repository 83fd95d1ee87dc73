"""One bounce in the Cornell box from some thousand records: the picture, and where the records lie.

Run it from the repository root: `python examples/07_radiance_cache_splatting.py [out.png]`. Left: the image. Right: indirect light
with a dot at every record.
"""

import sys
from collections import Counter

import numpy as np

import renderers
from renderers.images import write_png
from renderers.methods.rcs import placement_of, samplers_of
from renderers.transport.caching.placement import fill
from renderers.transport.caching.records import Sites
from renderers.transport.caching.splat import Canvas
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer

scene, size = renderers.load_scene("cornell-box"), (256, 256)
method = renderers.get_method("rcs")
settings = method.Settings(a=0.25, rays=1024)
frame = method.render(scene, settings, size=size)
for timing in frame.timings:
    print(f"{timing.name:10s} {timing.wall_s:7.3f} s")
print(f"{frame.counters['records']} records, {frame.counters['rays'] / 1e6:.1f} M rays")

# The same by hand, to see the records.
world = scene.world()
gbuffer = cast_gbuffer(world, size)
canvas = Canvas.of(gbuffer)
sites = Sites(*receivers_of(world, gbuffer, canvas.rows))
records = fill(canvas, sites, *samplers_of(world, settings, 0, Counter()), placement_of(settings, 0))
panel = np.zeros((size[1] * size[0], 3))
panel[canvas.rows] = canvas.irradiance / np.pi
places = {tuple(p) for p in records.position.astype(np.float32).tolist()}
dots = [row for row, p in zip(canvas.rows, canvas.position.tolist(), strict=True) if tuple(p) in places]
panel[dots] = [1.0, 0.2, 0.0]

exposure = 1 / float(np.percentile(frame.layers["beauty"], 98))
out = sys.argv[1] if len(sys.argv) > 1 else "07_radiance_cache_splatting.png"
write_png(out, np.concatenate([frame.layers["beauty"], panel.reshape(size[1], size[0], 3)], axis=1), exposure)
print(f"wrote {out}")
