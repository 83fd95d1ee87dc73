"""Penumbra deep shadow maps off the surfaces: a beam through fog behind a slatted blind, and a ball that moves through its shadow.

Run it from the repository root: `python examples/08_fog_and_moving_things.py [out.png]`. Left to right: surfaces alone; with fog,
read from the same functions along each ray; the ball of another frame, which receives from what stands still and casts by a
second map.
"""

import sys

import numpy as np

from renderers.images import luminance, write_png
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, Scene
from renderers.scene.shapes import sphere
from renderers.transport.direct import direct, emitted
from renderers.transport.penumbra.assemble import Construction
from renderers.transport.penumbra.build import CombinedShadows, Slope, build
from renderers.transport.penumbra.emitters import emitters_of
from renderers.transport.primary import cast_gbuffer

SIZE, SIGMA, STEPS = (256, 192), 0.25, 96


def room(ball: tuple[float, float, float]) -> Scene:
    """A floor and a back wall, a lamp above five slats, and a ball."""
    b = SceneBuilder("blind")
    grey = b.material(Lambert("grey", (0.5, 0.5, 0.5)))
    b.quad([(-3, 0, 2), (3, 0, 2), (3, 0, -2), (-3, 0, -2)], grey)
    b.quad([(-3, 0, -2), (3, 0, -2), (3, 4, -2), (-3, 4, -2)], grey)
    for k in range(-2, 3):
        x = 0.5 * k
        b.quad([(x - 0.15, 2.4, 0.8), (x + 0.15, 2.4, 0.8), (x + 0.15, 2.4, -0.8), (x - 0.15, 2.4, -0.8)], grey)
    b.place(sphere(0.35, 32, 16), b.material(Lambert("ball", (0.7, 0.3, 0.2))), "ball", translation=ball)
    lamp = b.material(Lambert("lamp", (0.0, 0.0, 0.0), emission=(90.0, 85.0, 75.0), double_sided=False))
    b.quad([(-0.15, 3.8, -0.15), (0.15, 3.8, -0.15), (0.15, 3.8, 0.15), (-0.15, 3.8, 0.15)], lamp)
    b.camera((0, 1.9, 7.5), (0, 1.7, 0), 0.6)
    return b.build()


def shadows(scene: Scene, moving: bool) -> CombinedShadows:
    """Maps of what stands still, and small ones of the ball."""
    world = scene.world()
    lamp = emitters_of(world)[0]
    points = lamp.points(64, seed=0)
    is_ball = world.instance == np.bincount(world.instance).argmax()
    how = Construction(bias=2.5e-4)
    still = build(world, lamp, points, resolution=384, map_resolution=384, how=how, slope=Slope(), casters=~is_ball)
    small = build(world, lamp, points, resolution=128, map_resolution=128, how=how, slope=Slope(), casters=is_ball & moving)
    return CombinedShadows(still, small)


def surfaces(scene: Scene, light: CombinedShadows) -> np.ndarray:
    """Direct light (H, W, 3)."""
    world = scene.world()
    g = cast_gbuffer(world, SIZE)
    hidden = np.maximum(light.hidden(g.position.reshape(-1, 3)), 0).reshape(g.triangle.shape)
    return np.asarray(emitted(world, g) + direct(world, g, 16, 0, "none") * (1 - hidden[..., None]))


def fog(scene: Scene, light: CombinedShadows, image: np.ndarray) -> np.ndarray:
    """Single scattering of the lamp's light in even fog, marched along each ray with one lookup a step."""
    world = scene.world()
    g = cast_gbuffer(world, SIZE)
    origins, directions = world.camera.rays(SIZE)
    reach = np.where(g.covered, np.linalg.norm(g.position - origins, axis=-1), 3.0)
    lamp = light.still.emitter
    radiance = world.materials.emission[world.material[lamp.triangles[0]]]
    area, sigma = float(world.areas[lamp.triangles].sum()), SIGMA / world.scale
    total = np.zeros((*g.triangle.shape, 3))
    for k in range(STEPS):
        t = reach * (k + 0.5) / STEPS
        where = origins + directions * t[..., None]
        to_lamp = lamp.centre - where
        distance2 = np.maximum((to_lamp**2).sum(axis=-1), (2 * lamp.size) ** 2)
        facing = np.maximum(-(to_lamp @ lamp.frame[2]) / np.sqrt(distance2), 0)
        seen = 1 - np.maximum(light.hidden(where.reshape(-1, 3)), 0).reshape(t.shape)
        arriving = seen * facing * area / distance2 / (4 * np.pi) * np.exp(-sigma * (t + np.sqrt(distance2)))
        total += (arriving * sigma * reach / STEPS)[..., None] * radiance
    return image * np.exp(-sigma * reach)[..., None] + total


scene, later = room((0.9, 0.35, 0.3)), room((-0.4, 1.2, 0.2))
maps = shadows(scene, moving=True)
plain = surfaces(scene, maps)
# the next frame keeps the maps of what stands still; only the ball's small ones are built anew
moved = CombinedShadows(maps.still, shadows(later, moving=True).moving)
strip = np.concatenate([plain, fog(scene, maps, plain), fog(later, moved, surfaces(later, moved))], axis=1).astype(np.float32)
out = sys.argv[1] if len(sys.argv) > 1 else "08_fog_and_moving_things.png"
write_png(out, strip, exposure=1 / float(np.quantile(luminance(strip), 0.98)))
print(f"wrote {out}")
