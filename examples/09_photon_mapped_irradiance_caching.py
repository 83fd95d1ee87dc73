"""Photon-mapped irradiance caching: the photons shown directly, records made of them, and the same cache from a second camera.

Run it from the repository root: `python examples/09_photon_mapped_irradiance_caching.py [out.png]`.
"""

import sys

import numpy as np

import renderers
from renderers.images import luminance, write_png
from renderers.methods.pmic import PhotonMappedIrradianceCaching
from renderers.scene.world import WorldCamera

SIZE = (240, 180)
scene = renderers.load_scene("cornell-box")
shown, pmic = renderers.get_method("photon-map"), PhotonMappedIrradianceCaching()

direct = shown.render(scene, shown.Settings(photons=400_000), size=SIZE)
camera = scene.world().camera
pose = camera.pose.copy()
pose[:3, 3] += 0.35 * pose[:3, 0] - 0.8 * pose[:3, 2]
cached = pmic.walkthrough(scene, None, [camera, WorldCamera(pose, camera.yfov)], size=SIZE)
for frame in (direct, *cached):
    print(", ".join(f"{t.name} {t.wall_s * 1e3:.0f} ms" for t in frame.timings), dict(frame.counters))

# Left to right: photon map shown directly, records made of the same photons, the same records from another camera.
strip = np.concatenate([frame.layers["beauty"] for frame in (direct, *cached)], axis=1)
out = sys.argv[1] if len(sys.argv) > 1 else "09_photon_mapped_irradiance_caching.png"
write_png(out, strip, exposure=1 / float(np.quantile(luminance(strip), 0.97)))
print(f"wrote {out}")
