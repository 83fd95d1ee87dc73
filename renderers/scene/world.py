"""The World: one frame of a Scene, flattened to world space and normalised. The one thing renderers read.

Normalised means: the centre of the scene's rest-pose bounding box lies at the origin and half its diagonal is 1. Ray offsets of Mitsuba are
absolute near the origin, float32 positions lose digits far from it, and every relative tolerance becomes a plain number; so the
normalisation happens once, here, for GL, ray casting and Mitsuba alike. Intensities of point and spot lights are multiplied by
scale²; radiance and irradiance don't change, so images are those of the scene in metres.

    p_world = (p_metres - centre) · scale,        scale = 1 / half diagonal
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from renderers.scene.model import (
    GGX,
    DirectionalLight,
    DiscLight,
    Environment,
    Lambert,
    Node,
    Phong,
    PointLight,
    Scene,
    SceneError,
    SphereLight,
    SpotLight,
    Texture,
)
from renderers.scene.shapes import disc, sphere

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
LAMBERT, PHONG, GGX_KIND = 0, 1, 2
ALPHA_MIN = 1e-3


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """Materials as arrays, one row a material (M rows).

    kind: LAMBERT, PHONG or GGX_KIND. base (M, 3): albedo, Phong diffuse or base colour. specular (M, 3) and exponent (M,): Phong only.
    metallic (M,), alpha (M,): GGX only, alpha = max(roughness², ALPHA_MIN). texture (M,): index into World.textures or -1.
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
        """Origins and unit directions, float64 (H, W, 3) each, through pixel (column + offset[0], row + offset[1]); row 0 on top."""
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
        """Unit geometric normals, float64 (T, 3); zero-area triangles don't occur (dropped on load)."""
        return np.asarray(self._cross / np.linalg.norm(self._cross, axis=-1, keepdims=True))

    @cached_property
    def _cross(self) -> F64:
        p = self.positions[self.triangles].astype(np.float64)
        return np.asarray(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]))

    @cached_property
    def emissive(self) -> I32:
        """Indices of emissive triangles, int32 (E,)."""
        lit = self.materials.emission.any(axis=1)
        return np.flatnonzero(lit[self.material]).astype(np.int32)

    @cached_property
    def clip(self) -> tuple[float, float]:
        """Near and far distance along the camera's axis that contain every vertex in front of it."""
        if not len(self.positions):
            return 0.01, 10.0
        depth = -(self.positions - self.camera.pose[:3, 3]) @ self.camera.pose[:3, 2]
        far = max(float(depth.max()) * 1.001, 1e-3)
        return max(float(depth.min()) * 0.999, far * 1e-4), far


def flatten(scene: Scene, frame: int) -> World:
    """World of `scene` at `frame`. Raises SceneError without a camera."""
    centre, radius = rest_bounds(scene)
    posed = scene.at(frame)
    matrices = global_matrices(posed.nodes)
    materials = list(posed.materials)
    parts, lights = [], []
    scale = 1.0 / radius
    for node, matrix in zip(posed.nodes, matrices, strict=True):
        for index in node.meshes:
            mesh = posed.meshes[index]
            parts.append((_placed(mesh.positions, mesh.normals, mesh.triangles, mesh.uvs, matrix, centre, scale), mesh.material))
        if node.light is not None:
            light = posed.lights[node.light]
            emission = tuple(c * light.intensity for c in light.color)
            if isinstance(light, DiscLight | SphereLight):
                shape = disc(light.radius) if isinstance(light, DiscLight) else sphere(light.radius)
                parts.append((_placed(*shape, None, matrix, centre, scale), len(materials)))
                materials.append(Lambert(light.name, albedo=(0.0, 0.0, 0.0), emission=emission, double_sided=False))  # type: ignore[arg-type]
            else:
                lights.append(_placed_light(light, matrix, centre, scale))
    arrays = _joined(parts)
    return World(
        **arrays, materials=_table(materials), textures=posed.textures, lights=tuple(lights), environment=posed.environment,
        camera=_camera(posed, matrices, centre, scale), centre=centre, scale=scale,
    )  # fmt: skip


def global_matrices(nodes: tuple[Node, ...]) -> list[F64]:
    """Local-to-world matrix, float64 (4, 4), of every node; parents may come after children."""
    done: dict[int, F64] = {}
    for start in range(len(nodes)):
        chain = [start]
        while chain[-1] not in done:
            parent = nodes[chain[-1]].parent
            if parent is None:
                done[chain[-1]] = local_matrix(nodes[chain[-1]])
            else:
                chain.append(parent)
        for index in reversed(chain[:-1]):
            parent = nodes[index].parent
            if index not in done and parent is not None:
                done[index] = done[parent] @ local_matrix(nodes[index])
    return [done[i] for i in range(len(nodes))]


