"""The World: one frame of a Scene, flattened to world space and normalised. The one thing renderers read.

Normalised means: the centre of the scene's rest-pose bounding box lies at the origin and half its diagonal is 1. Ray offsets of
Mitsuba are absolute near the origin, float32 positions lose digits far from it, and every relative tolerance becomes a plain
number; so the normalisation happens once, here, for GL, ray casting and Mitsuba alike. Intensities of point and spot lights are
multiplied by scale²; radiance and irradiance don't change, so images are those of the scene in metres.

    p_world = (p_metres - centre) · scale,        scale = 1 / half diagonal
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from renderers.scene.geometry import crosses
from renderers.scene.model import (
    GGX,
    DirectionalLight,
    DiscLight,
    Environment,
    Lambert,
    Material,
    Phong,
    PointLight,
    Scene,
    SceneError,
    SphereLight,
    SpotLight,
    Texture,
)
from renderers.scene.placed import Part, Still, joined_triangles, lamp_material, lamp_mesh, still_of, unit
from renderers.scene.transforms import global_matrices, local_matrix, rest_bounds, rotation_matrix

__all__ = [
    "ALPHA_MIN",
    "GGX_KIND",
    "LAMBERT",
    "PHONG",
    "MaterialTable",
    "World",
    "WorldCamera",
    "WorldLight",
    "flatten",
    "global_matrices",
    "local_matrix",
    "rest_bounds",
    "rotation_matrix",
]

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
LAMBERT, PHONG, GGX_KIND = 0, 1, 2
ALPHA_MIN = 1e-3


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """Materials as arrays, one row a material (M rows).

    kind: LAMBERT, PHONG or GGX_KIND. base (M, 3): albedo, Phong diffuse or base colour. specular (M, 3) and exponent (M,): Phong
    only. metallic (M,), alpha (M,): GGX only, alpha = max(roughness², ALPHA_MIN). texture (M,): index into World.textures or -1.
    emission (M, 3); emits_both (M,): emission from the back as well.
    """

    kind: I32
    base: F32
    specular: F32
    exponent: F32
    metallic: F32
    alpha: F32
    emission: F32
    emits_both: NDArray[np.bool_]
    texture: I32


@dataclass(frozen=True, eq=False)
class WorldLight:
    """A point, spot or directional light in the World. Area lights are emissive triangles, the environment is `World.environment`.

    position (3,) float64 (unused when directional), direction (3,): unit, the way the light travels along the axis.
    intensity (3,): W/sr × scale² (point, spot) or W/m² (directional). cos_inner, cos_outer: spot only.
    """

    kind: str
    position: F64
    direction: F64
    intensity: F64
    cos_inner: float = 1.0
    cos_outer: float = 0.0


@dataclass(frozen=True, eq=False)
class WorldCamera:
    """Pinhole camera. pose (4, 4) float64 is rigid, camera to world; looks along -Z; yfov in radians."""

    pose: F64
    yfov: float

    def rays(self, size: tuple[int, int], offset: tuple[float, float] = (0.5, 0.5)) -> tuple[F64, F64]:
        """Origins and unit directions, float64 (H, W, 3) each, through (column + offset[0], row + offset[1]); row 0 on top."""
        width, height = size
        tan = np.tan(self.yfov / 2)
        x = ((np.arange(width) + offset[0]) / width * 2 - 1) * tan * width / height
        y = (1 - (np.arange(height) + offset[1]) / height * 2) * tan
        local = np.stack(np.broadcast_arrays(x[None, :], y[:, None], np.float64(-1.0)), axis=-1)
        directions = local @ self.pose[:3, :3].T
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(self.pose[:3, 3], directions.shape), directions


@dataclass(frozen=True, eq=False)
class World:
    """Triangles, materials, lights and camera of one frame, normalised.

    positions, normals float32 (V, 3); uvs float32 (V, 2); triangles int32 (T, 3), counter-clockwise in front;
    material, instance int32 (T,): row of `materials`, index of the placed mesh. radius and clip distances are in normalised units.
    """

    positions: F32
    normals: F32
    uvs: F32
    triangles: I32
    material: I32
    instance: I32
    materials: MaterialTable
    textures: tuple[Texture, ...]
    lights: tuple[WorldLight, ...]
    environment: Environment | None
    camera: WorldCamera
    centre: F64
    scale: float

    @cached_property
    def areas(self) -> F64:
        """Triangle areas, float64 (T,), normalised units²."""
        return np.asarray(np.linalg.norm(self._cross, axis=-1) / 2)

    @cached_property
    def face_normals(self) -> F64:
        """Unit geometric normals, float64 (T, 3); zero-area triangles don't occur (`flatten` drops them)."""
        return np.asarray(self._cross / np.linalg.norm(self._cross, axis=-1, keepdims=True))

    def areas_of(self, triangles: NDArray[np.integer]) -> F64:
        """`areas[triangles]`, float64 (N,); see `normals_of`."""
        if self._all_pay("areas", triangles):
            return np.asarray(self.areas[triangles])
        return np.asarray(np.linalg.norm(crosses(self.positions, self.triangles[triangles]), axis=-1) / 2)

    def normals_of(self, triangles: NDArray[np.integer]) -> F64:
        """`face_normals[triangles]`, float64 (N, 3), to the bit; where few are asked of a large World, only they are computed."""
        if self._all_pay("face_normals", triangles):
            return np.asarray(self.face_normals[triangles])
        cross = crosses(self.positions, self.triangles[triangles])
        return np.asarray(cross / np.linalg.norm(cross, axis=-1, keepdims=True))

    def _all_pay(self, name: str, triangles: NDArray[np.integer]) -> bool:
        """Whether the values of all triangles are there, or cost no more than those of some."""
        return name in self.__dict__ or len(triangles) >= len(self.triangles)

    @cached_property
    def _cross(self) -> F64:
        return crosses(self.positions, self.triangles)

    @cached_property
    def emissive(self) -> I32:
        """Indices of emissive triangles, int32 (E,)."""
        lit = np.any(self.materials.emission > 0, axis=1)
        return np.flatnonzero(lit[self.material]).astype(np.int32)

    @cached_property
    def clip(self) -> tuple[float, float]:
        """Near and far distance along the camera's axis that contain every vertex in front of it."""
        if not len(self.positions):
            return 0.01, 10.0
        depth = -(self.positions - self.camera.pose[:3, 3]) @ self.camera.pose[:3, 2]
        far = max(float(depth.max()) * 1.001, 1e-3)
        return max(float(depth.min()) * 0.999, far * 1e-4), far


