"""Zones that end where their records don't see: walls, steps, and the surfaces around which nothing may change."""

import numpy as np
import pytest

from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.solids import box
from renderers.scene.model import Lambert, Scene
from renderers.scene.shapes import sphere
from renderers.scene.world import World
from renderers.transport.caching.hemisphere import Grid, PolarSampler
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.sight import in_sight
from renderers.transport.caching.splat import Canvas
from renderers.transport.raycast import caster_of

FLOOR = [(-2.0, -2.0, 0.0), (2.0, -2.0, 0.0), (2.0, 2.0, 0.0), (-2.0, 2.0, 0.0)]


def scene(*solids: tuple, floor: bool = True) -> Scene:
    b = SceneBuilder("things")
    grey = b.material(Lambert("grey", (0.5,) * 3))
    if floor:
        b.quad(np.array(FLOOR), grey)
    for solid in solids:
        b.place(solid, grey, "thing")
    b.camera((0, -3, 2), (0, 0, 0), 1.0, (0, 0, 1))
    return b.build()


def radii(world: World, place: tuple, points: np.ndarray, normals: np.ndarray, radius: float, up: tuple = (0, 0, 1)) -> float:
    """Radius, in metres, at a = 0.5 of a record at a place, after looking at points (N, 3) on a row of pixels; a zone of
    0.5·radius before."""
    here = (np.array([place], float) - world.centre) * world.scale
    n = np.array([up], float)
    record = PolarSampler(world, Grid(36, 114), ReflectedDirectLight(world))(Sites(here, n, n))
    record = record.with_radius(np.array([radius * world.scale]))
    canvas = Canvas(np.arange(len(points)), len(points), (points - world.centre) * world.scale, normals, np.float64)
    found: Records = in_sight(record, canvas, 0.5, "ward", caster_of(world).occluded)
    return float(found.radius[0] / world.scale)


def line(count: int = 400) -> np.ndarray:
    x = np.linspace(-1, 1, count)
    return np.stack([x, 0 * x, 0 * x], axis=1)


def test_a_wall_ends_the_zone_at_the_first_hidden_pixel() -> None:
    """A wall of 2 cm from x = 0.19 on, the record at 0: pixels behind it begin at 0.21."""
    points = line()
    up = np.tile([0.0, 0, 1], (len(points), 1))
    world = scene(box((0.19, -1, 0), (0.21, 1, 1))).world()
    behind = points[:, 0][points[:, 0] > 0.21].min()
    visible = ~((points[:, 0] > 0.19) & (points[:, 0] < 0.21))
    assert radii(world, (0, 0, 0), points[visible], up[visible], 1.0) * 0.5 == pytest.approx(behind, rel=2e-3)
    # a zone that ends before the wall stays as it is
    assert radii(world, (0, 0, 0), points, up, 0.3) == pytest.approx(0.3)


def test_a_corner_of_a_room_changes_nothing() -> None:
    """A wall at x = 0.05, and nothing behind: all of the zone on this side is seen."""
    points = line()
    points = points[points[:, 0] < 0.05]
    up = np.tile([0.0, 0, 1], (len(points), 1))
    world = scene(box((0.05, -1, 0), (0.06, 1, 1))).world()
    assert radii(world, (0, 0, 0), points, up, 1.0) == pytest.approx(1.0)


def test_a_step_down_ends_the_zone() -> None:
    """From a table of 10 cm, which ends at x = 0.2, to the floor below: pixels there are no part of the zone, the table is."""
    points, up = line(), np.tile([0.0, 0, 1], (400, 1))
    on_top = points[:, 0] < 0.2
    world = scene(box((-1, -1, 0), (0.2, 1, 0.1))).world()
    points[on_top, 2] = 0.1
    first = np.linalg.norm(points[~on_top][0] - [0, 0, 0.1])
    assert radii(world, (0, 0, 0.1), points, up, 1.0) * 0.5 == pytest.approx(first, rel=2e-3)
    assert radii(world, (0, 0, 0.1), points[on_top], up[on_top], 1.0) == pytest.approx(1.0)


@pytest.mark.parametrize("inside", [False, True])
def test_smooth_surfaces_see_themselves(inside: bool) -> None:
    """On a ball, and in a hollow one, chords run under or above the surface; neither is taken for an obstacle."""
    angle = np.linspace(-1, 1, 400)
    normals = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    world = scene(sphere(1.0, 128, 64, exact_area=False), floor=False).world()
    facing = -normals if inside else normals
    up = (0, 0, -1) if inside else (0, 0, 1)
    assert radii(world, (0, 0, 1), normals, facing, 2.0, up) == pytest.approx(2.0)
