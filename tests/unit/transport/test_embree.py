"""Packets of rays against single ones: the same hits and shadows, whatever the rays."""

from __future__ import annotations

import numpy as np
import pytest

import renderers
from renderers.transport import embree
from renderers.transport.embree import Packets, Singles, library, tree_of
from renderers.transport.raycast import Hits

RAYS = 10_001  # no multiple of a packet


@pytest.fixture(scope="module")
def trees() -> tuple[Packets, Singles]:
    if library() is None:
        pytest.skip("embreex carries no library of Embree here")
    world = renderers.load_scene("colonnade").world()
    triangles = world.positions.astype(np.float32), world.triangles.astype(np.int32)
    return Packets(*triangles), Singles(*triangles)


def some_rays() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    directions, reach = rng.normal(size=(RAYS, 3)), rng.uniform(0, 2, RAYS)
    return rng.uniform(-0.6, 0.6, (RAYS, 3)).astype(np.float32), directions.astype(np.float32), reach.astype(np.float32)


def test_packets_hit_what_single_rays_hit(trees: tuple[Packets, Singles]) -> None:
    origins, directions, _ = some_rays()
    found, expected = Hits.none(RAYS), Hits.none(RAYS)
    trees[0].nearest(origins, directions, None, found)
    trees[1].nearest(origins, directions, None, expected)
    assert 0.5 < (expected.triangle >= 0).mean() < 1
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def test_packets_block_what_single_rays_block(trees: tuple[Packets, Singles]) -> None:
    blocked = [tree.blocked(*some_rays()) for tree in trees]
    np.testing.assert_array_equal(*blocked)
    assert 0.1 < blocked[0].mean() < 0.9


@pytest.mark.parametrize("grid", [(73, 137), (1, RAYS), (3, 7)])
def test_grids_of_coherent_rays(trees: tuple[Packets, Singles], grid: tuple[int, int]) -> None:
    """A fan of rays from one place: but for edges, which float32 resolves to 1e-6 of the World, the same as single ones; and what
    one grid hits depends on no other grid."""
    cells = grid[0] * grid[1]
    y, x = np.divmod(np.arange(RAYS // cells * cells) % cells, grid[1])
    directions = np.stack([x / grid[1] - 0.5, y / grid[0] - 0.5, np.full(len(x), -0.7)], axis=1).astype(np.float32)
    origins = np.zeros_like(directions)
    found, expected, one = Hits.none(len(x)), Hits.none(len(x)), Hits.none(cells)
    trees[0].nearest(origins, directions, grid, found)
    trees[1].nearest(origins, directions, None, expected)
    trees[0].nearest(origins[:cells], directions[:cells], grid, one)
    np.testing.assert_array_equal(found.triangle >= 0, expected.triangle >= 0)
    np.testing.assert_allclose(found.t, expected.t, atol=1e-6)
    assert (found.triangle == expected.triangle).mean() > 0.99
    for some, alone in zip(found, one, strict=True):
        np.testing.assert_array_equal(some[:cells], alone)


def test_nearer_hits_stay(trees: tuple[Packets, Singles]) -> None:
    """Hits of another tree are replaced only by nearer ones."""
    origins, directions, _ = some_rays()
    for tree in trees:
        before = Hits(np.full(RAYS, 7, np.int32), *np.full((3, RAYS), 0.1, np.float32))
        tree.nearest(origins, directions, None, before)
        kept = before.triangle == 7
        assert (before.t[kept] == np.float32(0.1)).all()
        assert (before.t[~kept] < 0.1).all()
        assert kept.any()
        assert not kept.all()


def test_without_the_library_embreex_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(embree, "library", lambda: None)
    triangle = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32), np.array([[0, 1, 2]], np.int32)
    assert isinstance(tree_of(*triangle), Singles)
    with pytest.raises(RuntimeError, match="beside embreex"):
        Packets(*triangle)
