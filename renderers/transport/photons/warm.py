"""Compile the kernels (or load them from numba's cache) before anything is timed."""

from __future__ import annotations

from functools import cache

import numpy as np

from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, PointLight
from renderers.scene.world import World
from renderers.transport.photons.density import irradiance, lookup, points, reflected
from renderers.transport.photons.glossy import value_of_nearest
from renderers.transport.photons.hull import CORRECTED
from renderers.transport.photons.map import photon_map
from renderers.transport.photons.pixels import gatherers
from renderers.transport.photons.tracing import trace
from renderers.transport.photons.walk import walk
from renderers.transport.photons.zones import SHRUNK, Recipe
from renderers.transport.primary import cast_gbuffer


def _room() -> World:
    """Two facing quads and a lamp."""
    b = SceneBuilder("warm-up")
    grey = b.material(Lambert("grey", albedo=(0.5,) * 3))
    for y in (0.0, 1.0):
        b.quad([(-1, y, 1), (1, y, 1), (1, y, -1), (-1, y, -1)], grey)
    b.light(PointLight("lamp"), (0.0, 0.5, 0.0))
    b.camera((0, 0.5, 1), (0, 0, 0), 1.0)
    return b.build().world()


@cache
def warm_up() -> None:
    """Trace and look up a few photons; once a process."""
    world = _room()
    photons = photon_map(trace(world, 64))
    pixels = gatherers(world, gbuffer := cast_gbuffer(world, (2, 2)))
    where = points(world, pixels.position, pixels.normal, gbuffer.triangle.ravel()[pixels.row])
    irradiance(photons, where, lookup(4, 0.5, "corrected"))
    walk(world, photons, Recipe(0.3, 0.1, 1.0, 8, 4, CORRECTED, SHRUNK, 2, 4, 8))
    value_of_nearest(photons.tree, np.zeros((len(photons), 3)), where.position, where.normal, np.zeros_like(where.position))
    reflected(photons, where, pixels.view, pixels.materials, lookup(4, 0.5, "disc"))
