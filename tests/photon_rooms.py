"""What tests of photon maps share: made-up maps over planes, and the box that photon-mapped irradiance caching is checked in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.solids import box
from renderers.scene.model import Lambert, PointLight, Scene
from renderers.transport.photons.density import Points
from renderers.transport.photons.map import PhotonMap, photon_map
from renderers.transport.photons.tracing import Photons, Traced

F64 = NDArray[np.float64]
ALBEDOS = {"floor": 0.7, "ceiling": 0.7, "-x": 0.6, "+x": 0.3, "-y": 0.5, "+y": 0.5, "block": 0.5}
BLOCK = ((0.1, -0.5, 0.0), (0.6, 0.1, 0.7))
LIGHT = (0.0, 0.0, 1.6)


def made(
    position: F64, normal: F64, direction: F64 | None = None, flux: float | F64 | None = None, distance: float = 1.0
) -> PhotonMap:
    """A map of photons at positions (N, 3) with normals (N, 3); flux 1/N each, from straight above, unless said otherwise."""
    count = len(position)
    power = np.broadcast_to(np.asarray(1 / max(count, 1) if flux is None else flux, np.float32).reshape(-1, 1), (count, 3))
    photons = Photons(
        np.ascontiguousarray(position, np.float32),
        np.ascontiguousarray(normal if direction is None else direction, np.float32),
        np.ascontiguousarray(power),
        np.full(count, distance, np.float32),
        np.ascontiguousarray(normal, np.float32),
        np.ones(count, np.int16),
        np.zeros(count, np.int32),
    )
    return photon_map(Traced(photons, count, np.ones(3), 0, False))


def on_plane(xy: F64, **rest: object) -> PhotonMap:
    """A map of photons at (x, y, 0), facing up."""
    position = np.concatenate([xy, np.zeros((len(xy), 1))], axis=1)
    return made(position, np.tile([0.0, 0.0, 1.0], (len(xy), 1)), **rest)  # type: ignore[arg-type]


def flat(x: F64, y: F64) -> Points:
    """Points (x, y, 0), facing up, on a flat surface."""
    position = np.stack([x, y, 0 * x], axis=1)
    return Points(position, np.tile([0.0, 0.0, 1.0], (len(x), 1)), np.full(len(x), 0.02))


def photon_box(block: bool = True, shift: tuple[float, float, float] = (0, 0, 0), size: float = 1.0) -> Scene:
    """Box [-1, 1]² × [0, 2], coloured walls, one block, a point light of 1 W; looked at from above its front edge."""
    b = SceneBuilder("photon-box")
    (x0, y0, z0), (x1, y1, z1) = (-1, -1, 0), (1, 1, 2)
    walls = {
        "floor": [(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0)],
        "ceiling": [(x0, y0, z1), (x0, y1, z1), (x1, y1, z1), (x1, y0, z1)],
        "-x": [(x0, y0, z0), (x0, y1, z0), (x0, y1, z1), (x0, y0, z1)],
        "+x": [(x1, y0, z0), (x1, y0, z1), (x1, y1, z1), (x1, y1, z0)],
        "-y": [(x0, y0, z0), (x0, y0, z1), (x1, y0, z1), (x1, y0, z0)],
        "+y": [(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)],
    }
    at = np.asarray(shift, np.float64)
    for name, corners in walls.items():
        b.quad(np.asarray(corners, np.float64) * size + at, b.material(Lambert(name, (ALBEDOS[name],) * 3)), name)
    if block:
        low, high = (tuple(np.asarray(c) * size + at) for c in BLOCK)
        b.place(box(low, high), b.material(Lambert("block", (ALBEDOS["block"],) * 3)), "block")
    b.light(PointLight("lamp", intensity=size * size / (4 * np.pi)), tuple(np.asarray(LIGHT) * size + at))
    eye = np.array([-0.3, -0.97, 1.5])
    b.camera(eye * size + at, (eye + np.array([0.25, 1.0, -0.55])) * size + at, np.radians(80), (0, 0, 1))
    return b.build()
