"""A Phong ball (exponent 20) under a point light: the analytic BRDF, and its series of order 7 in two bases. Needs no scene.

Run it from the repository root: `python examples/05_hemispherical_harmonics.py [out.png]`. Left to right: analytic, hemispherical
harmonics, spherical harmonics. The latter ring: a faint second highlight and a lit rim, where the analytic ball is black.
"""

import sys

import numpy as np

from renderers.images import write_png
from renderers.transport.hemispherical.basis import hemispherical_harmonics, spherical_harmonics
from renderers.transport.hemispherical.models import phong
from renderers.transport.hemispherical.quadrature import hemisphere_quadrature
from renderers.transport.sampling import frame

SIZE, ORDER = 180, 7
brdf = phong(20.0)
to_light = np.array([0.5, 0.6, 0.63]) / np.linalg.norm([0.5, 0.6, 0.63])

# The ball, seen along -z: normals of the covered pixels, and light and eye in the frame of each.
x, y = np.meshgrid(np.linspace(-1.05, 1.05, SIZE), np.linspace(1.05, -1.05, SIZE))
covered = x**2 + y**2 < 0.999
normals = np.stack([x, y, np.sqrt(np.maximum(0, 1 - x**2 - y**2))], axis=-1)[covered]
frames = np.stack([*frame(normals), normals], axis=1)
lights, views = frames @ to_light, frames[:, :, 2]
lit = lights[:, 2] > 0

# Coefficients depend on the elevation of the view alone, so a frame that turns with the view needs one row for each elevation.
quadrature = hemisphere_quadrature(32, 64)
elevations = np.linspace(0, 1, 128)
outgoing = np.stack([np.sqrt(1 - elevations**2), 0 * elevations, elevations], axis=1)
lobes = np.stack([brdf(quadrature.directions, view) for view in outgoing])
azimuth = np.arctan2(views[:, 1], views[:, 0])
turned = np.stack(
    [
        lights[:, 0] * np.cos(azimuth) + lights[:, 1] * np.sin(azimuth),
        lights[:, 1] * np.cos(azimuth) - lights[:, 0] * np.sin(azimuth),
        np.maximum(lights[:, 2], 0),
    ],
    axis=1,
)
row = np.rint(views[:, 2] * 127).astype(int)

panels = []
analytic = phong(20.0)
exact = np.array([analytic(light[None], view)[0] for light, view in zip(turned, outgoing[row], strict=True)])
results = [exact]
for basis in (hemispherical_harmonics, spherical_harmonics):
    coefficients = (lobes * quadrature.weights) @ basis(quadrature.directions, ORDER)
    results.append((coefficients[row] * basis(turned, ORDER)).sum(axis=1))
for name, values in zip(("analytic", "hemispherical", "spherical"), results, strict=True):
    radiance = np.where(lit, np.maximum(values, 0) * lights[:, 2], 0)
    error = np.sqrt(np.mean((values - exact)[lit] ** 2)) / exact.max()
    print(f"{name:14s} smallest value {values[lit].min() / exact.max():+.3f}, error {error:.4f} of the highlight")
    panel = np.zeros((SIZE, SIZE, 3))
    panel[covered] = radiance[:, None]
    panels.append(panel)
out = sys.argv[1] if len(sys.argv) > 1 else "05_hemispherical_harmonics.png"
write_png(out, np.concatenate(panels, axis=1), exposure=6 / exact.max())
print(f"wrote {out}")
