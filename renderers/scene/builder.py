"""Put a Scene together piece by piece; what the built-in scenes and tests are written with."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from renderers.scene.model import (
    Camera,
    Channel,
    Environment,
    Light,
    Material,
    Mesh,
    Node,
    Quaternion,
    Scene,
    Vector,
)
from renderers.scene.shapes import Shape


class SceneBuilder:
    """Collects parts and returns an immutable Scene from `build`. Every `add_…` returns the index of what it added."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.meshes: list[Mesh] = []
        self.materials: list[Material] = []
        self.nodes: list[Node] = []
        self.lights: list[Light] = []
        self.cameras: list[Camera] = []
        self.channels: list[Channel] = []
        self.environment: Environment | None = None

    def material(self, material: Material) -> int:
        """Add a material."""
        self.materials.append(material)
        return len(self.materials) - 1

    def mesh(
        self, positions: ArrayLike, triangles: ArrayLike, material: int, normals: ArrayLike | None = None, name: str = ""
    ) -> int:
        """Add a mesh; without normals every triangle gets vertices and a flat normal of its own."""
        p, t = np.asarray(positions, np.float32), np.asarray(triangles, np.uint32)
        if normals is None:
            p = p[t].reshape(-1, 3)
            t = np.arange(len(p), dtype=np.uint32).reshape(-1, 3)
            q = p[t].astype(np.float64)
            flat = np.cross(q[:, 1] - q[:, 0], q[:, 2] - q[:, 0])
            flat /= np.linalg.norm(flat, axis=1, keepdims=True)
            normals = np.repeat(flat, 3, axis=0)
        self.meshes.append(Mesh(name, p, np.asarray(normals, np.float32), t, material))
        return len(self.meshes) - 1

    def shape(self, shape: Shape, material: int, name: str = "") -> int:
        """Add a mesh from (positions, normals, triangles); place it with `node(meshes=(index,))`, as often as wanted."""
        self.meshes.append(Mesh(name, *shape, material))
        return len(self.meshes) - 1

    def place(self, shape: Shape, material: int, name: str = "", **parts: object) -> int:
        """Add a mesh from (positions, normals, triangles) and place it once; `parts` are fields of its Node."""
        return self.node(name=name, meshes=(self.shape(shape, material, name),), **parts)

    def animate(self, node: int, path: Literal["translation", "rotation", "scale"], times: ArrayLike, values: ArrayLike) -> None:
        """Linear keys of one node property: times in seconds (K,), values (K, C)."""
        keys = np.asarray(times, np.float64), np.asarray(values, np.float64)
        self.channels.append(Channel("node", node, path, *keys))

    def node(self, **parts: object) -> int:
        """Add a node (fields of Node)."""
        self.nodes.append(Node(**parts))  # type: ignore[arg-type]
        return len(self.nodes) - 1

    def quad(self, corners: ArrayLike, material: int, name: str = "") -> int:
        """Add and place a planar quad: four corners (4, 3), counter-clockwise seen from the front."""
        return self.node(name=name, meshes=(self.mesh(corners, [[0, 1, 2], [0, 2, 3]], material, name=name),))

    def light(self, light: Light, translation: Vector = (0.0, 0.0, 0.0), rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)) -> int:
        """Add and place a light; it shines along the node's -Z."""
        self.lights.append(light)
        return self.node(name=light.name, translation=translation, rotation=rotation, light=len(self.lights) - 1)

    def camera(self, position: ArrayLike, target: ArrayLike, yfov: float, up: ArrayLike = (0, 1, 0)) -> int:
        """Add and place a camera at `position` looking at `target`; yfov in radians."""
        self.cameras.append(Camera("camera", float(yfov)))
        where = np.asarray(position, np.float64)
        return self.node(
            name="camera",
            translation=tuple(float(v) for v in where),
            rotation=look_rotation(np.asarray(target) - where, up),
            camera=len(self.cameras) - 1,
        )

    def build(self, fps: float = 24.0, **parameters: object) -> Scene:
        """The Scene; `parameters` are remembered with it."""
        return Scene(
            name=self.name,
            meshes=tuple(self.meshes),
            materials=tuple(self.materials),
            nodes=tuple(self.nodes),
            lights=tuple(self.lights),
            cameras=tuple(self.cameras),
            channels=tuple(self.channels),
            environment=self.environment,
            fps=fps,
            parameters=parameters,
        )


def look_rotation(direction: ArrayLike, up: ArrayLike = (0, 1, 0)) -> Quaternion:
    """Unit quaternion (x, y, z, w) that turns -Z to `direction` with +Y towards `up`."""
    back = -np.asarray(direction, np.float64)
    back /= np.linalg.norm(back)
    right = np.cross(np.asarray(up, np.float64), back)
    if np.linalg.norm(right) < 1e-9:
        right = np.cross([0.0, 0.0, 1.0] if abs(back[2]) < 0.9 else [1.0, 0.0, 0.0], back)
    right /= np.linalg.norm(right)
    return quaternion_of(np.stack([right, np.cross(back, right), back], axis=1))


def quaternion_of(matrix: NDArray[np.float64]) -> Quaternion:
    """Unit quaternion (x, y, z, w) of a rotation matrix (3, 3), w ≥ 0."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(matrix).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)
