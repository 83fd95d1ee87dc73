"""A Phong ball (exponent 20) under a point light: the analytic BRDF, and its series of order 7 in two bases. Needs no scene.

Run it from the repository root: `python examples/05_hemispherical_harmonics.py [out.png]`. Left to right: analytic, hemispherical
harmonics, spherical harmonics. Both ring where the analytic ball is black, the latter more.
"""

import sys

import numpy as np

from renderers.images import write_png
from renderers.transport.brdf import phong_lobe
from renderers.transport.hemispherical.basis import hemispherical_harmonics, spherical_harmonics
from renderers.transport.hemispherical.models import phong
from renderers.transport.hemispherical.quadrature import hemisphere_quadrature
from renderers.transport.sampling import frame

SIZE, ORDER, EXPONENT = 180, 7, 20.0
brdf = phong(EXPONENT)
to_light = np.array([0.5, 0.6, 0.63]) / np.linalg.norm([0.5, 0.6, 0.63])

# The ball, seen along -z: normals of the covered pixels, and light and eye in the frame of each.
x, y = np.meshgrid(np.linspace(-1.05, 1.05, SIZE), np.linspace(1.05, -1.05, SIZE))
covered = x**2 + y**2 < 0.999
normals = np.stack([x, y, np.sqrt(np.maximum(0, 1 - x**2 - y**2))], axis=-1)[covered]
frames = np.stack([*frame(normals), normals], axis=1)
lights, views = frames @ to_light, frames[:, :, 2]
lit = lights[:, 2] > 0

# A Phong lobe has the same coefficients for all views of one elevation, in a frame whose x axis lies under the view.
quadrature = hemisphere_quadrature(32, 64)
angles = np.linspace(0, np.pi / 2, 256)
lobes = np.stack([brdf(quadrature.directions, np.array([np.sin(a), 0, np.cos(a)])) for a in angles]) * quadrature.weights
level = np.hypot(views[:, 0], views[:, 1])
(c, s), up = views[:, :2].T / np.maximum(level, 1e-12), views[:, 2]
turned = np.stack([c * lights[:, 0] + s * lights[:, 1], c * lights[:, 1] - s * lights[:, 0], np.maximum(lights[:, 2], 0)], axis=1)
place = np.arctan2(level, up) / angles[1]
row = np.minimum(place.astype(int), 254)
share = (place - row)[:, None]

mirrored = np.stack([-level, 0 * level, up], axis=1)
results = [phong_lobe(EXPONENT, (turned * mirrored).sum(axis=1))]
for basis in (hemispherical_harmonics, spherical_harmonics):
    table = lobes @ basis(quadrature.directions, ORDER)
    coefficients = table[row] * (1 - share) + table[row + 1] * share
    results.append((coefficients * basis(turned, ORDER)).sum(axis=1))

exact, panels = results[0], []
for name, values in zip(("analytic", "hemispherical", "spherical"), results, strict=True):
    radiance = np.where(lit, np.maximum(values, 0) * lights[:, 2], 0)
    error = np.sqrt(np.mean((values - exact)[lit] ** 2)) / exact.max()
    print(f"{name:14s} smallest value {values[lit].min() / exact.max():+.3f}, error {error:.4f} of the highlight")
    panel = np.zeros((SIZE, SIZE, 3))
    panel[covered] = radiance[:, None]
    panels.append(panel)
out = sys.argv[1] if len(sys.argv) > 1 else "05_hemispherical_harmonics.png"
write_png(out, np.concatenate(panels, axis=1), exposure=2 / exact.max())
print(f"wrote {out}")
