"""The rasterised G-buffer against pixel-centre rays, at every scene scale, and its bytes in other processes."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from renderers.gbuffer import GBuffer
from renderers.gl.gbuffer import render_gbuffer
from renderers.scene.builder import SceneBuilder
from renderers.scene.load import load_scene
from renderers.scene.model import Lambert, Scene
from renderers.scene.shapes import sphere
from renderers.scene.world import World

pytestmark = pytest.mark.gl
SIZE = (96, 54)


def scaled(scene: Scene, factor: float) -> Scene:
    """The scene with every length multiplied by `factor`, through a new root node."""
    nodes = [replace(n, parent=len(scene.nodes) if n.parent is None else n.parent) for n in scene.nodes]
    root = SceneBuilder("root")
    root.node(scale=(factor, factor, factor), translation=(3 * factor, -2 * factor, factor))
    return replace(scene, nodes=(*nodes, *root.nodes))


def cast(world: World, offset: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Triangle (-1: none) and position float64 of the first hit of each pixel's ray."""
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(world.positions[world.triangles]))
    origins, directions = world.camera.rays(SIZE, offset)
    flat = [np.ascontiguousarray(a.reshape(-1, 3), np.float32) for a in (origins, directions)]
    found = scene.run(*flat, output=1)
    t = found["tfar"].reshape(SIZE[::-1]).astype(float)
    triangle = found["primID"].reshape(SIZE[::-1])
    return triangle, origins + directions * np.where(triangle >= 0, t, 0)[..., None]


def compare(world: World, g: GBuffer, offset: tuple[float, float]) -> None:
    triangle, position = cast(world, offset)
    assert np.mean((triangle >= 0) != g.covered) < 1e-3
    both = (triangle >= 0) & g.covered
    assert np.mean(triangle[both] != g.triangle[both]) < 2e-3  # silhouettes: vertices snap to 1/256 pixel
    same = both & (triangle == g.triangle)
    assert np.quantile(np.linalg.norm(position - g.position, axis=-1)[same], 0.99) < 1e-5
    assert np.abs(np.linalg.norm(g.normal[g.covered], axis=-1) - 1).max() < 1e-6
    assert np.sum(g.normal * (g.eye - g.position), axis=-1)[g.covered].min() >= 0
    assert np.array_equal(g.material[g.covered], world.material[g.triangle[g.covered]])
    for layer in (g.position, g.normal, g.base, g.emission):
        assert not layer[~g.covered].any()
    assert np.all(g.triangle[~g.covered] == -1)
    assert np.all(g.material[~g.covered] == -1)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("offset", [(0.5, 0.5), (0.125, 0.75)])
def test_cornell_box_agrees_with_rays(scale, offset):
    world = scaled(load_scene("cornell-box"), scale).world()
    g = render_gbuffer(world, SIZE, offset)
    assert g.covered.any()
    assert not g.covered.all()
    compare(world, g, offset)
    flat = world.face_normals[g.triangle[g.covered]]
    assert np.abs(np.abs(np.sum(flat * g.normal[g.covered], axis=-1)) - 1).max() < 1e-5
    assert np.allclose(g.base[g.covered], world.materials.base[g.material[g.covered]], atol=0)


def test_camera_among_the_geometry():
    """Triangles that pass behind the eye are clipped near it, and keep their positions."""
    b = SceneBuilder("inside")
    m = b.material(Lambert())
    p, n, t = sphere(3.0, 32, 16)
    b.node(meshes=(b.mesh(p, t, m, n),))
    b.quad([(-50, -1, 50), (50, -1, 50), (50, -1, -50), (-50, -1, -50)], m)
    b.camera((0.3, 0.2, 0.1), (1, -0.4, -0.8), 1.2)
    world = b.build().world()
    g = render_gbuffer(world, SIZE)
    assert g.covered.all()
    compare(world, g, (0.5, 0.5))


def test_emission_leaves_the_front_only():
    def seen(double_sided: bool, flip: bool) -> np.ndarray:
        b = SceneBuilder("lamp")
        m = b.material(Lambert("lamp", (0, 0, 0), emission=(1.0, 2.0, 3.0), double_sided=double_sided))
        corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
        b.quad(corners[::-1] if flip else corners, m)
        b.camera((0, 0, 3), (0, 0, 0), 0.4)
        return render_gbuffer(b.build().world(), (8, 8)).emission[4, 4]

    assert seen(False, False).tolist() == [1, 2, 3]
    assert seen(False, True).tolist() == [0, 0, 0]
    assert seen(True, True).tolist() == [1, 2, 3]


CHILD = """
import hashlib
from renderers.gl.direct import direct
from renderers.gl.gather import gather
from renderers.gl.gbuffer import render_gbuffer
from renderers.scene.load import load_scene
import numpy as np
world = load_scene("cornell-box").world()
g = render_gbuffer(world, (48, 27))
lights = np.random.default_rng(1).normal(size=(3, 2000, 3))
parts = [g.position, g.normal, g.base, g.triangle, direct(world, g, 128), gather(g, world, *lights[:2], abs(lights[2]), 1e-3)]
print(hashlib.sha256(b"".join(p.tobytes() for p in parts)).hexdigest())
"""


def test_same_bytes_in_any_process_at_any_thread_count():
    path = os.pathsep.join([os.getcwd(), *filter(None, [os.environ.get("PYTHONPATH")])])

    def digest(threads: str) -> str:
        return subprocess.run(
            [sys.executable, "-c", CHILD], env=os.environ | {"LP_NUM_THREADS": threads, "PYTHONPATH": path},
            capture_output=True, text=True, check=True, timeout=120,
        ).stdout.strip()  # fmt: skip

    first = digest("1")
    assert len(first) == len(hashlib.sha256().hexdigest())
    assert digest("2") == first
