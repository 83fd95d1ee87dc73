"""Bouncing spheres, diffuse and glossy, before a glossy wall."""

from __future__ import annotations

import numpy as np

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.boxes import FPS
from renderers.scene.builtin.parameters import checked
from renderers.scene.builtin.rooms import open_room
from renderers.scene.model import Lambert, Phong, PointLight, Scene
from renderers.scene.shapes import sphere

COLUMNS, ROWS = 11, 6
PAINTS = (
    (0.70, 0.12, 0.08), (0.85, 0.45, 0.08), (0.80, 0.70, 0.20), (0.20, 0.50, 0.15), (0.10, 0.45, 0.55), (0.12, 0.20, 0.60),
    (0.45, 0.12, 0.45),
)  # fmt: skip


@checked(frames=(2, 100_000), seed=(0, 2**31))
def bouncing_spheres(frames: int = 200, seed: int = 0) -> Scene:
    """66 bouncing spheres of 968 triangles, diffuse and glossy, in a room with a glossy back wall; a loop of `frames` frames.

    Each sphere keeps to its own cell of an 11 × 6 grid, so none ever touches another. `seed` chooses sizes, heights, phases and
    colours.
    """
    b = SceneBuilder("bouncing-spheres")
    rng = np.random.default_rng(seed)
    white, warm = b.material(Lambert("white", (0.75,) * 3)), b.material(Lambert("floor", (0.6, 0.55, 0.5)))
    back = b.material(Phong("back", diffuse=(0.15, 0.15, 0.18), specular=(0.6,) * 3, exponent=30.0))
    left, right = b.material(Lambert("left", (0.6, 0.25, 0.12))), b.material(Lambert("right", (0.15, 0.3, 0.5)))
    open_room(b, (-3, 0, -3), (3, 3, 2), white=white, left=left, right=right, back=back, floor=warm)
    ball = sphere(1.0, 22, 23)
    meshes = [b.shape(ball, b.material(Lambert(f"matte {k}", c)), "ball") for k, c in enumerate(PAINTS)]
    for k, (red, green, blue) in enumerate(PAINTS):
        gloss = Phong(f"glossy {k}", diffuse=(0.4 * red, 0.4 * green, 0.4 * blue), specular=(0.5,) * 3, exponent=25.0)
        meshes.append(b.shape(ball, b.material(gloss), "ball"))
    for index in range(COLUMNS * ROWS):
        radius = float(rng.uniform(0.13, 0.2))
        x = -2.5 + 5.0 * (index % COLUMNS) / (COLUMNS - 1) + rng.uniform(-0.04, 0.04)
        z = -2.6 + 3.2 * (index // COLUMNS) / (ROWS - 1) + rng.uniform(-0.08, 0.08)
        mesh = meshes[int(rng.integers(len(PAINTS))) + len(PAINTS) * (index % 2)]
        node = b.node(name=f"sphere {index}", meshes=(mesh,), translation=(x, radius, z), scale=(radius,) * 3)
        time = np.arange(frames + 1)
        phase = (time * int(rng.integers(3, 8)) / frames + rng.random()) % 1
        height = radius + 4 * rng.uniform(0.4, 1.9) * phase * (1 - phase)
        b.animate(node, "translation", time / FPS, np.column_stack([np.full(frames + 1, x), height, np.full(frames + 1, z)]))
    b.light(PointLight("lamp", (1.0, 0.95, 0.85), 18.0), (0.4, 2.75, -0.2))
    b.camera((0.0, 1.75, 4.9), (0.0, 1.15, -1.0), np.radians(36))
    return b.build(fps=FPS, frames=frames, seed=seed)
