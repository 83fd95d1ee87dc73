"""What rays of a hemisphere see: the direct light that the surfaces they hit reflect towards where the rays came from.

Emission and sky are left out: seen from a record they are direct light of its point, which no cache holds. Lights are sampled as
anywhere else (`incident.Lights`): punctual ones exactly, emitting triangles and the sky by one sample a hit, since thousands of hits
make one record; the samples of a hemisphere are a lattice moved at random, hence spread evenly over the lights.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import GGX_KIND, LAMBERT, PHONG, World
from renderers.transport.incident import Lights
from renderers.transport.kernels import shade
from renderers.transport.raycast import FAR, OFFSET, Hits, RayCaster, caster_of
from renderers.transport.surface import base_color

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


class Seen(NamedTuple):
    """Hits of rays. ray int64 (S,): which ray; position (S, 3); normal (S, 3) shading, turned to where the ray came from;
    geometric (S, 3); towards (S, 3): unit, back along the ray: float64. material int32 (S,); base float64 (S, 3)."""

    ray: NDArray[np.int64]
    position: F64
    normal: F64
    geometric: F64
    towards: F64
    material: NDArray[np.int32]
    base: F64


class Incoming(Protocol):
    """Radiance that comes back along rays from what they hit. Called from several threads at once."""

    def __call__(self, seen: Seen, random: F64) -> tuple[F32, int]:
        """Radiance float32 (S, 3) and the number of rays cast for it; random (S, 6) in [0, 1)."""


def seen_along(world: World, directions: F32, hits: Hits) -> Seen:
    """The surfaces that rays with unit directions (N, 3) hit."""
    ray = np.flatnonzero(hits.triangle >= 0)
    count = len(ray)
    position, normal, geometric, towards = (np.empty((count, 3)) for _ in range(4))
    uv = np.empty((count, 2))
    triangle = hits.triangle[ray]
    _surfaces(
        ray, triangle, hits.u, hits.v, directions, world.positions, world.normals, world.uvs, world.triangles, world.face_normals,
        position, normal, geometric, towards, uv,
    )  # fmt: skip
    material = world.material[triangle]
    if (world.materials.texture < 0).all():
        base = world.materials.base[material].astype(np.float64)
    else:
        base = base_color(world, material, uv)
    return Seen(ray, position, normal, geometric, towards, material, base)


class ReflectedDirectLight:
    """Incoming light of one bounce: direct light reflected once, with ray-cast shadows."""

    def __init__(self, world: World) -> None:
        self._lights = Lights(world, 1)
        self._caster: RayCaster = caster_of(world)
        table = world.materials
        self._parameters = table.kind, *(a.astype(np.float64) for a in (table.specular, table.exponent, table.metallic, table.alpha))

    def __call__(self, seen: Seen, random: F64) -> tuple[F32, int]:
        """See `Incoming`."""
        radiance, rays = np.zeros((len(seen.ray), 3), np.float32), 0
        index = np.empty(len(seen.ray), np.int64)
        value, origin, aim = (np.empty((len(seen.ray), 3), np.float32) for _ in range(3))
        reach = np.empty(len(seen.ray), np.float32)
        for sample in self._lights.incident(seen.position, seen.normal, random):
            count = _lit(
                seen.position, seen.normal, seen.geometric, seen.towards, seen.material, seen.base, *self._parameters, *sample,
                OFFSET, FAR, index, value, origin, aim, reach,
            )  # fmt: skip
            blocked = self._caster.occluded_unthreaded(origin[:count], aim[:count], reach[:count])
            _add_visible(index[:count], value[:count], blocked, radiance)
            rays += count
        return radiance, rays


@numba.njit(nogil=True, cache=True)
def _surfaces(ray, triangle, u, v, direction, positions, normals, uvs, triangles, face_normals, position, normal, geometric, towards, uv):  # type: ignore[no-untyped-def]
    for s in range(len(ray)):
        r, t = ray[s], triangle[s]
        second, third = float(u[r]), float(v[r])
        first = 1 - second - third
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        length, facing = 0.0, 0.0
        for x in range(3):
            position[s, x] = first * positions[a, x] + second * positions[b, x] + third * positions[c, x]
            mixed = first * normals[a, x] + second * normals[b, x] + third * normals[c, x]
            normal[s, x] = mixed
            length += mixed * mixed
            geometric[s, x] = face_normals[t, x]
            towards[s, x] = -float(direction[r, x])
        flat = length < 1e-12  # opposite vertex normals cancel: flat shading there
        for x in range(3):
            normal[s, x] = face_normals[t, x] if flat else normal[s, x] / np.sqrt(length)
            facing += normal[s, x] * towards[s, x]
        if facing < 0:
            for x in range(3):
                normal[s, x] = -normal[s, x]
        for x in range(2):
            uv[s, x] = first * uvs[a, x] + second * uvs[b, x] + third * uvs[c, x]


@numba.njit(nogil=True, cache=True)
def _lit(position, normal, geometric, towards, material, base, kind, specular, exponent, metallic, alpha, light, weight, distance, offset, far, index, value, origin, aim, reach):  # type: ignore[no-untyped-def]
    """Hits that a light sample reaches from the front: index (S,), reflected radiance (S, 3), shadow rays. Returns how many."""
    count = 0
    scaled, reflected = np.empty(3), np.empty(3)
    for s in range(len(position)):
        cosine = normal[s, 0] * light[s, 0] + normal[s, 1] * light[s, 1] + normal[s, 2] * light[s, 2]
        if cosine <= 0 or (weight[s, 0] <= 0 and weight[s, 1] <= 0 and weight[s, 2] <= 0):
            continue
        m = material[s]
        brightest = 0.0
        for c in range(3):
            scaled[c] = weight[s, c] * cosine
            reflected[c] = base[s, c] / np.pi * scaled[c] if kind[m] == LAMBERT else 0.0
        if kind[m] == PHONG or kind[m] == GGX_KIND:
            shade(
                kind[m], base[s], specular[m], exponent[m], metallic[m], alpha[m],
                (normal[s, 0], normal[s, 1], normal[s, 2]), (towards[s, 0], towards[s, 1], towards[s, 2]),
                (light[s, 0], light[s, 1], light[s, 2]), scaled, reflected,
            )  # fmt: skip
        for c in range(3):
            value[count, c] = reflected[c]
            brightest = max(brightest, reflected[c])
        if brightest <= 0:
            continue
        side = 0.0
        for x in range(3):
            side += geometric[s, x] * light[s, x]
        distant = np.isinf(distance[s])
        for x in range(3):
            start = position[s, x] + (offset if side >= 0 else -offset) * geometric[s, x]
            origin[count, x] = start
            aim[count, x] = light[s, x] if distant else position[s, x] + light[s, x] * distance[s] - start
        reach[count] = far if distant else 1 - offset
        index[count] = s
        count += 1
    return count


@numba.njit(nogil=True, cache=True)
def _add_visible(index, value, blocked, radiance):  # type: ignore[no-untyped-def]
    for i in range(len(index)):
        if not blocked[i]:
            for c in range(3):
                radiance[index[i], c] += value[i, c]
