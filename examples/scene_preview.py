"""Draw a contact sheet of the built-in scenes by ray casting with a headlight: python examples/scene_preview.py OUT.png [SCENE…].

A quick look at geometry, winding and framing; no light transport. Colours are albedos times the cosine to the viewer.
"""

from __future__ import annotations

import sys

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from PIL import Image

import renderers

SIZE, COLUMNS = (320, 180), 4


def view(name: str) -> np.ndarray:
    """Shaded first hits, uint8 (H, W, 3), row 0 on top; emitters are white, back faces blue."""
    world = renderers.load_scene(name).world(0)
    caster = EmbreeScene()
    TriangleMesh(caster, np.ascontiguousarray(world.positions[world.triangles]))
    origins, ways = (np.ascontiguousarray(a.reshape(-1, 3), np.float32) for a in world.camera.rays(SIZE))
    hit = caster.run(origins, ways)
    cosine = -np.einsum("pi,pi->p", world.face_normals[hit], ways)
    color = world.materials.base[world.material[hit]] * np.abs(cosine)[:, None]
    color[np.isin(hit, world.emissive)] = 1
    color[cosine < 0] *= (0.5, 0.5, 1.0)
    color[hit < 0] = 0
    return np.asarray((255 * color ** (1 / 2.2)).astype(np.uint8).reshape(SIZE[1], SIZE[0], 3))


def main() -> None:
    out, names = sys.argv[1], sys.argv[2:] or list(renderers.builtin_scenes())
    rows = -(-len(names) // COLUMNS)
    sheet = np.zeros((rows, SIZE[1], COLUMNS, SIZE[0], 3), np.uint8)
    for k, name in enumerate(names):
        sheet[k // COLUMNS, :, k % COLUMNS] = view(name)
    Image.fromarray(sheet.reshape(rows * SIZE[1], COLUMNS * SIZE[0], 3)).save(out)


if __name__ == "__main__":
    main()
