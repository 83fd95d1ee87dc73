"""The two rooms that irradiance caching is checked in, with what else those tests share. Metres, z up.

Room 1: [-2, 2]² × [0, 3] with one box; its surfaces emit a radiance given by a formula, so hemispheres can be integrated by anyone.
Room 2: the same shell with two boxes and a point light; one bounce of it is what the cached image shows.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.solids import box
from renderers.scene.model import Lambert, PointLight, Scene
from renderers.scene.world import World
from renderers.transport.caching.records import Sites
from renderers.transport.seen import Seen

F64 = NDArray[np.float64]
Corners = tuple[tuple[float, float, float], tuple[float, float, float]]
ROOM: Corners = ((-2, -2, 0), (2, 2, 3))
BOX_1: Corners = ((0.5, -0.4, 0), (1.1, 0.4, 1.2))
BOXES_2: tuple[Corners, ...] = (((0.3, 0.2, 0), (1.0, 0.9, 1.5)), ((-1.1, -0.3, 0), (-0.4, 0.4, 0.8)))
ALBEDOS_2 = {"floor": 0.6, "ceiling": 0.7, "-x": 0.65, "+x": 0.25, "-y": 0.5, "+y": 0.6, "box": 0.55}
EYE_2, FORWARD_2, FOV_2 = np.array([-0.2, -1.95, 1.5]), np.array([0.05, 1, -0.12]), np.radians(75)
LIGHT_2, INTENSITY_2 = (0.2, -0.3, 2.7), 8.0

# Points, normals, E, translation gradient (per metre), rotation gradient of room 1, from 4.3 M directions and differences over
# ±2 cm and ±0.01 rad.
POINTS_1 = np.array(
    [
        [(0.1, 0.15, 0), (0, 0, 1), (2.2221, 0, 0), (-0.4575, 0.4793, 0), (-0.4354, -0.0611, 0)],
        [(-1, -0.5, 0), (0, 0, 1), (2.1491, 0, 0), (0.1686, 0.2934, 0), (-0.5160, 0.3177, 0)],
        [(0.3, 0.9, 0), (0, 0, 1), (2.4281, 0, 0), (-0.1406, 0.1628, 0), (-0.2979, 0.2170, 0)],
        [(-1.2, 1.1, 0), (0, 0, 1), (2.2859, 0, 0), (0.3105, -0.0597, 0), (-0.1533, 0.4864, 0)],
        [(0.2, -2, 1), (0, 1, 0), (1.9957, 0, 0), (0.0156, 0, 0.3065), (0.8378, 0, -0.1935)],
        [(-2, 0.3, 1.2), (1, 0, 0), (2.1664, 0, 0), (0, 0.1482, 0.4822), (0, -1.0900, 0.3458)],
        [(0.45, 0.1, 0), (0, 0, 1), (1.9775, 0, 0), (-0.915, 0.160, 0), (-0.2834, -0.2283, 0)],
        [(-1.9, -1.9, 0), (0, 0, 1), (1.4619, 0, 0), (0.123, 0.561, 0), (-0.5691, 0.3354, 0)],
    ]
)


def shell(b: SceneBuilder, albedo: Mapping[str, float]) -> None:
    """The six walls of ROOM, fronts inside."""
    (x0, y0, z0), (x1, y1, z1) = ROOM
    walls = {
        "floor": [(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0)],
        "ceiling": [(x0, y0, z1), (x0, y1, z1), (x1, y1, z1), (x1, y0, z1)],
        "-x": [(x0, y0, z0), (x0, y1, z0), (x0, y1, z1), (x0, y0, z1)],
        "+x": [(x1, y0, z0), (x1, y0, z1), (x1, y1, z1), (x1, y1, z0)],
        "-y": [(x0, y0, z0), (x0, y0, z1), (x1, y0, z1), (x1, y0, z0)],
        "+y": [(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)],
    }
    for name, corners in walls.items():
        b.quad(corners, b.material(Lambert(name, (albedo[name],) * 3)), name)


def room_1() -> Scene:
    """Room 1; its albedos mean nothing."""
    b = SceneBuilder("room-1")
    shell(b, dict.fromkeys(ALBEDOS_2, 0.5))
    b.place(box(*BOX_1), b.material(Lambert("box", (0.5,) * 3)), "box")
    b.camera((0, -1.9, 1.5), (0, 0, 1.2), 1.0, (0, 0, 1))
    return b.build()


def room_2(
    boxes: tuple[Corners, ...] = BOXES_2, light: tuple[float, float, float] = LIGHT_2, intensity: float = INTENSITY_2
) -> Scene:
    """Room 2, with its square field of view of 75°."""
    b = SceneBuilder("room-2")
    shell(b, ALBEDOS_2)
    grey = b.material(Lambert("box", (ALBEDOS_2["box"],) * 3))
    for corners in boxes:
        b.place(box(*corners), grey, "box")
    b.light(PointLight("lamp", (1.0, 1.0, 1.0), intensity), light)
    b.camera(EYE_2, EYE_2 + FORWARD_2, FOV_2, (0, 0, 1))
    return b.build()


class Radiance1:
    """Radiance of room 1's surfaces, as `Incoming`."""

    def __init__(self, world: World) -> None:
        self._world = world

    def __call__(self, seen: Seen, random: F64) -> tuple[NDArray[np.float32], int]:
        p = metres(self._world, seen.position)
        return np.repeat(radiance_1(p)[:, None], 3, axis=1).astype(np.float32), 0


def radiance_1(p: F64) -> F64:
    """Radiance at points (N, 3) in metres on the surfaces of room 1, float64 (N,)."""
    x, y, z = p.T
    box_ = 0.15 + 0.1 * z + np.where(np.abs(x - 0.5) < 1e-4, 0.25, 0)
    conditions = [
        z > 3 - 1e-4,
        x > 2 - 1e-4,
        x < -2 + 1e-4,
        y > 2 - 1e-4,
        y < -2 + 1e-4,
        z < 1e-4,
    ]
    values = [
        1 + 4 * np.exp(-(((x + 0.7) / 0.5) ** 2) - ((y - 0.5) / 0.5) ** 2),
        0.8 + 0.3 * np.sin(2 * y),
        0.3 + 0.1 * z,
        0.6 + 0.2 * np.cos(3 * x) * z / 3,
        0.2 + 0 * x,
        0.4 + 0 * x,
    ]
    return np.asarray(np.select(conditions, values, box_))


def metres(world: World, position: ArrayLike) -> F64:
    """World positions in metres."""
    return np.asarray(world.centre + np.asarray(position, np.float64) / world.scale)


def sites(world: World, points: ArrayLike, normals: ArrayLike) -> Sites:
    """Sites at points in metres, geometric normal = normal."""
    n = np.asarray(normals, np.float64).reshape(-1, 3)
    return Sites((np.asarray(points, np.float64).reshape(-1, 3) - world.centre) * world.scale, n, n)


class Constant:
    """The same radiance from every surface, as `Incoming`."""

    def __init__(self, radiance: float) -> None:
        self._radiance = radiance

    def __call__(self, seen: Seen, random: F64) -> tuple[NDArray[np.float32], int]:
        return np.full((len(seen.ray), 3), self._radiance, np.float32), 0
