"""Photons leaving the lights: start, direction and flux, importance sampled so that photons of one light carry equal flux.

    point                I(ω) = I                    4πI              uniform sphere
    spot                 glTF falloff s(cos θ)²      2πI (1 - c_i + (c_i - c_o)/3), its cumulative inverted
    directional          irradiance E                E · A⊥(ω)        uniform over the scene's box seen along ω
    emissive triangles   radiance L                  πLA (each side)  uniform by area × luminance, cosine about the face normal
    constant sky         radiance L                  πL · A(box)      uniform over the box's surface, cosine inwards
    lat-long sky         L(ω)                        L(ω) A⊥(ω)/p(ω)  direction ∝ luminance, then as directional

The measure of rays that enter a convex box through its surface is π·A(box), and A⊥(ω) = Σ |ω_a| A_a from one direction: photons of
distant lights start on the scene's bounding box and none misses it. A light is chosen with probability ∝ the luminance of its flux.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.images import LUMA
from renderers.scene.environment import radiance
from renderers.scene.model import Environment
from renderers.scene.world import World, WorldLight
from renderers.transport.environment import EnvironmentSampler
from renderers.transport.photons.counter_random import numbers
from renderers.transport.raycast import OFFSET
from renderers.transport.sampling import cosine_hemisphere, fold, frame, pick, uniform_sphere

F64 = NDArray[np.float64]
DIMENSIONS = 7
PAD = 1e-3


class Rays(NamedTuple):
    """Photons on their way: origin, direction (unit), flux: float64 (N, 3). Flux is still to be divided by the photons emitted."""

    origin: F64
    direction: F64
    flux: F64


Draw = Callable[[F64], Rays]


class Sources:
    """All lights of a World, ready to emit."""

    def __init__(self, world: World) -> None:
        self._world = world
        lights = [(_flux(light, self._box), self._draws(light)) for light in world.lights]
        if len(world.emissive):
            lights.append((self._triangle_flux.sum(axis=0), self._from_triangles))
        if world.environment is not None:
            lights.append(self._sky(world.environment))
        power = np.array([float(flux @ LUMA) for flux, _ in lights])
        lit = np.flatnonzero(power > 0)
        self._draw = [lights[k][1] for k in lit]
        self.probability = power[lit] / power[lit].sum() if len(lit) else power[lit]

    @property
    def dark(self) -> bool:
        """Whether no light emits anything."""
        return not self._draw

    def emit(self, key: np.uint64, photons: NDArray[np.uint64]) -> Rays:
        """Photons of indices uint64 (N,); a photon depends on key and index alone. Raises ValueError where no light emits."""
        if self.dark:
            raise ValueError("no light of the scene emits")
        random = numbers(key, photons, 0, DIMENSIONS)
        source = pick(self.probability, random[:, 0])
        rays = Rays(*(np.empty((len(photons), 3)) for _ in range(3)))
        for k, draw in enumerate(self._draw):
            rows = np.flatnonzero(source == k)
            drawn = draw(random[rows, 1:])
            rays.origin[rows], rays.direction[rows] = drawn.origin, drawn.direction
            rays.flux[rows] = drawn.flux / self.probability[k]
        return rays

    def _draws(self, light: WorldLight) -> Draw:
        kinds = {"point": _from_point, "spot": _from_spot, "directional": _from_far}
        return lambda random: kinds[light.kind](light, self._box, random)

    @cached_property
    def _box(self) -> Box:
        corners = self._world.positions[self._world.triangles].reshape(-1, 3).astype(np.float64)
        return Box(corners.min(axis=0) - PAD, corners.max(axis=0) + PAD)

    @cached_property
    def _triangle_flux(self) -> F64:
        """πLA of each emissive triangle, both sides where both emit, (E, 3)."""
        world, emissive = self._world, self._world.emissive
        material = world.material[emissive]
        sides = np.where(world.materials.emits_both[material], 2.0, 1.0)
        return np.asarray(np.pi * (world.areas[emissive] * sides)[:, None] * world.materials.emission[material].astype(np.float64))

    def _from_triangles(self, random: F64) -> Rays:
        world = self._world
        weights = self._triangle_flux @ LUMA
        chosen, u, v = fold(pick(weights, random[:, 0]), random[:, 1], random[:, 2])
        triangle = world.emissive[chosen]
        corners = world.positions[world.triangles[triangle]].astype(np.float64)
        point = corners[:, 0] + u[:, None] * (corners[:, 1] - corners[:, 0]) + v[:, None] * (corners[:, 2] - corners[:, 0])
        back = world.materials.emits_both[world.material[triangle]] & (random[:, 5] < 0.5)
        normal = np.where(back[:, None], -1, 1) * world.face_normals[triangle]
        direction = cosine_hemisphere(normal, random[:, 3:5])
        return Rays(point + OFFSET * normal, direction, self._triangle_flux[chosen] * (weights.sum() / weights[chosen])[:, None])

    def _sky(self, environment: Environment) -> tuple[F64, Draw]:
        box = self._box
        constant = np.array(environment.radiance, np.float64)
        if environment.image is None:
            flux = constant * np.pi * box.area
            return flux, lambda random: _from_everywhere(flux, box, random)
        sampler = EnvironmentSampler(environment)
        if sampler.black:
            return np.zeros(3), lambda random: _from_everywhere(np.zeros(3), box, random)
        mean = environment.image.reshape(-1, 3).mean(axis=0) * constant
        return mean * np.pi * box.area, lambda random: _from_image(environment, sampler, box, random)


class Box(NamedTuple):
    """Axis-aligned box: low, high float64 (3,)."""

    low: F64
    high: F64

    @property
    def faces(self) -> F64:
        """Area of a face across each axis, (3,)."""
        x, y, z = self.high - self.low
        return np.array([y * z, z * x, x * y])

    @property
    def area(self) -> float:
        """Area of all six faces."""
        return float(2 * self.faces.sum())

    def across(self, direction: F64) -> F64:
        """A⊥, the box's area seen along unit directions (N, 3), float64 (N,)."""
        return np.asarray(np.abs(direction) @ self.faces)

    def entered(self, direction: F64, random: F64) -> F64:
        """Points (N, 3) on the box through which parallel rays of `direction` (N, 3) enter, uniform across; random (N, 3)."""
        share = np.abs(direction) * self.faces
        edges = np.cumsum(share, axis=1) / share.sum(axis=1, keepdims=True)
        axis = (random[:, :1] >= edges[:, :2]).sum(axis=1)
        return self._on_face(axis, np.take_along_axis(direction, axis[:, None], 1)[:, 0] > 0, random[:, 1:])

    def _on_face(self, axis: NDArray[np.intp], lower: NDArray[np.bool_], random: F64) -> F64:
        rows = np.arange(len(axis))
        point = np.empty((len(axis), 3))
        for step in (1, 2):
            other = (axis + step) % 3
            point[rows, other] = self.low[other] + random[:, step - 1] * (self.high - self.low)[other]
        point[rows, axis] = np.where(lower, self.low[axis], self.high[axis])
        return point

    def anywhere(self, random: F64) -> tuple[F64, F64]:
        """Points (N, 3) uniform on the surface and the inward normals there (N, 3); random (N, 3)."""
        face = pick(np.repeat(self.faces, 2), random[:, 0])
        axis, lower = face // 2, face % 2 == 0
        normal = np.zeros((len(face), 3))
        normal[np.arange(len(face)), axis] = np.where(lower, 1.0, -1.0)
        return self._on_face(axis, lower, random[:, 1:]), normal


