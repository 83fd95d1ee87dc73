"""Forward light cuts where numbers or geometry are unkind: units, slivers, giants and motes, coplanar sheets, lights at the eye."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

import renderers
from renderers.methods.flc import FlcSettings, ForwardLightCuts, draw
from renderers.methods.flc_levels import family_of
from renderers.scene.builder import SceneBuilder, look_rotation
from renderers.scene.model import DirectionalLight, Lambert, Scene
from renderers.transport.cuts import coordinate
from renderers.transport.primary import cast_gbuffer
from renderers.transport.splat import light_rows, splat
from renderers.transport.vpl import Vpls
from tests.scaling import scaled

METHOD = ForwardLightCuts()
CPU = "llvmpipe (LLVM 15.0.6, 256 bits)"
SIZE = (32, 18)
FAMILIES = ("roulette", "c0", "ridge")


@pytest.fixture(autouse=True)
def _software_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """`auto` shall not ask for a GL context."""
    monkeypatch.setattr("renderers.method.device_string", lambda: CPU)


def indirect(scene: Scene, **settings: object) -> np.ndarray:
    """Indirect layer, float64 (H, W, 3)."""
    frame = METHOD.render(scene, FlcSettings(**{"vpls": 2048, **settings}), size=SIZE, seed=3)  # type: ignore[arg-type]
    return np.asarray(frame.layers["indirect"], np.float64)


def corner(mesh: str = "plain", gap: float = 0.0) -> Scene:
    """A floor lit by a slanting sun beside a wall that receives its light. The floor may be cut into pieces of other shapes.

    plain: two triangles. slivers: 400 strips, each of two triangles 1:400, with a zero-area triangle after each. motes: a giant
    triangle and some 5,000 tiny ones that make up the other half. sheets: the wall is two coplanar sheets, `gap` apart.
    """
    b = SceneBuilder(f"corner-{mesh}")
    grey = b.material(Lambert("grey", (0.6, 0.5, 0.4)))
    b.node(meshes=(_floor(b, mesh, grey),))
    for offset in (0.0, -gap) if mesh == "sheets" else (0.0,):
        b.quad([(offset, 0, -1), (offset, 0, 1), (offset, 1, 1), (offset, 1, -1)][::-1], grey, "wall")
    b.light(DirectionalLight("sun", intensity=3.0), rotation=look_rotation(np.array([0.3, -1.0, 0.2])))
    b.camera((1.6, 0.8, 0.4), (0.2, 0.4, 0), 0.9)
    return b.build()


def _floor(b: SceneBuilder, mesh: str, material: int) -> int:
    corners = np.array([(0.0, 0, -1), (0, 0, 1), (2, 0, 1), (2, 0, -1)])
    up = np.array([0.0, 1, 0])
    if mesh == "slivers":
        x = np.linspace(0, 2, 401)
        points = np.stack([np.repeat(x, 2), 0 * np.repeat(x, 2), np.tile([-1.0, 1.0], 401)], axis=1)
        first = 2 * np.arange(400)[:, None]
        triangles = np.concatenate([first + np.array(three) for three in ((0, 1, 3), (0, 3, 2), (0, 1, 1))])
        return b.mesh(points, triangles, material, normals=np.tile(up, (len(points), 1)))
    if mesh == "motes":
        n = 100
        i, j = (index.ravel() for index in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
        # the triangle (0, 0, -1), (2, 0, 1), (2, 0, -1) in n² pieces: rows of upright and hanging ones
        keep, hang = i + j < n, i + j < n - 1
        edge, side = np.array([2.0, 0, 2]) / n, np.array([2.0, 0, 0]) / n
        origin = corners[0] + i[:, None] * edge + j[:, None] * side
        upright = np.stack([origin, origin + edge, origin + side], axis=1)[keep]
        hanging = np.stack([origin + edge, origin + edge + side, origin + side], axis=1)[hang]
        pieces = np.concatenate([corners[None, [0, 1, 2]], upright, hanging]).reshape(-1, 3)
        return b.mesh(pieces, np.arange(len(pieces)).reshape(-1, 3), material, normals=np.tile(up, (len(pieces), 1)))
    return b.mesh(corners, [[0, 1, 2], [0, 2, 3]], material)


@pytest.mark.parametrize("factor", [1e-3, 1e-1, 1e2, 1e4])
@pytest.mark.parametrize("family", FAMILIES)
def test_units_do_not_matter(factor: float, family: str) -> None:
    """All lengths × 1e-3 … 1e4, the clamp × factor²: 1e-4 of the largest value; the recipe's own clamp and R_1 follow too."""
    scene = renderers.load_scene("empty-room")
    big = scaled(scene, factor)
    clamp = METHOD.resolve(scene, FlcSettings(), CPU).eps_b
    one, other = indirect(scene, family=family, eps_b=clamp), indirect(big, family=family, eps_b=clamp * factor**2)
    assert one.max() > 0
    np.testing.assert_allclose(other, one, rtol=0, atol=1e-4 * one.max())
    np.testing.assert_array_equal(other, indirect(big, family=family))


