"""From the node tree to matrices and bounds; column vectors, float64."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from renderers.scene.model import Node, Scene, SceneError

F64 = NDArray[np.float64]
_BOUNDS: WeakKeyDictionary[Scene, tuple[F64, float]] = WeakKeyDictionary()


def rotation_matrix(quaternion: tuple[float, float, float, float]) -> F64:
    """Rotation (3, 3) of a quaternion (x, y, z, w), normalised here."""
    x, y, z, w = np.array(quaternion, np.float64) / np.linalg.norm(quaternion)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def local_matrix(node: Node) -> F64:
    """Matrix of one node alone, float64 (4, 4)."""
    if node.matrix is not None:
        return np.array(node.matrix, np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(node.rotation) * np.array(node.scale)
    matrix[:3, 3] = node.translation
    return matrix


def global_matrices(nodes: tuple[Node, ...]) -> list[F64]:
    """Local-to-world matrix, float64 (4, 4), of every node; parents may come after children. Raises SceneError for a cycle."""
    done: dict[int, F64] = {}
    # a chain of large scales may leave float64: the caller judges the bounds that come out
    with np.errstate(over="ignore", invalid="ignore"):
        for start in range(len(nodes)):
            chain = _ancestors(nodes, start, done)
            for index in reversed(chain):
                parent = nodes[index].parent
                local = local_matrix(nodes[index])
                done[index] = local if parent is None else done[parent] @ local
    return [done[i] for i in range(len(nodes))]


def _ancestors(nodes: tuple[Node, ...], start: int, done: dict[int, F64]) -> list[int]:
    """`start` and its ancestors up to the first whose matrix is known."""
    chain: list[int] = []
    index: int | None = start
    while index is not None and index not in done:
        if len(chain) > len(nodes):
            raise SceneError(f"nodes[{start}]: node graph has a cycle")
        chain.append(index)
        index = nodes[index].parent
    return chain


def animated_nodes(scene: Scene) -> NDArray[np.bool_]:
    """Which nodes an animation moves, themselves or an ancestor, bool (N,)."""
    own = {channel.index for channel in scene.channels if channel.target == "node"}
    return np.array([not own.isdisjoint(_ancestors(scene.nodes, index, {})) for index in range(len(scene.nodes))], np.bool_)


def rest_bounds(scene: Scene) -> tuple[F64, float]:
    """Centre (3,) and half diagonal in metres of the unanimated geometry's bounding box; (0, 1) for an empty scene.

    Only vertices that a triangle uses count. A half diagonal that leaves float64 comes back infinite. Reckoned once for each Scene.
    """
    if scene not in _BOUNDS:
        _BOUNDS[scene] = _bounds(scene)
        _BOUNDS[scene][0].setflags(write=False)
    return _BOUNDS[scene]


def _bounds(scene: Scene) -> tuple[F64, float]:
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    boxes = [_corners(mesh.positions[mesh.triangles.reshape(-1)]) for mesh in scene.meshes]
    with np.errstate(over="ignore", invalid="ignore"):
        for node, matrix in zip(scene.nodes, global_matrices(scene.nodes), strict=True):
            for index in node.meshes:
                placed = boxes[index] @ matrix[:3, :3].T + matrix[:3, 3]
                low, high = (
                    np.minimum(low, placed.min(axis=0, initial=np.inf)),
                    np.maximum(high, placed.max(axis=0, initial=-np.inf)),
                )
        if np.all(np.isinf(low) & (low > 0)):
            return np.zeros(3), 1.0
        centre, radius = (low + high) / 2, float(np.linalg.norm(high - low) / 2)
    if not np.isfinite(radius):
        return centre, np.inf
    return centre, 1.0 if radius == 0 else radius


def _corners(points: NDArray[np.float32]) -> F64:
    """The eight corners of the bounding box, float64 (8, 3); (0, 3) of no points."""
    if not len(points):
        return np.zeros((0, 3))
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    upper = (np.arange(8)[:, None] >> np.arange(3)) & 1
    return np.asarray(np.where(upper == 1, high, low))
