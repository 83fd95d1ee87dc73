"""Emitters and light points: kinds found in a World, uniform by area, strata kept, the same from every side for a sphere."""

import numpy as np
import pytest

from renderers.scene.builder import SceneBuilder, look_rotation
from renderers.scene.model import DiscLight, Lambert, Scene, SphereLight
from renderers.scene.shapes import sphere
from renderers.transport.penumbra.emitters import ball_radius, concentric, emitters_of, hammersley, stratified

LAMP = Lambert("lamp", emission=(2.0, 2.0, 2.0), double_sided=False)


def room(fill: str) -> Scene:
    """A floor under one lamp of the given kind."""
    b = SceneBuilder(fill)
    b.quad([(-3, 0, 3), (3, 0, 3), (3, 0, -3), (-3, 0, -3)], b.material(Lambert()))
    lamp = b.material(LAMP)
    if fill == "rectangle":
        b.quad([(-1, 2, -0.5), (1, 2, -0.5), (1, 2, 0.5), (-1, 2, 0.5)], lamp)
    elif fill == "polygon":
        b.node(meshes=(b.mesh([(-1, 2, -0.5), (1, 2, -0.5), (0, 2, 0.5)], [[0, 1, 2]], lamp),))
    elif fill == "mesh":
        b.place(sphere(0.5), lamp, scale=(1.0, 2.0, 0.7), translation=(0.0, 2.0, 0.0))
    elif fill == "disc":
        b.light(DiscLight(radius=0.5), (0.0, 2.0, 0.0), look_rotation(np.array([0.0, -1, 0])))
    else:
        b.light(SphereLight(radius=0.5), (0.0, 2.0, 0.0))
    b.camera((0, 3, 6), (0, 1, 0), 0.7)
    return b.build()


@pytest.mark.parametrize("kind", ["rectangle", "polygon", "disc", "sphere", "mesh"])
def test_kinds_points_and_sizes(kind: str) -> None:
    """9.11: each kind is told apart; points lie on it (in it for a sphere), their mean is its centre, their number N."""
    world = room(kind).world()
    found = emitters_of(world)
    assert {e.kind for e in found} == {kind}
    assert len(found) == (6 if kind == "mesh" else 1)
    for emitter in found:
        np.testing.assert_allclose(emitter.frame @ emitter.frame.T, np.eye(3), atol=1e-12)
        points = emitter.points(400, 3)
        np.testing.assert_array_equal(points, emitter.points(400, 3))
        local = (points - emitter.centre) @ emitter.frame.T
        assert (np.abs(local[:, :2]) <= emitter.half * (1 + 1e-6)).all()
        if kind in ("rectangle", "polygon", "disc"):
            assert np.abs(local[:, 2]).max() < 1e-6
            assert emitter.one_sided
            assert emitter.frame[2] @ [0, -1, 0] == pytest.approx(1, abs=1e-6)
        # four standard errors of independent points, whose standard deviation is at most the half size
        assert np.abs(local.mean(axis=0)).max() <= 4 * emitter.size / np.sqrt(400)


@pytest.mark.parametrize("count", [16, 64])
def test_hammersley_points_are_even_in_boxes_of_every_shape(count: int) -> None:
    """Before it is moved, each box of 2^-a by 2^-b with 2^(a+b) = N holds one point; moved, each holds none to four of them.

    A moved box is up to four parts of boxes of the torus, each with one point.
    """
    points = hammersley(count, np.random.default_rng(4))
    np.testing.assert_array_equal(points, hammersley(count, np.random.default_rng(4)))
    assert points.min() >= 0
    assert points.max() < 1
    still = (points - np.random.default_rng(4).random(2)) % 1
    power = int(np.log2(count))
    for a in range(power + 1):
        for where, most in ((still + 1e-9, 1), (points, 4)):
            box = np.floor(where % 1 * [2**a, 2 ** (power - a)]).astype(int) @ [1, 2**a]
            assert np.bincount(box, minlength=count).max() <= most


def test_patterns_differ_on_rectangles_and_discs_alone() -> None:
    """A sphere's points are what they are."""
    for kind, differ in (("rectangle", True), ("disc", True), ("sphere", False), ("polygon", False)):
        light = emitters_of(room(kind).world())[0]
        same = np.array_equal(light.points(16, 1, pattern="hammersley"), light.points(16, 1, pattern="stratified"))
        assert same != differ


@pytest.mark.parametrize("count", [1, 4, 7, 16, 50])
def test_strata_have_equal_area(count: int) -> None:
    """One point in each cell, whatever N: cells of row r are 1/columns wide and columns/N high, so their area is 1/N."""
    points = stratified(count, np.random.default_rng(4))
    rows = max(round(count**0.5), 1)
    columns = np.diff(np.floor(np.linspace(0, count, rows + 1)).astype(int))
    edges = np.concatenate([[0], np.cumsum(columns)]) / count
    row = np.searchsorted(edges, points[:, 1], side="right") - 1
    np.testing.assert_array_equal(np.bincount(row, minlength=rows), columns)
    for r in range(rows):
        np.testing.assert_array_equal(np.sort((points[row == r, 0] * columns[r]).astype(int)), np.arange(columns[r]))


def test_disc_map_keeps_area() -> None:
    """Concentric squares of half side r go to circles of radius r."""
    grid = (np.stack(np.meshgrid(np.arange(200), np.arange(200)), axis=-1).reshape(-1, 2) + 0.5) / 100 - 1
    radius = np.linalg.norm(concentric(grid), axis=1)
    np.testing.assert_allclose(radius, np.abs(grid).max(axis=1), atol=1e-12)
    np.testing.assert_allclose((radius < 0.5).mean(), 0.25, atol=1e-12)


def test_sphere_points_look_like_a_uniform_disc_from_everywhere() -> None:
    """Squared distances from the line of sight are uniform in [0, 1], for any line: the Abel inverse of a constant disc."""
    u = (np.arange(200_000) + 0.5) / 200_000
    rng = np.random.default_rng(1)
    cosine = rng.uniform(-1, 1, len(u))
    across2 = np.sort(ball_radius(u) ** 2 * (1 - cosine**2))
    # Kolmogorov-Smirnov at the level 1e-6: 2.7 / √n
    assert np.abs(across2 - u).max() < 2.7 / np.sqrt(len(u))


def test_brightest_first() -> None:
    """Order by power, so that a limit on the number of lights keeps the ones that matter."""
    b = SceneBuilder("two")
    lamps = [b.material(Lambert(emission=(e, e, e), double_sided=False)) for e in (1.0, 5.0)]
    for x, lamp in zip((-2, 2), lamps, strict=True):
        b.quad([(x - 1, 2, -1), (x + 1, 2, -1), (x + 1, 2, 1), (x - 1, 2, 1)], lamp)
    b.camera((0, 0, 6), (0, 1, 0), 0.7)
    world = b.build().world()
    assert [float(world.materials.emission[world.material[e.triangles[0]], 0]) for e in emitters_of(world)] == [5.0, 1.0]
