"""Forward light cuts beside instant radiosity, with the same virtual lights: a fraction of the work, a little more noise.

Run it from the repository root: `python examples/04_forward_light_cuts.py [out.png]`.
"""

import sys

import numpy as np

import renderers
from renderers.images import luminance, write_png

scene = renderers.load_scene("empty-room")
ir, flc = renderers.get_method("ir"), renderers.get_method("flc")
frames = [
    ir.render(scene, ir.Settings(vpls=16384), size=(192, 108)),
    flc.render(scene, flc.Settings(vpls=16384), size=(192, 108)),
    flc.render(scene, flc.Settings(vpls=16384, family="c0", reach=0.56, levels=3, q_n=3, sampler="uniform"), size=(192, 108)),
]
for frame in frames:
    print(", ".join(f"{t.name} {t.wall_s * 1e3:.0f} ms" for t in frame.timings if t.stage == "render"), dict(frame.counters))

# Left to right, indirect light alone: instant radiosity, cuts by roulette, cuts as published.
strip = np.concatenate([frame.layers["indirect"] for frame in frames], axis=1)
out = sys.argv[1] if len(sys.argv) > 1 else "04_forward_light_cuts.png"
write_png(out, strip, exposure=1 / float(np.quantile(luminance(strip), 0.99)))
print(f"wrote {out}")
