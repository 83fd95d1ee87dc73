"""Seven frames of a cube that moves through a box: temporal radiance caching against caches of each frame.

Run it from the repository root: `python examples/12_a_sequence.py [out.png]`. Above, in every other frame: the light, and where the
records lie that give it; red ones live for a frame, green ones for twenty. Below: how the error differs from that of the frame
before, which the eye sees as flicker, twenty times amplified; left half of each picture by temporal caching, right half by caches
of each frame. `luxmeter evaluate --frames` does all this for any method and writes a report (docs/sequences.md).
"""

import sys
from itertools import pairwise

import numpy as np

import renderers
from renderers.images import write_png
from renderers.reference import render as reference
from reports.metrics import Pair, flicker, rmse

SIZE, FIRST, LAST, EXPOSURE = (96, 72), 40, 46, 2.0
scene = renderers.load_scene("cube-in-a-box")
method = renderers.get_method("trc")
truth = [reference(scene, "one-bounce", size=SIZE, noise=0.1, frame=n).image for n in range(FIRST, LAST + 1)]
changes, frames = {}, {}
for cache in ("temporal", "per-frame"):
    settings = method.Settings(cache=cache, a=0.2, rays=1024)
    frames[cache] = list(method.render_frames(scene, settings, size=SIZE, frames=(FIRST, LAST)))
    pairs = [Pair(f.layers["beauty"], image, EXPOSURE) for f, image in zip(frames[cache], truth, strict=True)]
    error = [p.test.astype(np.float64) - p.reference for p in pairs]
    changes[cache] = [np.abs(after - before) for before, after in pairwise(error)]
    computed = sum(f.counters["records"] for f in frames[cache])
    seconds = sum(t.cpu_s for f in frames[cache] for t in f.timings if t.stage == "render")
    off, unrest = (np.mean(values) for values in ([rmse(p) for p in pairs], [flicker(a, b) for a, b in pairwise(pairs)]))
    print(f"{cache:10s} {computed:6d} records, {seconds:5.2f} CPU s, RMSE {off:.2f}, flicker {unrest:.3f}")

columns, half = [], SIZE[0] // 2
for k in range(2, LAST - FIRST + 1, 2):
    light, records = (frames["temporal"][k].layers[name] for name in ("beauty", "debug.records"))
    both = np.concatenate([changes["temporal"][k - 1][:, :half], changes["per-frame"][k - 1][:, half:]], axis=1)
    columns.append(np.concatenate([light, records, 20 * both]))
out = sys.argv[1] if len(sys.argv) > 1 else "12_a_sequence.png"
write_png(out, np.concatenate(columns, axis=1).astype(np.float32), EXPOSURE)
print(f"wrote {out}")
