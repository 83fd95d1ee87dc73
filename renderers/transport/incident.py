"""Light samples: for each receiver, directions towards the lights with the light they would bring unshadowed.

Every Incident is one sample of one light for all receivers of a chunk. Summed over all of them, Σ f(l, v) max(0, n·l) · weight · V
is an unbiased estimate of reflected direct light; with f = 1 it is irradiance. Punctual lights need one sample and have no noise.
Emissive triangles and the environment take `samples` points of a Sobol' set each, rotated per receiver by a random shift (Cranley &
Patterson 1976): stratified over the emitters, independent between receivers.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from renderers.images import LUMA
from renderers.scene.environment import radiance
from renderers.scene.world import World, WorldLight
from renderers.transport.environment import EnvironmentSampler
from renderers.transport.sampling import cosine_hemisphere, fold, pick

F64 = NDArray[np.float64]


class Incident(NamedTuple):
    """direction (N, 3) to the light, unit; weight (N, 3): irradiance at normal incidence; distance (N,), inf for distant lights."""

    direction: F64
    weight: F64
    distance: F64


class Lights:
    """All lights of a World, ready to be sampled. `samples` per receiver: of all area lights together, and as many of the sky."""

    def __init__(self, world: World, samples: int) -> None:
        self._world = world
        self.samples = samples
        self.stochastic = bool(len(world.emissive)) or world.environment is not None

    def incident(self, position: F64, normal: F64, shifts: F64) -> Iterator[Incident]:
        """Samples for receivers at position (N, 3) with shading normals (N, 3); shifts (N, 6) in [0, 1) move the Sobol' sets."""
        for light in self._world.lights:
            yield punctual(light, position)
        yield from self.distributed(position, normal, shifts)

    def distributed(self, position: F64, normal: F64, shifts: F64) -> Iterator[Incident]:
        """The samples of emissive triangles and of the environment among `incident`."""
        if len(self._world.emissive):
            for point in self._sobol:
                yield self._area(position, (point + shifts[:, :3]) % 1.0)
        if self._world.environment is not None and any(self._world.environment.radiance):
            for point in self._sobol:
                sample = self._sky(normal, (point + shifts[:, 3:]) % 1.0)
                if sample is not None:
                    yield sample

    @cached_property
    def _sobol(self) -> F64:
        power = max(self.samples - 1, 0).bit_length()
        return np.asarray(qmc.Sobol(3, scramble=False).random_base2(power)[: self.samples])

    @cached_property
    def _emitters(self) -> tuple[F64, F64, F64]:
        """Probability of each emissive triangle ∝ area × luminance, its density per area, (E,) each, and its normal (E, 3)."""
        world = self._world
        area = world.areas_of(world.emissive)
        power = area * (world.materials.emission[world.material[world.emissive]].astype(np.float64) @ LUMA)
        probability = power / power.sum()
        return probability, probability / area, world.normals_of(world.emissive)

    def _area(self, position: F64, random: F64) -> Incident:
        world = self._world
        probability, density, normals = self._emitters
        chosen, u, v = fold(pick(probability, random[:, 0]), random[:, 1], random[:, 2])
        triangle = world.emissive[chosen]
        corners = world.positions[world.triangles[triangle]].astype(np.float64)
        point = corners[:, 0] + u[:, None] * (corners[:, 1] - corners[:, 0]) + v[:, None] * (corners[:, 2] - corners[:, 0])
        direction, distance = _towards(position, point)
        cosine = -np.einsum("ij,ij->i", normals[chosen], direction)
        material = world.material[triangle]
        cosine = np.where(world.materials.emits_both[material], np.abs(cosine), np.maximum(cosine, 0))
        scale = cosine / (np.maximum(distance, 1e-12) ** 2 * density[chosen] * self.samples)
        return Incident(direction, world.materials.emission[material] * scale[:, None], distance)

    def _sky(self, normal: F64, random: F64) -> Incident | None:
        environment = self._world.environment
        if environment is None:
            return None
        distance = np.full(len(normal), np.inf)
        if environment.image is None:
            direction = cosine_hemisphere(normal, random[:, 1:])
            cosine = np.maximum(np.einsum("ij,ij->i", normal, direction), 1e-12)
            weight = np.array(environment.radiance) * (np.pi / (cosine * self.samples))[:, None]
            return Incident(direction, weight, distance)
        if self._sky_sampler is None:
            return None
        direction, density = self._sky_sampler.sample(random)
        return Incident(direction, radiance(environment, direction) / (density * self.samples)[:, None], distance)

    @cached_property
    def _sky_sampler(self) -> EnvironmentSampler | None:
        assert self._world.environment is not None
        sampler = EnvironmentSampler(self._world.environment)
        return None if sampler.black else sampler


def punctual(light: WorldLight, position: F64) -> Incident:
    """Point, spot (glTF falloff, squared) or directional light at receivers (N, 3)."""
    n = len(position)
    if light.kind == "directional":
        return Incident(np.tile(-light.direction, (n, 1)), np.tile(light.intensity, (n, 1)), np.full(n, np.inf))
    direction, distance = _towards(position, light.position)
    scale = 1 / np.maximum(distance, 1e-12) ** 2
    if light.kind == "spot":
        cosine = -direction @ light.direction
        width = max(light.cos_inner - light.cos_outer, 1e-6)
        scale = scale * np.clip((cosine - light.cos_outer) / width, 0, 1) ** 2
    return Incident(direction, light.intensity * scale[:, None], distance)


def _towards(position: F64, target: F64) -> tuple[F64, F64]:
    difference = target - position
    distance = np.linalg.norm(difference, axis=-1)
    return difference / np.maximum(distance, 1e-12)[:, None], distance
