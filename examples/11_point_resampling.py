"""Points resampled from the triangles of a colonnade, and the light they send: 20,000 triangles left, 400,000 right.

Run it from the repository root: `python examples/11_point_resampling.py [out.png]`. Above: 8,192 points of all surfaces, those in
sight as dots, from frequent levels (blue) to rare ones (red); as dense on few large triangles as on many small ones. Below: `flc`
with just these points.
"""

import sys

import numpy as np

import renderers
from renderers.images import write_png
from renderers.transport.cuts import DiscreteLevels, geometric_levels
from renderers.transport.primary import cast_gbuffer
from renderers.transport.resampling.points import resample
from renderers.transport.surface import surface_at

SIZE, POINTS = (480, 270), 8192
COLOURS = np.array([[0.02, 0.2, 1.0], [0.1, 0.9, 0.2], [1.0, 0.02, 0.02]])
levels = DiscreteLevels(*geometric_levels(3, 1.0, 2.0, 2.0))
columns = []
for count in (20_000, 400_000):
    scene = renderers.load_scene("colonnade", triangles=count)
    world = scene.world()
    points = resample(world, float(world.areas.sum()) / POINTS)
    print(f"{len(world.triangles):,} triangles: {len(points)} points on {len(np.unique(points.triangle))} of them")

    # Where the points lie on the screen, and which of them are in sight.
    where = surface_at(world, points.triangle, points.u, points.v).position
    eye, axes = world.camera.pose[:3, 3], world.camera.pose[:3, :3]
    local = (where - eye) @ axes
    tan = np.tan(world.camera.yfov / 2)
    front = local[:, 2] < -1e-3
    screen = local[:, :2] / np.where(front, -local[:, 2], 1.0)[:, None] / tan
    x = np.floor((screen[:, 0] * SIZE[1] / SIZE[0] + 1) / 2 * SIZE[0]).astype(int)
    y = np.floor((1 - screen[:, 1]) / 2 * SIZE[1]).astype(int)
    inside = front & (x >= 1) & (x < SIZE[0] - 1) & (y >= 1) & (y < SIZE[1] - 1)
    g = cast_gbuffer(world, SIZE)
    seen = np.flatnonzero(inside)
    nearest = np.linalg.norm(g.position[y[seen], x[seen]] - eye, axis=1)
    seen = seen[np.linalg.norm(where[seen] - eye, axis=1) < nearest * 1.02 + 0.002]

    dots = np.where(g.covered[..., None], 0.25 * np.abs(g.normal[..., 1:2]) + 0.1, 0.0).repeat(3, axis=2)
    for dy in (0, 1):
        for dx in (0, 1):
            dots[y[seen] + dy, x[seen] + dx] = COLOURS[levels.draw(points.level_number[seen]).astype(int) - 1]
    method = renderers.get_method("flc")
    frame = method.render(scene, method.Settings(vpls=POINTS, sampler="resampled", levels=3), size=SIZE)
    light = frame.layers["beauty"]
    columns.append(np.concatenate([dots, light / np.percentile(light, 97)]))
out = sys.argv[1] if len(sys.argv) > 1 else "11_point_resampling.png"
write_png(out, np.concatenate(columns, axis=1), exposure=1.0)
print(f"wrote {out}")
