"""A two-floor atrium with arcades, curtains and an open roof: most of it is lit by indirect light.

The court runs along X (24 m) between two arcades at z = ±4 m; behind each lies a 3 m deep aisle, on two floors. `triangles` is
met by one number, the detail, which scales every tessellation; it is found by bisection on the counted triangles.
"""

from __future__ import annotations

import numpy as np

from renderers.scene.builder import SceneBuilder, look_rotation
from renderers.scene.builtin import colonnade_parts as parts
from renderers.scene.builtin.parameters import checked
from renderers.scene.model import DirectionalLight, Environment, Lambert, Scene

BAYS, BAY, COURT, AISLE = 6, 4.0, 4.0, 7.0
LENGTH = BAYS * BAY / 2
GROUND, GALLERY, ROOF = 5.5, 5.9, 10.5
UPPER = (ROOF - GALLERY) / GROUND
PAINTS = {
    "stone": (0.58, 0.52, 0.43), "plaster": (0.66, 0.60, 0.50), "light tile": (0.55, 0.49, 0.40), "dark tile": (0.30, 0.24, 0.19),
    "red cloth": (0.60, 0.06, 0.05), "green cloth": (0.08, 0.32, 0.12), "blue cloth": (0.06, 0.14, 0.45),
    "bronze": (0.40, 0.26, 0.12),
}  # fmt: skip


@checked(triangles=(20_000, 2_500_000))
def colonnade(triangles: int = 200_000, sky: bool = False) -> Scene:
    """Two-floor atrium of arches, columns and curtains under an open roof: sun on the floor, indirect light everywhere else.

    `triangles` is met within 10 % (20,000 to 2,500,000). `sky` adds a constant blue environment of radiance (0.35, 0.5, 0.8).
    """
    low, high = 0.05, 20.0
    for _ in range(18):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if _assemble(middle).count < triangles else (low, middle)
    b = _assemble(high)
    b.light(DirectionalLight("sun", (1.0, 0.93, 0.80), 18.0), rotation=look_rotation((0.32, -1.0, -0.30)))
    if sky:
        b.environment = Environment((0.35, 0.5, 0.8))
    b.camera((-11.3, 2.9, 1.2), (0.0, 3.1, -0.75), np.radians(60))
    return b.build(triangles=triangles, sky=sky)


class _Atrium(SceneBuilder):
    """A builder that counts the triangles it places."""

    @property
    def count(self) -> int:
        return sum(len(self.meshes[i].triangles) for node in self.nodes for i in node.meshes)


def _assemble(detail: float) -> _Atrium:
    b = _Atrium("colonnade")
    paint = {name: b.material(Lambert(name, color)) for name, color in PAINTS.items()}
    _shell(b, paint, detail)
    _arcades(b, paint, detail)
    _furnish(b, paint, detail)
    return b


def _shell(b: _Atrium, paint: dict[str, int], detail: float) -> None:
    """Floors, slabs and outer walls."""
    cell = 1.0 / detail
    for parity, name in enumerate(("light tile", "dark tile")):
        b.place(parts.tiles((-LENGTH, -COURT), (LENGTH, COURT), (24, 8), parity, cell), paint[name], name)
    for side in (-1, 1):
        near, far = sorted((side * COURT, side * AISLE))
        inner = sorted((side * (COURT - 0.3), side * AISLE))
        b.place(parts.floor((-LENGTH, near), (LENGTH, far), cell), paint["light tile"], "aisle floor")
        b.place(parts.slab((-LENGTH, GROUND, inner[0]), (LENGTH, GALLERY, inner[1]), cell), paint["plaster"], "gallery")
        b.place(parts.slab((-LENGTH, ROOF, inner[0]), (LENGTH, ROOF + 0.5, inner[1]), cell), paint["stone"], "roof")
        wall = [(side * LENGTH, 0.0, side * AISLE), (-side * LENGTH, 0.0, side * AISLE)]
        b.place(parts.wall(wall[0], wall[1], ROOF, cell), paint["plaster"], "outer wall")
        end = [(side * LENGTH, 0.0, -side * AISLE), (side * LENGTH, 0.0, side * AISLE)]
        b.place(parts.wall(end[0], end[1], ROOF + 0.5, cell), paint["plaster"], "end wall")


def _arcades(b: _Atrium, paint: dict[str, int], detail: float) -> None:
    """Columns and arches, the same meshes on both floors: upper ones are lower and slimmer."""
    column = b.shape(parts.column(detail), paint["stone"], "column")
    arch = b.shape(parts.arch(BAY, GROUND, detail), paint["plaster"], "arch")
    rail = b.shape(parts.balustrade(BAY, detail), paint["stone"], "balustrade")
    for z in (-COURT, COURT):
        for base, scale in ((0.0, 1.0), (GALLERY, UPPER)):
            for k in range(BAYS + 1):
                slim = 0.85 if base else 1.0
                b.node(name="column", meshes=(column,), translation=(-LENGTH + k * BAY, base, z), scale=(slim, scale, slim))
            for k in range(BAYS):
                where = (-LENGTH + (k + 0.5) * BAY, base, z)
                b.node(name="arch", meshes=(arch,), translation=where, scale=(1.0, scale, 1.0))
                if base:
                    b.node(name="balustrade", meshes=(rail,), translation=where)


def _furnish(b: _Atrium, paint: dict[str, int], detail: float) -> None:
    """Curtains in the lower arches, banners over the rail, a knot on a pedestal in the court."""
    cloths = ("red cloth", "green cloth", "blue cloth")
    curtains = [b.shape(parts.curtain(1.25, 3.15, detail), paint[name], "curtain") for name in cloths]
    banners = [b.shape(parts.banner(1.3, 2.6, detail), paint[name], "banner") for name in cloths]
    half_turn = (0.0, 1.0, 0.0, 0.0)
    for row, z in enumerate((-COURT, COURT)):
        for k in range(BAYS):
            x, kind = -LENGTH + (k + 0.5) * BAY, (k + row) % 3
            if (k + row) % 2 == 0:
                b.node(name="curtain", meshes=(curtains[kind],), translation=(x - 1.6, 0.12, z))
                b.node(name="curtain", meshes=(curtains[kind],), translation=(x + 1.6, 0.12, z), rotation=half_turn)
            else:
                b.node(name="banner", meshes=(banners[kind],), translation=(x - 0.65, 4.1, z * 0.9))
    b.place(parts.pedestal(detail), paint["stone"], "pedestal", translation=(-4.6, 0.0, 0.9))
    b.place(parts.knot(detail), paint["bronze"], "knot", translation=(-4.6, 2.05, 0.9))
