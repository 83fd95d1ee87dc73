"""Placed meshes: what the nodes of a Scene hold, in World coordinates, and which of them never move."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from renderers.scene.geometry import degenerate
from renderers.scene.model import Color, DiscLight, Lambert, Mesh, Scene, SphereLight
from renderers.scene.shapes import disc, sphere
from renderers.scene.transforms import animated_nodes

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]


class Part(NamedTuple):
    """One placed mesh in World coordinates."""

    positions: F32
    normals: F32
    uvs: F32
    triangles: I32
    material: int


@dataclass(eq=False)
class Still:
    """What an animated Scene's frames share: which nodes move, and the placed meshes of the others by node and number."""

    moving: NDArray[np.bool_]
    parts: dict[tuple[int, int], Part] = field(default_factory=dict)

    def placed(self, node: int, number: int, mesh: Mesh, matrix: F64, centre: F64, scale: float) -> Part:
        """`placed` of a node's mesh, kept where the node never moves."""
        if self.moving[node]:
            return placed(mesh, matrix, centre, scale)
        if (node, number) not in self.parts:
            self.parts[node, number] = placed(mesh, matrix, centre, scale)
        return self.parts[node, number]


_STILL: WeakKeyDictionary[Scene, Still] = WeakKeyDictionary()


def still_of(scene: Scene) -> Still:
    """The Scene's `Still`, kept as long as an animated Scene lives; without animation a new one, which keeps nothing."""
    if not scene.channels:
        return Still(np.ones(len(scene.nodes), np.bool_))
    if scene not in _STILL:
        _STILL[scene] = Still(animated_nodes(scene))
    return _STILL[scene]


def placed(mesh: Mesh, matrix: F64, centre: F64, scale: float) -> Part:
    """A mesh under a node's matrix (4, 4), normalised by the Scene's centre and scale. Triangles without area are left out."""
    linear = matrix[:3, :3]
    positions = ((mesh.positions.astype(np.float64) @ linear.T + matrix[:3, 3] - centre) * scale).astype(np.float32)
    triangles = mesh.triangles.astype(np.int32)
    # Normals turn with the cofactor matrix det(M) · M⁻ᵀ, which exists for flattened and vanished instances as well: its columns are
    # cross products of those of M. A mirror turns the winding round, so that the front stays in front.
    a, b, c = linear.T
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    mirrored = float(a @ np.cross(b, c)) < 0
    turned = mesh.normals.astype(np.float64) @ (-cofactors if mirrored else cofactors).T
    if mirrored:
        triangles = triangles[:, ::-1]
    # what has no area in normalised float32 (an instance scaled to nothing) can't be seen and has no normal
    triangles = np.ascontiguousarray(triangles[~degenerate(positions, triangles)])
    uvs = np.zeros((len(positions), 2), np.float32) if mesh.uvs is None else mesh.uvs
    return Part(positions, unit(turned).astype(np.float32), uvs, triangles, mesh.material)


def unit(vectors: F64) -> F64:
    """Unit vectors (N, 3), float64; zero ones, of instances without volume or area, become +Y."""
    largest = np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)
    safe = np.where(largest > 0, vectors / np.where(largest > 0, largest, 1.0), [0.0, 1.0, 0.0])
    return np.asarray(safe / np.linalg.norm(safe, axis=1, keepdims=True))


def lamp_mesh(light: DiscLight | SphereLight, material: int) -> Mesh:
    """The surface of a disc or sphere light, of the material with that number."""
    positions, normals, triangles = disc(light.radius) if isinstance(light, DiscLight) else sphere(light.radius)
    return Mesh(light.name, positions, normals, triangles, material)


def lamp_material(light: DiscLight | SphereLight) -> Lambert:
    """The black emitter that `lamp_mesh` is made of."""
    red, green, blue = light.color
    emission: Color = (red * light.intensity, green * light.intensity, blue * light.intensity)
    return Lambert(light.name, albedo=(0.0, 0.0, 0.0), emission=emission, double_sided=False)


def joined_triangles(parts: list[Part]) -> I32:
    """Triangles of all parts, counting their vertices one part after another."""
    base, joined = 0, []
    for part in parts:
        joined.append(part.triangles + np.int32(base))
        base += len(part.positions)
    return np.concatenate(joined)
