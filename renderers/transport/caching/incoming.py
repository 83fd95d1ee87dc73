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
from renderers.transport.raycast import FAR, OFFSET, RayCaster, caster_of
from renderers.transport.seen import Seen

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


class Incoming(Protocol):
    """Radiance that comes back along rays from what they hit. Called from several threads at once."""

    def __call__(self, seen: Seen, random: F64) -> tuple[F32, int]:
        """Radiance float32 (S, 3) and the number of rays cast for it; random (S, 6) in [0, 1)."""


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
        for light, sample in self._samples(seen, random):
            n = _lit(seen, self._materials, light, sample, OFFSET, FAR, (index, value, origin, aim, reach))
            blocked = self._caster.occluded_unthreaded(origin[:n], aim[:n], reach[:n])
            _add_visible(index[:n], value[:n], blocked, radiance)
            rays += n
        return radiance, rays

    def _samples(self, seen: Seen, random: F64) -> Iterator[tuple[Punctual, Incident]]:
        for light in self._punctual:
            yield light, NO_SAMPLE
        for sample in self._lights.distributed(seen.position, seen.normal, random):
            yield NO_LIGHT, sample


class Punctual(NamedTuple):
    """A `WorldLight` as kernels read it."""

    directional: bool
    spot: bool
    position: F64
    direction: F64
    intensity: F64
    cos_inner: float
    cos_outer: float


NO_LIGHT = Punctual(False, False, np.zeros(3), np.zeros(3), np.zeros(3), 1.0, 0.0)
NO_SAMPLE = Incident(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


def _described(light: WorldLight) -> Punctual:
    position, direction, intensity = (np.asarray(a, np.float64) for a in (light.position, light.direction, light.intensity))
    cosines = float(light.cos_inner), float(light.cos_outer)
    return Punctual(light.kind == "directional", light.kind == "spot", position, direction, intensity, *cosines)


@numba.njit(inline="always")
def _tuple(array, s):  # type: ignore[no-untyped-def]
    return array[s, 0], array[s, 1], array[s, 2]


@numba.njit(inline="always")
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(nogil=True, cache=True)
def _lit(seen, materials, light, sample, offset, far, out):  # type: ignore[no-untyped-def]
    """Hits that light reaches from the front; returns how many. The light is a `Punctual`, or an `Incident` that isn't empty.

    out: index (S,), reflected radiance if unblocked (S, 3), and their shadow rays: origin, aim (S, 3), reach (S,).
    """
    position, normal, geometric, towards, base, material = (
        seen.position, seen.normal, seen.geometric, seen.towards, seen.base, seen.material
    )  # fmt: skip
    index, value, origin, aim, reach = out
    kind, specular, exponent, metallic, alpha = materials
    width = max(light.cos_inner - light.cos_outer, 1e-6)
    sampled = len(sample.distance) > 0
    count = 0
    brought, reflected = np.empty(3), np.empty(3)
    for s in range(len(material)):
        distance, scale = np.inf, 1.0
        if sampled:
            x, y, z = _tuple(sample.direction, s)
            distance = sample.distance[s]
        elif light.directional:
            x, y, z = -light.direction[0], -light.direction[1], -light.direction[2]
        else:
            x, y, z = light.position[0] - position[s, 0], light.position[1] - position[s, 1], light.position[2] - position[s, 2]
        cosine = _dot(_tuple(normal, s), (x, y, z))
        if cosine <= 0:
            continue
        if not (sampled or light.directional):
            distance = max(np.sqrt(x * x + y * y + z * z), 1e-12)
            near = 1 / distance
            x, y, z, cosine, scale = x * near, y * near, z * near, cosine * near, near * near
            if light.spot:
                aside = -(light.direction[0] * x + light.direction[1] * y + light.direction[2] * z)
                scale *= min(max((aside - light.cos_outer) / width, 0.0), 1.0) ** 2
        m = material[s]
        for c in range(3):
            brought[c] = (sample.weight[s, c] if sampled else light.intensity[c] * scale) * cosine
            reflected[c] = base[s, c] / np.pi * brought[c] if kind[m] == LAMBERT else 0.0
        if kind[m] != LAMBERT and max(brought[0], brought[1], brought[2]) > 0:
            shade(
                kind[m], base[s], specular[m], exponent[m], metallic[m], alpha[m],
                _tuple(normal, s), _tuple(towards, s), (x, y, z), brought, reflected,
            )  # fmt: skip
        if max(reflected[0], reflected[1], reflected[2]) <= 0:
            continue
        side = offset if _dot(_tuple(geometric, s), (x, y, z)) >= 0 else -offset
        distant = np.isinf(distance)
        length = 1.0 if distant else distance
        for i, to_light in enumerate((x, y, z)):
            value[count, i] = reflected[i]
            moved = side * geometric[s, i]
            origin[count, i] = position[s, i] + moved
            aim[count, i] = to_light * length - (0.0 if distant else moved)
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
