"""What GL passes are tested against: the same formulas in numpy float64, shadow rays by Embree, and a scene with every material."""

from __future__ import annotations

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from renderers.gbuffer import GBuffer
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import GGX, Lambert, Phong, Scene
from renderers.scene.shapes import sphere
from renderers.scene.world import LAMBERT, PHONG, World

F32_STEP = 2.0**-24


def room(*lights: object, emission: tuple[float, float, float] | None = None) -> Scene:
    """Floor, back wall and four balls of all material kinds; a small downward lamp of `emission` above them."""
    b = SceneBuilder("materials")
    grey = b.material(Lambert("grey", (0.6, 0.5, 0.4)))
    kinds = [
        b.material(Lambert("red", (0.8, 0.2, 0.1))),
        b.material(Phong("phong", (0.3, 0.4, 0.2), (0.5, 0.4, 0.3), 30.0)),
        b.material(GGX("plastic", (0.2, 0.3, 0.8), 0.0, 0.5)),
        b.material(GGX("metal", (0.9, 0.7, 0.3), 1.0, 0.35)),
    ]
    b.quad([(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], grey, "floor")
    b.quad([(-2, 0, -2), (2, 0, -2), (2, 3, -2), (-2, 3, -2)], grey, "wall")
    positions, normals, triangles = sphere(0.4, 24, 12)
    for k, material in enumerate(kinds):
        b.node(meshes=(b.mesh(positions, triangles, material, normals),), translation=(k - 1.5, 0.4, 0.3 * (k % 2)))
    if emission is not None:
        lamp = b.material(Lambert("lamp", (0.0, 0.0, 0.0), emission=emission, double_sided=False))
        b.quad([(-0.2, 2.5, -0.2), (0.2, 2.5, -0.2), (0.2, 2.5, 0.2), (-0.2, 2.5, 0.2)], lamp, "lamp")
    for light, translation, rotation in lights:  # type: ignore[misc]
        b.light(light, translation, rotation)
    b.camera((0, 1.6, 4.5), (0, 0.8, 0), 0.75)
    return b.build()


def brdf(world: World, material: np.ndarray, base: np.ndarray, n: np.ndarray, v: np.ndarray, l: np.ndarray) -> np.ndarray:  # noqa: E741
    """f_r, float64 (..., 3), of vectors (..., 3) and material rows (...)."""
    table = world.materials
    kind = table.kind[material]
    dot = lambda a, b: np.sum(a * b, axis=-1)  # noqa: E731
    nl, nv = dot(n, l), np.abs(dot(n, v))
    e = table.exponent[material].astype(float)
    lobe = np.maximum(dot(2 * nl[..., None] * n - l, v), 0) ** e * (e + 2) / (2 * np.pi)
    phong = base / np.pi + table.specular[material] * lobe[..., None]
    h = (l + v) / np.linalg.norm(l + v, axis=-1, keepdims=True)
    a2, metallic = table.alpha[material].astype(float) ** 2, table.metallic[material][..., None]
    D = a2 / (np.pi * (dot(n, h) ** 2 * (a2 - 1) + 1) ** 2)
    vis = 0.5 / (nl * np.sqrt(nv**2 * (1 - a2) + a2) + nv * np.sqrt(nl**2 * (1 - a2) + a2))
    f0 = 0.04 * (1 - metallic) + base * metallic
    F = f0 + (1 - f0) * ((1 - np.abs(dot(v, h))) ** 5)[..., None]
    ggx = (1 - F) * base * (1 - metallic) / np.pi + F * (D * vis)[..., None]
    kind = kind[..., None]
    return np.where(kind == LAMBERT, base / np.pi, np.where(kind == PHONG, phong, ggx))


def pixels(world: World, g: GBuffer) -> dict[str, np.ndarray]:
    """Covered pixels of a G-buffer as flat float64 arrays: position, normal, base, view, material, geometric."""
    c = g.covered
    position = g.position[c].astype(float)
    view = g.eye - position
    view /= np.linalg.norm(view, axis=-1, keepdims=True)
    return {
        "position": position, "normal": g.normal[c].astype(float), "base": g.base[c].astype(float), "view": view,
        "material": g.material[c], "geometric": world.face_normals[g.triangle[c]],
    }  # fmt: skip


class Caster:
    """Shadow rays by Embree over all triangles of a World."""

    def __init__(self, world: World) -> None:
        self.scene = rtcore_scene.EmbreeScene()
        TriangleMesh(self.scene, np.ascontiguousarray(world.positions[world.triangles]))

    def hits(self, origins: np.ndarray, directions: np.ndarray) -> dict[str, np.ndarray]:
        """Embree's answer for float64 rays (..., 3), arrays of the same leading shape."""
        shape = directions.shape[:-1]
        o = np.ascontiguousarray(np.broadcast_to(origins, directions.shape).reshape(-1, 3), np.float32)
        found = self.scene.run(o, np.ascontiguousarray(directions.reshape(-1, 3), np.float32), output=1)
        return {name: found[name].reshape(shape) for name in ("primID", "tfar")}

    def visible(self, points: np.ndarray, geometric: np.ndarray, towards: np.ndarray, *, infinite: bool = False) -> np.ndarray:
        """Whether the segments from the points (or whole rays) are free, starting 1e-4 off the surface on the light's side."""
        side = np.where(np.sum(geometric * towards, axis=-1, keepdims=True) < 0, -1.0, 1.0)
        start = 1e-4 * side * geometric
        found = self.hits(points + start, towards - (0 if infinite else start))
        return ~((found["primID"] >= 0) & (infinite | (found["tfar"] < 1 - 1e-4)))
