"""A tree of single-sheet leaf cards: thin geometry, thousands of silhouettes, light filtered through many layers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.parameters import checked
from renderers.scene.builtin.solids import grid, merge, moved, tube
from renderers.scene.model import BLACK, Lambert, Quaternion, Scene
from renderers.scene.shapes import Shape

F64 = NDArray[np.float64]
SPRAY = 16
GREENS = ((0.12, 0.30, 0.05), (0.18, 0.38, 0.07), (0.30, 0.42, 0.08))
GOLDEN = np.pi * (3 - np.sqrt(5))


@checked(count=(16, 200_000), seed=(0, 2**31))
def leaves(count: int = 4000, seed: int = 0) -> Scene:
    """Tree of `count` thin leaf cards (single sheets, 8 triangles each) before a curved backdrop, under a large area light.

    Leaves come in sprays of 16 (the last one smaller), three sprays instanced all over the crown. `seed` grows another tree.
    """
    b = SceneBuilder("leaves")
    rng = np.random.default_rng(seed)
    bark = b.material(Lambert("bark", (0.20, 0.13, 0.08)))
    tips, wood = _branches(rng)
    b.place(wood, bark, "wood")
    _foliage(b, rng, tips, count)
    b.place(_backdrop(), b.material(Lambert("backdrop", (0.62, 0.60, 0.56))), "backdrop")
    lamp = b.material(Lambert("lamp", albedo=BLACK, emission=(16.0, 14.5, 12.5), double_sided=False))
    b.quad([(-2.6, 4.2, -0.2), (-1.0, 4.2, -0.2), (-1.0, 4.2, 1.4), (-2.6, 4.2, 1.4)], lamp, "lamp")
    b.camera((0.9, 1.5, 5.4), (0.05, 1.4, 0.0), np.radians(32))
    return b.build(count=count, seed=seed)


def _branches(rng: np.random.Generator) -> tuple[F64, Shape]:
    """Trunk, ten boughs and six twigs on each: the wood, and the twig points (P, 3) on which leaves grow."""

    def curve(start: F64, end: F64, sag: float, points: int) -> F64:
        t = np.linspace(0, 1, points)[:, None]
        return np.asarray(start * (1 - t) + end * t + sag * 4 * t * (1 - t) * np.array([0.0, 1.0, 0.0]))

    trunk = np.array([(0.04 * np.sin(2.2 * h), h, 0.05 * np.sin(1.7 * h + 1)) for h in np.linspace(-0.02, 1.9, 24)])
    parts, tips = [tube(trunk, np.linspace(0.14, 0.03, 24) + 0.09 * np.exp(-np.linspace(0, 12, 24)), 24)], []
    for bough in range(10):
        start = trunk[10 + bough]
        angle, reach = GOLDEN * bough + rng.uniform(-0.2, 0.2), rng.uniform(0.65, 0.95) * (1.1 - 0.045 * bough)
        end = start + np.array([reach * np.cos(angle), rng.uniform(0.25, 0.65), reach * np.sin(angle)])
        path = curve(start, end, 0.1, 14)
        parts.append(tube(path, np.linspace(0.05, 0.012, 14), 12))
        for twig in range(6):
            root = path[5 + int(1.6 * twig)]
            spread = rng.normal(size=3) * (0.26, 0.16, 0.26) + 0.18 * (end - start)
            way = curve(root, root + spread + (0, 0.12, 0), 0.05, 8)
            parts.append(tube(way, np.linspace(0.012, 0.004, 8), 8))
            tips.append(way[2:])
        tips.append(path[7:])
    return np.concatenate(tips), merge(*parts)


def _foliage(b: SceneBuilder, rng: np.random.Generator, tips: F64, count: int) -> None:
    paints = [b.material(Lambert(f"leaf {k}", color)) for k, color in enumerate(GREENS)]
    sprays = [b.shape(_spray(rng, SPRAY), paint, "spray") for paint in paints]
    whole, rest = divmod(count, SPRAY)
    chosen = [sprays[k] for k in rng.integers(len(sprays), size=whole)]
    if rest:
        chosen.append(b.shape(_spray(rng, rest), paints[0], "last spray"))
    # more leaves are smaller leaves, so that the crown keeps its cover whatever the count
    size = float(1.35 * np.sqrt(4000 / max(count, 250)))
    for mesh in chosen:
        where = tips[int(rng.integers(len(tips)))] + rng.normal(size=3) * 0.06
        b.node(
            name="spray", meshes=(mesh,), translation=tuple(float(v) for v in where),
            rotation=_turn(rng), scale=(size,) * 3,
        )  # fmt: skip


def _turn(rng: np.random.Generator) -> Quaternion:
    """Uniformly random rotation: a normalised Gaussian quaternion."""
    x, y, z, w = rng.normal(size=4)
    length = float(np.sqrt(x * x + y * y + z * z + w * w))
    return float(x) / length, float(y) / length, float(z) / length, float(w) / length


def _spray(rng: np.random.Generator, count: int) -> Shape:
    """`count` leaves along a short twig, folded along the midrib."""
    cards = []
    for k in range(count):
        turn, lift = GOLDEN * k, rng.uniform(0.3, 1.1)
        out = np.array([np.cos(turn) * np.cos(lift), np.sin(lift), np.sin(turn) * np.cos(lift)])
        side = np.cross(out, [0.0, 1.0, 0.0])
        side /= np.linalg.norm(side)
        axes = np.column_stack([side, np.cross(out, side), out])
        cards.append(moved(_leaf(rng.uniform(0.8, 1.2)), (0.0, 0.16 * k / SPRAY, 0.0), axes))
    return merge(*cards)


def _leaf(size: float) -> Shape:
    """Leaf of four quads folded along the midrib, tip along +Z; 0.11 m long at size 1."""
    width, length, fold = 0.032 * size, 0.11 * size, 0.012 * size
    rows = [(0.0, 0.006), (0.45, width), (1.0, 0.006)]
    return grid(
        [[(-w, fold * w / width, t * length), (0.0, 0.0, t * length * 1.05), (w, fold * w / width, t * length)] for t, w in rows]
    )


def _backdrop() -> Shape:
    """Floor that curves up into a back wall."""
    bend = np.linspace(0, np.pi / 2, 17)
    z = np.concatenate([[4.0], -1.6 - 1.4 * np.sin(bend), [-3.0]])
    y = np.concatenate([[0.0], 1.4 - 1.4 * np.cos(bend), [4.6]])
    return grid(np.stack([np.stack([np.full_like(z, x), y, z], axis=-1) for x in np.linspace(9.0, -9.0, 16)], axis=1))
