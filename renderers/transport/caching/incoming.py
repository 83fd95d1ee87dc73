"""What rays of a hemisphere see: the direct light that the surfaces they hit reflect towards where the rays came from.

Emission and sky are left out: seen from a record they are direct light of its point, which no cache holds. Lights are sampled as
anywhere else (`incident.Lights`): punctual ones exactly, emitting triangles and the sky by one sample a hit, since thousands of
hits make one record; the samples of a hemisphere are a lattice moved at random, hence spread evenly over the lights.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import LAMBERT, World, WorldLight
from renderers.transport.incident import Incident, Lights
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
    triangle = hits.triangle[ray]
    position, normal, geometric, towards = (np.empty((len(ray), 3)) for _ in range(4))
    uv, material = np.empty((len(ray), 2)), world.material[triangle]
    seen = Seen(ray, position, normal, geometric, towards, material, world.materials.base[material].astype(np.float64))
    _surfaces(seen, uv, hits, directions, (world.positions, world.normals, world.uvs, world.triangles, world.face_normals))
    if (world.materials.texture >= 0).any():
        seen = seen._replace(base=base_color(world, material, uv))
    return seen


class ReflectedDirectLight:
    """Incoming light of one bounce: direct light reflected once, with ray-cast shadows."""

    def __init__(self, world: World) -> None:
        self._lights = Lights(world, 1)
        self._caster: RayCaster = caster_of(world)
        table = world.materials
        columns = (a.astype(np.float64) for a in (table.specular, table.exponent, table.metallic, table.alpha))
        self._materials = table.kind, *columns
        self._punctual = [_described(light) for light in world.lights]

    def __call__(self, seen: Seen, random: F64) -> tuple[F32, int]:
        """See `Incoming`."""
        count, rays = len(seen.ray), 0
        radiance = np.zeros((count, 3), np.float32)
        value, origin, aim = (np.empty((count, 3), np.float32) for _ in range(3))
        index, reach = np.empty(count, np.int64), np.empty(count, np.float32)
        for sample in self._samples(seen, random):
            n = _lit(seen, self._materials, sample, OFFSET, FAR, (index, value, origin, aim, reach))
            blocked = self._caster.occluded_unthreaded(origin[:n], aim[:n], reach[:n])
            _add_visible(index[:n], value[:n], blocked, radiance)
            rays += n
        return radiance, rays

    def _samples(self, seen: Seen, random: F64) -> Iterator[Incident]:
        for light in self._punctual:
            sample = Incident(np.empty_like(seen.position), np.empty_like(seen.position), np.empty(len(seen.ray)))
            _from_punctual(light, seen.position, sample)
            yield sample
        yield from self._lights.distributed(seen.position, seen.normal, random)


class Punctual(NamedTuple):
    """A `WorldLight` as kernels read it."""

    directional: bool
    spot: bool
    position: F64
    direction: F64
    intensity: F64
    cos_inner: float
    cos_outer: float


def _described(light: WorldLight) -> Punctual:
    position, direction, intensity = (np.asarray(a, np.float64) for a in (light.position, light.direction, light.intensity))
    cosines = float(light.cos_inner), float(light.cos_outer)
    return Punctual(light.kind == "directional", light.kind == "spot", position, direction, intensity, *cosines)


@numba.njit(nogil=True, cache=True)
def _surfaces(seen, uv, hits, direction, geometry):  # type: ignore[no-untyped-def]
    """Fill the arrays of `seen` whose rays are known, and uv (S, 2)."""
    positions, normals, uvs, triangles, face_normals = geometry
    for s in range(len(seen.ray)):
        r = seen.ray[s]
        t, second, third = hits.triangle[r], float(hits.u[r]), float(hits.v[r])
        first = 1 - second - third
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        length, facing = 0.0, 0.0
        for x in range(3):
            seen.position[s, x] = first * positions[a, x] + second * positions[b, x] + third * positions[c, x]
            mixed = first * normals[a, x] + second * normals[b, x] + third * normals[c, x]
            seen.normal[s, x] = mixed
            length += mixed * mixed
            seen.geometric[s, x] = face_normals[t, x]
            seen.towards[s, x] = -float(direction[r, x])
        flat = length < 1e-12  # opposite vertex normals cancel: flat shading there
        for x in range(3):
            seen.normal[s, x] = face_normals[t, x] if flat else seen.normal[s, x] / np.sqrt(length)
            facing += seen.normal[s, x] * seen.towards[s, x]
        if facing < 0:
            for x in range(3):
                seen.normal[s, x] = -seen.normal[s, x]
        for x in range(2):
            uv[s, x] = first * uvs[a, x] + second * uvs[b, x] + third * uvs[c, x]


@numba.njit(nogil=True, cache=True)
def _from_punctual(light, position, out):  # type: ignore[no-untyped-def]
    """`incident.punctual` for points (S, 3): fills an `Incident`."""
    width = max(light.cos_inner - light.cos_outer, 1e-6)
    for s in range(len(position)):
        square, scale = 0.0, 1.0
        for c in range(3):
            out.direction[s, c] = -light.direction[c] if light.directional else light.position[c] - position[s, c]
            square += out.direction[s, c] ** 2
        distance = max(np.sqrt(square), 1e-12)
        if light.directional:
            out.distance[s] = np.inf
        else:
            out.distance[s] = distance
            scale = 1 / distance**2
            for c in range(3):
                out.direction[s, c] /= distance
        if light.spot:
            cosine = 0.0
            for c in range(3):
                cosine -= out.direction[s, c] * light.direction[c]
            scale *= min(max((cosine - light.cos_outer) / width, 0.0), 1.0) ** 2
        for c in range(3):
            out.weight[s, c] = light.intensity[c] * scale


@numba.njit(inline="always")
def _tuple(array, s):  # type: ignore[no-untyped-def]
    return array[s, 0], array[s, 1], array[s, 2]


@numba.njit(nogil=True, cache=True)
def _lit(seen, materials, light, offset, far, out):  # type: ignore[no-untyped-def]
    """Hits that a light sample (`Incident`) reaches from the front; returns how many.

    out: index (S,), reflected radiance if unblocked (S, 3), and their shadow rays: origin, aim (S, 3), reach (S,).
    """
    index, value, origin, aim, reach = out
    kind, specular, exponent, metallic, alpha = materials
    count = 0
    weight, reflected = np.empty(3), np.empty(3)
    for s in range(len(seen.ray)):
        n, to_light = _tuple(seen.normal, s), _tuple(light.direction, s)
        cosine = n[0] * to_light[0] + n[1] * to_light[1] + n[2] * to_light[2]
        if cosine <= 0 or max(light.weight[s, 0], light.weight[s, 1], light.weight[s, 2]) <= 0:
            continue
        m = seen.material[s]
        for c in range(3):
            weight[c] = light.weight[s, c] * cosine
            reflected[c] = seen.base[s, c] / np.pi * weight[c] if kind[m] == LAMBERT else 0.0
        if kind[m] != LAMBERT:
            shade(
                kind[m], seen.base[s], specular[m], exponent[m], metallic[m], alpha[m],
                n, _tuple(seen.towards, s), to_light, weight, reflected,
            )  # fmt: skip
        if max(reflected[0], reflected[1], reflected[2]) <= 0:
            continue
        g = _tuple(seen.geometric, s)
        outside = g[0] * to_light[0] + g[1] * to_light[1] + g[2] * to_light[2] >= 0
        distant = np.isinf(light.distance[s])
        for x in range(3):
            value[count, x] = reflected[x]
            start = seen.position[s, x] + (offset if outside else -offset) * g[x]
            origin[count, x] = start
            aim[count, x] = to_light[x] if distant else seen.position[s, x] + to_light[x] * light.distance[s] - start
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
