"""Light that is partly behind a receiver's plane: what the share hidden from all of it says, and what shadow rays say."""

from collections import Counter

import numpy as np
import pytest

from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert
from renderers.scene.world import World
from renderers.transport.direct import Receivers
from renderers.transport.penumbra.emitters import Emitter, emitters_of
from renderers.transport.penumbra.shading import before_plane, cast_before, without_behind


def scene(*, card: bool) -> tuple[World, Emitter, np.ndarray]:
    """A wall under the middle of a lamp, maybe a card that hides the lamp's half with x > 0 from the wall's foot."""
    b = SceneBuilder("horizon")
    grey = b.material(Lambert("grey", (0.6, 0.6, 0.6)))
    b.quad([(0, 0, -1), (0, 0, 1), (0, 1, 1), (0, 1, -1)], grey, "wall")
    if card:
        b.quad([(0.05, 1.5, -2), (2, 1.5, -2), (2, 1.5, 2), (0.05, 1.5, 2)], grey, "card")
    lamp = b.material(Lambert("lamp", (0.0, 0.0, 0.0), emission=(4.0, 4.0, 4.0), double_sided=False))
    b.quad([(-0.5, 2, -0.5), (0.5, 2, -0.5), (0.5, 2, 0.5), (-0.5, 2, 0.5)], lamp, "lamp")
    b.camera((3, 1, 0), (0, 0.5, 0), 0.6)
    world = b.build().world()
    light = emitters_of(world)[0]
    return world, light, light.points(64, 0)


def on_wall(world: World) -> Receivers:
    """Points up the wall's middle, seen from x > 0."""
    y = np.linspace(0.1, 0.9, 9)
    metres = np.stack([np.zeros(9), y, np.zeros(9)], axis=1)
    normal = np.tile([1.0, 0.0, 0.0], (9, 1))
    return Receivers((metres - world.centre) * world.scale, normal, normal)


@pytest.mark.parametrize("card", [False, True])
def test_rays_go_to_what_is_before_the_plane(card: bool) -> None:
    """Half of a stratified lamp's points are before the wall's plane; all of them are seen, or (card) almost none.

    From the foot the card's edge at x = .05 leaves the lamp's strip x < .05 · 2 / 1.5 = .067; from .9 up the wall x < .09.
    """
    world, light, points = scene(card=card)
    counters = Counter[str]()
    hidden = cast_before(world, light, points, on_wall(world), counters)
    # 8 × 8 strata: the plane lies between two columns
    assert counters["rays"] == 9 * 32
    if card:
        # one of four columns of width .125 lies in part in the strip
        assert (hidden >= 0.75).all()
        assert (hidden <= 1.0).all()
    else:
        assert (hidden == 0).all()


def test_a_share_between_none_and_all_is_cast() -> None:
    """V = 0 and 1 are believed; between them, with light behind the plane, rays decide; -1 is cast in any case."""
    world, light, points = scene(card=False)
    at = on_wall(world)
    share = np.array([0.0, 1.0, 0.3, 0.5, 0.7, -1.0, 0.5, 0.5, 0.5])
    counters = Counter[str]()
    found = before_plane(world, light, points, at, share, "rays", counters)
    np.testing.assert_array_equal(found, [0, 1, 0, 0, 0, 0, 0, 0, 0])
    assert (counters["points_ray_cast"], counters["points_at_horizon"]) == (7, 6)
    counters.clear()
    found = before_plane(world, light, points, at, share, "share", counters)
    np.testing.assert_allclose(found, [0, 1, 0, 0, 0.4, 0, 0, 0, 0], atol=1e-12)
    assert (counters["points_ray_cast"], counters["points_at_horizon"]) == (1, 0)
    np.testing.assert_array_equal(before_plane(world, light, points, at, share, "ignored", counters)[:5], share[:5])


def test_all_light_before_the_plane_needs_no_rays() -> None:
    """A receiver that faces the lamp keeps its V."""
    world, light, points = scene(card=False)
    up = np.tile([0.0, 1.0, 0.0], (9, 1))
    at = on_wall(world)._replace(normal=up, geometric=up)
    counters = Counter[str]()
    share = np.linspace(0, 1, 9)
    np.testing.assert_allclose(before_plane(world, light, points, at, share, "rays", counters), share)
    assert counters["rays"] == 0


def test_without_behind() -> None:
    """(V - H) / (1 - H) within [0, 1]; 0 where nothing is before the plane."""
    found = without_behind(np.array([0.5, 0.75, 0.2, 1.0, 1.0]), np.array([0.5, 0.5, 0.5, 0.25, 1.0]), 64)
    np.testing.assert_allclose(found, [0, 0.5, 0, 1, 0])