def local_matrix(node: Node) -> F64:
    """Matrix of one node alone, float64 (4, 4)."""
    if node.matrix is not None:
        return np.array(node.matrix, np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(node.rotation) * np.array(node.scale)
    matrix[:3, 3] = node.translation
    return matrix


def rotation_matrix(quaternion: tuple[float, float, float, float]) -> F64:
    """Rotation (3, 3) of a quaternion (x, y, z, w), normalised here."""
    x, y, z, w = np.array(quaternion, np.float64) / np.linalg.norm(quaternion)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def rest_bounds(scene: Scene) -> tuple[F64, float]:
    """Centre (3,) and half diagonal in metres of the unanimated geometry's bounding box; (0, 1) for an empty scene."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    boxes = [(m.positions.min(axis=0), m.positions.max(axis=0)) for m in scene.meshes]
    for node, matrix in zip(scene.nodes, global_matrices(scene.nodes), strict=True):
        for index in node.meshes:
            corners = np.array(np.meshgrid(*zip(*boxes[index], strict=True))).reshape(3, -1).T.astype(np.float64)
            placed = corners @ matrix[:3, :3].T + matrix[:3, 3]
            low, high = np.minimum(low, placed.min(axis=0)), np.maximum(high, placed.max(axis=0))
    if not np.all(low <= high):
        return np.zeros(3), 1.0
    radius = float(np.linalg.norm(high - low) / 2)
    return (low + high) / 2, radius if radius > 0 else 1.0


def _placed(positions, normals, triangles, uvs, matrix, centre, scale):  # type: ignore[no-untyped-def]
    linear = matrix[:3, :3]
    world = ((positions.astype(np.float64) @ linear.T + matrix[:3, 3] - centre) * scale).astype(np.float32)
    turned = normals.astype(np.float64) @ np.linalg.inv(linear)
    turned /= np.maximum(np.linalg.norm(turned, axis=-1, keepdims=True), 1e-300)
    if np.linalg.det(linear) < 0:
        triangles = triangles[:, ::-1]
    uvs = np.zeros((len(positions), 2), np.float32) if uvs is None else uvs
    return world, turned.astype(np.float32), triangles.astype(np.int32), uvs


def _placed_light(light: PointLight | SpotLight | DirectionalLight, matrix: F64, centre: F64, scale: float) -> WorldLight:
    direction = -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    position = (matrix[:3, 3] - centre) * scale
    intensity = np.array(light.color, np.float64) * light.intensity
    if isinstance(light, DirectionalLight):
        return WorldLight("directional", position, direction, intensity)
    intensity = intensity * scale * scale
    if isinstance(light, PointLight):
        return WorldLight("point", position, direction, intensity)
    return WorldLight("spot", position, direction, intensity, float(np.cos(light.inner_angle)), float(np.cos(light.outer_angle)))


def _joined(parts):  # type: ignore[no-untyped-def]
    counts = np.cumsum([0] + [len(p[0]) for p, _ in parts])

    def stack(k: int, width: int, dtype: type) -> NDArray:  # type: ignore[type-arg]
        return np.concatenate([p[k] for p, _ in parts]) if parts else np.zeros((0, width), dtype)

    triangles = [p[2] + base for (p, _), base in zip(parts, counts, strict=False)]
    sizes = [len(p[2]) for p, _ in parts]
    return {
        "positions": stack(0, 3, np.float32),
        "normals": stack(1, 3, np.float32),
        "uvs": stack(3, 2, np.float32),
        "triangles": np.concatenate(triangles).astype(np.int32) if parts else np.zeros((0, 3), np.int32),
        "material": np.repeat([m for _, m in parts], sizes).astype(np.int32),
        "instance": np.repeat(np.arange(len(parts)), sizes).astype(np.int32),
    }


def _table(materials: list[Lambert | Phong | GGX]) -> MaterialTable:
    def column(get, shape=()):  # type: ignore[no-untyped-def]
        return np.array([get(m) for m in materials], np.float32).reshape((len(materials), *shape))

    kinds = {Lambert: LAMBERT, Phong: PHONG, GGX: GGX_KIND}
    return MaterialTable(
        kind=np.array([kinds[type(m)] for m in materials], np.int32),
        base=column(lambda m: m.albedo if isinstance(m, Lambert) else m.diffuse if isinstance(m, Phong) else m.base_color, (3,)),
        specular=column(lambda m: m.specular if isinstance(m, Phong) else (0, 0, 0), (3,)),
        exponent=column(lambda m: m.exponent if isinstance(m, Phong) else 0),
        metallic=column(lambda m: m.metallic if isinstance(m, GGX) else 0),
        alpha=column(lambda m: max(m.roughness**2, ALPHA_MIN) if isinstance(m, GGX) else 1),
        emission=column(lambda m: m.emission, (3,)),
        emits_both=np.array([m.double_sided for m in materials], bool),
        texture=np.array([-1 if m.texture is None else m.texture for m in materials], np.int32),
    )


def _camera(scene: Scene, matrices: list[F64], centre: F64, scale: float) -> WorldCamera:
    placed = [(n.camera, m) for n, m in zip(scene.nodes, matrices, strict=True) if n.camera is not None]
    if not placed:
        raise SceneError(f"{scene.name}: scene has no camera")
    index, matrix = placed[0]
    rotation = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, (matrix[:3, 3] - centre) * scale
    return WorldCamera(pose, scene.cameras[index].yfov)