_SHARED: WeakKeyDictionary[World, tuple[Still, NDArray[np.bool_]]] = WeakKeyDictionary()


def flatten(scene: Scene, frame: int) -> World:
    """World of `scene` at `frame`. Raises SceneError for a scene without geometry or camera."""
    centre, radius = rest_bounds(scene)
    posed = scene.at(frame)
    matrices = global_matrices(posed.nodes)
    materials = list(posed.materials)
    parts: list[Part] = []
    lights: list[WorldLight] = []
    scale = 1.0 / radius
    still, moves = still_of(scene), list[bool]()
    for number, (node, matrix) in enumerate(zip(posed.nodes, matrices, strict=True)):
        for k, index in enumerate(node.meshes):
            parts.append(still.placed(number, k, posed.meshes[index], matrix, centre, scale))
        light = None if node.light is None else posed.lights[node.light]
        if isinstance(light, DiscLight | SphereLight):
            parts.append(still.placed(number, len(node.meshes), lamp_mesh(light, len(materials)), matrix, centre, scale))
            materials.append(lamp_material(light))
        elif light is not None:
            lights.append(_placed_light(light, matrix, centre, scale))
        moves += [bool(still.moving[number])] * (len(parts) - len(moves))
    if not any(len(part.triangles) for part in parts):
        raise SceneError(f"{scene.name}: scene has no geometry")
    positions = np.concatenate([p.positions for p in parts])
    if not np.isfinite(positions).all():
        raise SceneError(f"{scene.name}: frame {frame}: positions are not finite")
    world = World(
        positions=positions,
        normals=np.concatenate([p.normals for p in parts]),
        uvs=np.concatenate([p.uvs for p in parts]),
        triangles=joined_triangles(parts),
        material=np.concatenate([np.full(len(p.triangles), p.material, np.int32) for p in parts]),
        instance=np.concatenate([np.full(len(p.triangles), i, np.int32) for i, p in enumerate(parts)]),
        materials=_table(materials),
        textures=posed.textures,
        lights=tuple(lights),
        environment=posed.environment,
        camera=_camera(posed, matrices, centre, scale),
        centre=centre,
        scale=scale,
    )
    if scene.channels:
        _SHARED[world] = still, ~np.array(moves)
    return world


