"""A kite: very thin, high above the floor it lights, with a long swaying tail."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.boxes import FPS
from renderers.scene.builtin.parameters import checked
from renderers.scene.builtin.rooms import open_room
from renderers.scene.builtin.solids import grid, merge, patch, tube
from renderers.scene.model import Lambert, Phong, PointLight, Scene
from renderers.scene.shapes import Shape

TAIL, LINK = 9, 0.12


@checked(frames=(2, 100_000))
def kite(frames: int = 300) -> Scene:
    """Thin single-sheet kite with a nine-link tail that sails down through a chequered hall, about 28,000 triangles; `frames` long.

    The kite descends and turns (one moving node), every tail link sways about the one before it (a chain of nine moving nodes).
    """
    b = SceneBuilder("kite")
    white, left, right = (
        b.material(Lambert(n, c)) for n, c in (("white", (0.72,) * 3), ("left", (0.62, 0.5, 0.3)), ("right", (0.35, 0.5, 0.6)))
    )
    open_room(b, (-2.5, 0, -2), (2.5, 3, 2), white=white, left=left, right=right, floor=-1)
    _chequers(b)
    sail = _sail(b, frames)
    _tail(b, sail, frames)
    b.light(PointLight("lamp", (1.0, 0.92, 0.78), 12.0), (1.7, 2.7, 1.4))
    b.camera((0.0, 1.35, 6.0), (0.0, 1.4, 0.0), np.radians(38))
    return b.build(fps=FPS, frames=frames)


def _chequers(b: SceneBuilder) -> None:
    for parity, color in ((0, (0.55, 0.5, 0.42)), (1, (0.22, 0.2, 0.18))):
        tiles = []
        for i, k in ((i, k) for i in range(10) for k in range(8) if (i + k) % 2 == parity):
            x, z = -2.5 + i / 2, -2 + k / 2
            tiles.append(patch([(x, 0, z), (x, 0, z + 0.5), (x + 0.5, 0, z + 0.5), (x + 0.5, 0, z)], 6, 6))
        b.place(merge(*tiles), b.material(Lambert("tile", color)), "tiles")


def _sail(b: SceneBuilder, frames: int) -> int:
    """Four cloth panels between the spars, bellied by the wind, and the node that flies them."""
    red, cream = b.material(Lambert("red cloth", (0.75, 0.08, 0.06))), b.material(Lambert("cream cloth", (0.85, 0.75, 0.5)))
    wood = b.material(Phong("spar", diffuse=(0.3, 0.18, 0.08), specular=(0.25,) * 3, exponent=20.0))
    top, bottom, west, east = (0.0, 0.5, 0.0), (0.0, -0.8, 0.0), (-0.55, 0.12, 0.0), (0.55, 0.12, 0.0)
    middle = (0.0, 0.12, 0.0)
    reds = merge(_panel(middle, top, west), _panel(middle, bottom, east))
    creams = merge(_panel(middle, east, top), _panel(middle, west, bottom))
    spars = merge(*(tube(np.linspace(p, q, 24), 0.008, 10) for p, q in ((top, bottom), (west, east))))
    meshes = b.shape(reds, red, "sail"), b.shape(creams, cream, "sail"), b.shape(spars, wood, "spars")
    node = b.node(name="kite", meshes=meshes, translation=(-0.9, 2.3, -0.2))
    u = np.arange(frames + 1) / frames
    path = np.column_stack(
        [1.0 * np.sin(2 * np.pi * u - 1.2), 2.3 - 0.3 * u + 0.06 * np.sin(6 * np.pi * u), 0.5 * np.cos(2 * np.pi * u) - 0.4]
    )
    turns = _turns(
        "YXZ", np.column_stack([0.5 * np.sin(2 * np.pi * u), -0.5 + 0.15 * np.sin(4 * np.pi * u), 0.6 * np.cos(2 * np.pi * u)])
    )
    b.animate(node, "translation", np.arange(frames + 1) / FPS, path)
    b.animate(node, "rotation", np.arange(frames + 1) / FPS, turns)
    return node


def _panel(a: tuple[float, ...], p: tuple[float, ...], q: tuple[float, ...], cells: int = 40) -> Shape:
    """Bellied cloth triangle a, p, q; its narrow end is cut 2 % before p, so no triangle has zero area."""
    u, v = np.linspace(0, 0.98, cells + 1)[:, None], np.linspace(0, 1, cells + 1)[None, :]
    corners = [np.array(c) for c in (a, p, q)]
    weight = [(1 - u) * (1 - v), u + 0 * v, (1 - u) * v]
    points = sum(w[..., None] * c for w, c in zip(weight, corners, strict=True))
    belly = 1.2 * weight[0] * weight[1] + 0.9 * weight[1] * weight[2] + 0.6 * weight[0] * weight[2]
    return grid(points + belly[..., None] * np.array([0.0, 0.0, -0.35]))


def _turns(axes: str, angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions (n, 4) of Euler angles (n, len(axes)); scipy is loaded here, since listing scenes must not cost its import."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler(axes, angles).as_quat())


def _tail(b: SceneBuilder, sail: int, frames: int) -> None:
    """Nine links of ribbon with a bow each; link k is a child of link k - 1 and swings with a delay."""
    ribbon = b.material(Lambert("ribbon", (0.8, 0.6, 0.15)))
    bow = b.material(Lambert("bow", (0.1, 0.25, 0.65)))
    t = np.linspace(0, 1, 25)
    strip = np.stack([np.column_stack([s * np.cos(2 * t), -LINK * t, s * np.sin(2 * t)]) for s in (-0.02, 0.02)], axis=1)
    s, w = np.meshgrid(np.linspace(-1, 1, 33), np.linspace(-1, 1, 13), indexing="ij")
    wings = np.stack([0.1 * s, -LINK / 2 + 0.05 * w * (0.2 + np.abs(s)), 0.02 * np.sin(3 * s)], axis=-1)
    meshes = b.shape(grid(strip), ribbon, "ribbon"), b.shape(grid(wings), bow, "bow")
    parent, time = sail, np.arange(frames + 1)
    for k in range(TAIL):
        node = b.node(name=f"tail {k}", parent=parent, meshes=meshes, translation=(0.0, -0.8 if k == 0 else -LINK, 0.0))
        swing = 0.16 * np.sin(2 * np.pi * (6 * time / frames - k / 7)) + (0.25 if k == 0 else 0.0)
        b.animate(node, "rotation", time / FPS, _turns("ZX", np.column_stack([swing, 0.6 * swing])))
        parent = node