def _flux(light: WorldLight, box: Box) -> F64:
    if light.kind == "directional":
        return np.asarray(light.intensity * box.across(light.direction[None])[0])
    solid_angle = 4 * np.pi
    if light.kind == "spot":
        solid_angle = 2 * np.pi * (1 - light.cos_inner + (light.cos_inner - light.cos_outer) / 3)
    return np.asarray(light.intensity * solid_angle)


def _from_point(light: WorldLight, box: Box, random: F64) -> Rays:
    n = len(random)
    return Rays(np.tile(light.position, (n, 1)), uniform_sphere(random[:, 1:3]), np.tile(_flux(light, box), (n, 1)))


def _from_spot(light: WorldLight, box: Box, random: F64) -> Rays:
    """Cosine by inversion: share (1 - c_i) uniform in [c_i, 1], share (c_i - c_o)/3 as the density 3 s² of the falloff."""
    n, inner, outer = len(random), light.cos_inner, light.cos_outer
    rim = (inner - outer) / 3
    within = random[:, 0] * (1 - inner + rim) >= rim
    cos = np.where(within, inner + (1 - inner) * random[:, 1], outer + (inner - outer) * np.cbrt(random[:, 1]))
    sin, phi = np.sqrt(np.maximum(0, 1 - cos * cos)), 2 * np.pi * random[:, 2]
    s, t = frame(light.direction[None])
    direction = (sin * np.cos(phi))[:, None] * s + (sin * np.sin(phi))[:, None] * t + cos[:, None] * light.direction
    return Rays(np.tile(light.position, (n, 1)), direction, np.tile(_flux(light, box), (n, 1)))


def _from_far(light: WorldLight, box: Box, random: F64) -> Rays:
    direction = np.tile(light.direction, (len(random), 1))
    return Rays(box.entered(direction, random[:, 1:4]), direction, np.tile(_flux(light, box), (len(random), 1)))


def _from_everywhere(flux: F64, box: Box, random: F64) -> Rays:
    point, normal = box.anywhere(random[:, 1:4])
    return Rays(point, cosine_hemisphere(normal, random[:, 4:6]), np.tile(flux, (len(random), 1)))


def _from_image(environment: Environment, sampler: EnvironmentSampler, box: Box, random: F64) -> Rays:
    towards, density = sampler.sample(random[:, 0:3])
    brought = radiance(environment, towards) * (box.across(towards) / density)[:, None]
    return Rays(box.entered(-towards, random[:, 3:6]), -towards, brought)