def test_a_light_in_the_plane_of_its_receivers_brings_nothing() -> None:
    """Every light lies on the floor, which it can't light; and the wall's ones light the floor up to their own foot, finitely."""
    image, scene = indirect(corner()), corner()
    world = scene.world()
    g = cast_gbuffer(world, SIZE)
    assert np.isfinite(image).all()
    settings = METHOD.resolve(scene, FlcSettings(vpls=2048), CPU)
    rows = draw(world, family_of(scene, settings), settings, 3, Counter()).rows
    floor_lights = rows[:, rows[4] > 0.99]
    floor = g.covered & (g.normal[..., 1] > 0.99)
    alone = splat(g, world, np.ascontiguousarray(floor_lights), family_of(scene, settings), settings.eps_b * world.scale**2)
    assert floor.sum() > 50
    assert floor_lights.shape[1] > 100
    assert not alone[floor].any()


@pytest.mark.parametrize("mesh", ["slivers", "motes"])
def test_slivers_and_giants_beside_motes_are_the_same_surface(mesh: str) -> None:
    """The mean image over 24 seeds is that of two triangles, within 4 standard errors and 0.2 % for edges between the pieces."""
    plain, pieces = corner(), corner(mesh)

    def means(scene: Scene) -> np.ndarray:
        settings = FlcSettings(vpls=4096)
        frames = [METHOD.render(scene, settings, size=SIZE, seed=seed) for seed in range(24)]
        return np.array([frame.layers["indirect"].mean(dtype=np.float64) for frame in frames])

    one, other = means(plain), means(pieces)
    error = np.hypot(one.std(ddof=1), other.std(ddof=1)) / np.sqrt(24)
    assert error < 0.01 * one.mean()
    assert abs(one.mean() - other.mean()) < 4 * error + 0.002 * one.mean()


@pytest.mark.parametrize("gap", [0.0, 1e-6, 1e-4])
def test_coplanar_sheets_do_not_light_one_another(gap: float) -> None:
    """A wall of two sheets, in one plane or a hair apart, looks as one: light comes from the floor alone, and to the front."""
    one, two = corner(), corner("sheets", gap)
    frames = [
        np.mean([METHOD.render(scene, FlcSettings(vpls=8192), size=SIZE, seed=s).layers["indirect"] for s in range(12)], axis=0)
        for scene in (one, two)
    ]
    wall = cast_gbuffer(one.world(), SIZE).normal[..., 0] > 0.99
    assert wall.sum() > 50
    # the sheets share the draws of one wall's points: other lights, the same mean, 3 % apart (measured 1 %)
    assert frames[1][wall].mean() == pytest.approx(frames[0][wall].mean(), rel=0.03)
    assert (frames[1][wall] <= 3 * frames[0][wall].max()).all()


@pytest.mark.parametrize("family", FAMILIES)
def test_the_camera_inside_a_support(family: str) -> None:
    """Lights at the eye, around it and behind it: the picture is the sum over pixels of algorithm 3, whatever the screen sees."""
    scene = renderers.load_scene("empty-room")
    world = scene.world()
    g = cast_gbuffer(world, SIZE)
    settings = METHOD.resolve(scene, FlcSettings(vpls=8192, reach=0.5, family=family), CPU)  # type: ignore[arg-type]
    law, eye = family_of(scene, settings), world.camera.pose[:3, 3]
    forward = -world.camera.pose[:3, 2]
    positions = np.stack([eye, eye + 1e-6 * forward, eye - 0.05 * forward, eye + 0.02 * forward])
    normals = np.stack([forward, forward, forward, forward])
    vpls = Vpls(positions.astype(np.float32), normals.astype(np.float32), np.ones((4, 3), np.float32), np.arange(4), 4)
    marks = np.full(4, 2.0)
    image = splat(g, world, light_rows(vpls, law, marks), law, 1e-4)
    expected = np.zeros(image.shape[:2])
    for position, normal, mark in zip(vpls.positions, vpls.normals, marks, strict=True):
        v = position.astype(np.float64) - g.position
        r2 = np.einsum("...i,...i", v, v)
        cosines = np.maximum(0, np.einsum("...i,...i", v, g.normal)) * np.maximum(0, -(v @ normal.astype(np.float64)))
        weight = law.weight(mark, np.minimum(coordinate(g.position, position, normal), 1e15)) / law.density(mark)
        expected += np.where(g.covered, weight * cosines / np.maximum(r2 * np.maximum(1e-4, r2), 1e-30), 0)
    assert image.max() > 0
    np.testing.assert_allclose(image, expected[..., None] * g.base / np.pi, rtol=1e-4, atol=1e-5 * float(image.max()))