def shared_with_other_frames(world: World) -> tuple[Still, NDArray[np.bool_]] | None:
    """One object for all frames of the World's animated Scene, and which instances stand still in all of them, bool (I,).

    None for a World of a Scene without animation, and for one that `flatten` didn't make.
    """
    return _SHARED.get(world)


def _placed_light(light: PointLight | SpotLight | DirectionalLight, matrix: F64, centre: F64, scale: float) -> WorldLight:
    direction = -unit(matrix[None, :3, 2])[0]
    position = (matrix[:3, 3] - centre) * scale
    intensity = np.array(light.color, np.float64) * light.intensity
    if isinstance(light, DirectionalLight):
        return WorldLight("directional", position, direction, intensity)
    intensity = intensity * scale * scale
    if isinstance(light, PointLight):
        return WorldLight("point", position, direction, intensity)
    return WorldLight("spot", position, direction, intensity, float(np.cos(light.inner_angle)), float(np.cos(light.outer_angle)))


def _table(materials: list[Material]) -> MaterialTable:
    black = (0.0, 0.0, 0.0)
    base = [m.albedo if isinstance(m, Lambert) else m.diffuse if isinstance(m, Phong) else m.base_color for m in materials]
    kinds = [LAMBERT if isinstance(m, Lambert) else PHONG if isinstance(m, Phong) else GGX_KIND for m in materials]
    return MaterialTable(
        kind=np.array(kinds, np.int32),
        base=np.array(base, np.float32).reshape(-1, 3),
        specular=np.array([m.specular if isinstance(m, Phong) else black for m in materials], np.float32).reshape(-1, 3),
        exponent=np.array([m.exponent if isinstance(m, Phong) else 0.0 for m in materials], np.float32),
        metallic=np.array([m.metallic if isinstance(m, GGX) else 0.0 for m in materials], np.float32),
        alpha=np.array([max(m.roughness**2, ALPHA_MIN) if isinstance(m, GGX) else 1.0 for m in materials], np.float32),
        emission=np.array([m.emission for m in materials], np.float32).reshape(-1, 3),
        emits_both=np.array([m.double_sided for m in materials], bool),
        texture=np.array([-1 if m.texture is None else m.texture for m in materials], np.int32),
    )


def _camera(scene: Scene, matrices: list[F64], centre: F64, scale: float) -> WorldCamera:
    placed = [(n.camera, m) for n, m in zip(scene.nodes, matrices, strict=True) if n.camera is not None]
    if not placed:
        raise SceneError(f"{scene.name}: scene has no camera")
    index, matrix = placed[0]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = _rigid(matrix[:3, :3]), (matrix[:3, 3] - centre) * scale
    return WorldCamera(pose, scene.cameras[index].yfov)


def _rigid(linear: F64) -> F64:
    """Right-handed orthonormal axes (3, 3): view axis and up of a camera's node, cleared of scale, shear and mirroring."""
    back = unit(linear[None, :, 2])[0]
    up = linear[:, 1] - (linear[:, 1] @ back) * back
    if not np.linalg.norm(up) > 1e-9 * np.linalg.norm(linear):
        raise SceneError("camera: its node's scale leaves no direction to look in")
    up /= np.linalg.norm(up)
    return np.stack([np.cross(up, back), up, back], axis=1)
