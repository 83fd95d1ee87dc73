"""Shadow maps: per texel the distance from the light to the first surface, float32, linear.

Tiles. Directional light: one tile, parallel rays over the World's bounds. Spot: one tile as wide as its cone. Point light:
six tiles, the faces of a cube. Area sample: five, the half cube in front of it. Tiles lie on top of one another in one R32F
texture; a tile is wider than its share by a border, so percentage-closer filtering never looks across an edge.

Bias. The light's ray through a texel's centre is met with the receiver's own plane, and that distance is compared with the
stored one, so a plane never shadows itself whatever its slope (a slope-scaled bias without a guessed slope; clamped to ±40
texel footprints). Where two surfaces meet, a texel's centre can lie on the other one: the receiver is lifted along its
geometric normal by NORMAL_OFFSET texel footprints, more under PCF. Contact shadows are lost over about that width, and float
rounding is covered by 1e-5 of the scene size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from renderers.gl import camera, passes
from renderers.gl.context import context, device
from renderers.gl.lights import LightSample
from renderers.gl.programs import assign, program
from renderers.gl.upload import upload
from renderers.reflective import LightView
from renderers.scene.world import F64, World

NORMAL_OFFSET = 0.25
NEAR = 1e-5  # under LIFT, so that an area sample's own triangle stays out of its map
FAR_AWAY = 1e30
WIDEST_SPOT = np.radians(60.0)  # half angle; beyond it a cube wastes less
FACES = np.array([[0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], np.float64)


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """One light's map. views (n, 3, 3): world to tile, a tile looks along -Z. centre, half (2,): of a parallel tile in its x and y;
    a perspective tile has centre 0 and half = tangents of its half angle. texture: R32F, (resolution, n · resolution)."""

    texture: Any
    resolution: int
    parallel: bool
    views: F64
    origin: F64
    centre: F64
    half: F64

    def bind(self, target: Any, unit: int, taps: int) -> None:
        """Set the uniforms of `shadow.glsl`; taps: PCF over (2 taps + 1)² texels, 0 for the hard test."""
        self.texture.use(unit)
        views = np.zeros((6, 3, 3), np.float32)
        views[: len(self.views)] = np.swapaxes(self.views, 1, 2)
        assign(
            target,
            shadow_map=unit,
            shadow_tiles=len(self.views),
            shadow_resolution=self.resolution,
            shadow_parallel=self.parallel,
            shadow_view=views.tobytes(),
            shadow_origin=tuple(self.origin),
            shadow_centre=tuple(self.centre),
            shadow_half=tuple(self.half),
            shadow_offset=NORMAL_OFFSET * (1 + taps),
            shadow_taps=taps,
        )

    def release(self) -> None:
        """Delete the texture."""
        self.texture.release()


def shadow_map(world: World, light: LightSample, resolution: int = 1024, taps: int = 0) -> ShadowMap:
    """Render the map of one light sample; `taps`: the widest PCF it will be read with. The caller releases it. Raises GLError."""
    seen = light_view(world, light, resolution, taps)
    views = seen.views
    size = (resolution, resolution * len(views))
    texture, buffer = context().texture(size, 1, dtype="f4"), passes.depth_target(size)
    target = passes.framebuffer([texture], buffer)
    passes.clear(target, (FAR_AWAY, 0.0, 0.0, 0.0), depth=0.0)
    shader = program("shadow.vert.glsl", "shadow.frag.glsl")
    uploaded = upload(world)
    vertices = uploaded.vertex_array(shader, "in_position")
    assign(shader, parallel=seen.parallel, origin=tuple(light.position), axis=tuple(light.axis))
    for k in range(len(views)):
        target.viewport = (0, k * resolution, resolution, resolution)
        assign(shader, clip_matrix=camera.column_major(clip_matrix(seen, k)))
        passes.draw(target, vertices, "shadow map", depth=True, vertices=3 * uploaded.triangles)
    passes.release(target, buffer)
    return ShadowMap(texture, resolution, seen.parallel, views, light.position, seen.centre, seen.half)


def light_view(world: World, light: LightSample, resolution: int, taps: int = 0) -> LightView:
    """The tiles of a light sample, with a border for PCF over (2 taps + 1)² texels; needs no GL context."""
    views, half = _tiles(light, resolution, taps)
    centre, depth = np.zeros(2), (0.0, 1.0)
    if light.kind == "directional":
        centre, half, depth = _parallel_bounds(world, views[0], resolution, taps)
    return LightView(
        light.kind, light.position, light.axis, light.intensity, light.cosines, views, half, centre, depth, resolution
    )  # fmt: skip


def clip_matrix(view: LightView, tile: int) -> F64:
    """World to clip space of one tile, (4, 4)."""
    zero_to_one, rotation = device().zero_to_one, view.views[tile]
    if view.parallel:
        matrix = np.eye(4)
        matrix[:3, :3] = rotation
        return camera.orthographic(view.centre, view.half, view.depth, zero_to_one=zero_to_one) @ matrix
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.T, view.origin
    tangents = float(view.half[0]), float(view.half[1])
    return camera.perspective(tangents, NEAR, zero_to_one=zero_to_one) @ camera.view(pose)


def _tiles(light: LightSample, resolution: int, taps: int) -> tuple[F64, F64]:
    """Rotations (n, 3, 3) and tangents (2,) of a light's tiles, the border for PCF included."""
    frame = _frame(light.axis)
    border = resolution / max(resolution - 2 * (taps + 1), 1)
    if light.kind == "directional":
        return frame[None], np.ones(2)
    angle = float(np.arccos(np.clip(light.cosines[1], -1.0, 1.0)))
    if light.kind == "spot" and angle <= WIDEST_SPOT:
        return frame[None], np.full(2, np.tan(max(angle, 1e-3)) * border)
    faces = FACES if light.kind == "point" else FACES[:5]
    return np.stack([_frame(face) @ frame for face in faces]), np.full(2, border)


def _frame(axis: F64) -> F64:
    """Rotation (3, 3) that turns `axis` to -Z."""
    back = -axis / np.linalg.norm(axis)
    other = np.eye(3)[np.argmin(np.abs(back))]
    right = np.cross(other, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def _parallel_bounds(world: World, rotation: F64, resolution: int, taps: int) -> tuple[F64, F64, tuple[float, float]]:
    """Centre and half extent (2,) of the World in a tile's x and y, and its range of depth along -Z."""
    if not len(world.positions):
        return np.zeros(2), np.ones(2), (-1.0, 1.0)
    low, high = world.positions.min(axis=0), world.positions.max(axis=0)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T @ rotation.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    border = resolution / max(resolution - 2 * (taps + 1), 1)
    half = np.maximum((high - low)[:2] / 2, 1e-4) * border
    return (low + high)[:2] / 2, half, (float(-high[2]) - 1e-3, float(-low[2]) + 1e-3)
