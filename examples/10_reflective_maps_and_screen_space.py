"""One bounce, four ways: instant radiosity, reflective shadow maps, directional occlusion in screen space, deep screen space.

Run it from the repository root: `python examples/10_reflective_maps_and_screen_space.py [out.png]`.
"""

import sys

import numpy as np

import renderers
from renderers.images import luminance, write_png

scene = renderers.load_scene("cornell-box")
rows = []
for wide in (False, True):
    # Above: the default reach of each. Below: as wide as it goes.
    reach = {"rsm": 0.5, "ssdo": 1.0, "dss": 2.0} if wide else {}
    row = []
    for name in ("rsm", "ssdo", "dss", "ir"):
        method = renderers.get_method(name)
        settings = method.Settings(vpls=16384) if name == "ir" else method.Settings(**({"radius": reach[name]} if wide else {}))
        frame = method.render(scene, settings, size=(192, 180))
        print(name, ", ".join(f"{t.name} {t.cpu_s * 1e3:.0f} ms" for t in frame.timings if t.stage == "render"))
        row.append(frame.layers["indirect"])
    rows.append(np.concatenate(row, axis=1))

# Left to right: rsm, ssdo, dss, ir; light of the bounce alone.
picture = np.concatenate(rows)
out = sys.argv[1] if len(sys.argv) > 1 else "10_reflective_maps_and_screen_space.png"
write_png(out, picture, exposure=1 / float(np.quantile(luminance(picture), 0.98)))
print(f"wrote {out}")
