"""The memory bound of construction, in counted bytes: what lives at a time, and what it does not change."""

import tracemalloc
from collections import Counter

import numpy as np
import pytest
from penumbra_scene import view

from renderers.scene.shapes import sphere
from renderers.transport.penumbra.assemble import Construction, assemble
from renderers.transport.penumbra.build import map_maker
from renderers.transport.penumbra.cameras import cameras_of
from renderers.transport.penumbra.emitters import stratified
from renderers.transport.penumbra.functions import PenumbraMap
from renderers.transport.penumbra.lockstep import aligned_cameras
from renderers.transport.penumbra.plan import band_of, plan_of
from renderers.transport.penumbra.walk import project

POINTS, PIXELS, TEXELS = 64, 128, 192
MIB = 1 << 20


def lamp(flat: bool) -> np.ndarray:
    """Points of a square lamp, those of a bent one off its plane."""
    even = stratified(POINTS, np.random.default_rng(1)) * 2 - 1
    return np.concatenate([even, np.zeros((POINTS, 1)) if flat else 0.4 * even[:, :1] ** 2], axis=1)


def model() -> np.ndarray:
    """Triangles (T, 3, 3) of three balls under the lamp."""
    positions, _, triangles = sphere(1.2, 48, 24)
    at = np.array([[0.0, 0.0, 8.0], [1.6, -1.0, 6.5], [-1.5, 1.2, 7.0]])
    return np.concatenate([(positions + centre)[triangles] for centre in at])


def built(memory: int, flat: bool, counters: Counter[str] | None = None) -> PenumbraMap:
    """The functions of the balls."""
    pyramid, points = view(PIXELS), lamp(flat)
    how = Construction(bias=0.01, memory=memory)
    fitting = aligned_cameras(pyramid, points, TEXELS)
    if fitting is None:
        maps = map_maker(pyramid, model(), (TEXELS, TEXELS), 0.5, pyramid.pitch, 0.1)
        return assemble(pyramid, cameras_of(pyramid, points, TEXELS), maps, how, counters)
    cameras, grid = fitting
    return assemble(pyramid, cameras, map_maker(pyramid, model(), grid.shape, 0.5, pyramid.pitch, 0.1), how, counters, grid)


@pytest.mark.parametrize("flat", [True, False])
def test_peak_is_within_the_bound_and_the_bytes_are_the_same(flat: bool) -> None:
    """Counted bytes of all arrays, the finished functions too, are within the bound; under any bound the result is the same.

    Kernels allocate nothing but a line of state and one function's steps: kilobytes.
    """
    tally = Counter[str]()
    whole = built(1 << 30, flat, tally)
    assert tally["shadow_maps"] == POINTS
    for bound in (32, 16, 8, 4):
        tally.clear()
        tracemalloc.start()
        try:
            made = built(bound * MIB, flat, tally)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak <= bound * MIB
        for name in ("start", "depth", "value"):
            np.testing.assert_array_equal(getattr(made, name), getattr(whole, name))
    # the tightest one has to draw maps anew
    assert tally["shadow_maps"] > POINTS


@pytest.mark.parametrize("flat", [True, False])
def test_bands_hold_every_texel_that_a_slab_crosses(flat: bool) -> None:
    """Rows of all rays of a slab, along their whole way, are within the band of each map."""
    pyramid, points = view(32), lamp(flat)
    fitting = aligned_cameras(pyramid, points, 64)
    cameras, height = (cameras_of(pyramid, points, 64), 64) if fitting is None else (fitting[0], fitting[1].shape[0])
    for slab in (range(3), range(12, 20), range(31, 32)):
        first, count = band_of(pyramid, cameras, slab, height)
        for camera, low in zip(cameras, first, strict=True):
            ends = [project(camera, u, pyramid.vs[row], pyramid.near, pyramid.far) for u in pyramid.us[[0, -1]] for row in slab]
            rows = np.array([[ray[3] + ray[4] * q for q in ray[7:9]] for ray in ends])
            assert rows.min() >= low
            assert rows.max() < low + count


def test_plans_fit_and_waste_little() -> None:
    """Plans cover all rows once; larger bounds mean fewer slabs; all stay within what they were given."""
    pyramid = view(256)
    fitting = aligned_cameras(pyramid, lamp(True), 256)
    assert fitting is not None
    cameras, grid = fitting
    slabs = []
    for mib in (8, 16, 32, 64, 256):
        plan = plan_of(pyramid, cameras, grid.shape, mib * MIB, blocks=False)
        assert [row for slab in plan.slabs for row in slab] == list(range(pyramid.height))
        assert plan.bytes <= mib * MIB
        slabs.append(len(plan.slabs) * -(-len(cameras) // plan.batch))
    assert slabs == sorted(slabs, reverse=True)
    assert slabs[-1] == 1


def test_more_events_than_there_was_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles with more events than expected are finished in halves, a slab with too many too: the same bytes."""
    whole = built(1 << 30, True)
    monkeypatch.setattr("renderers.transport.penumbra.plan.DENSITY", 0.01)
    tight = built(3 * MIB, True)
    for name in ("start", "depth", "value"):
        np.testing.assert_array_equal(getattr(tight, name), getattr(whole, name))
