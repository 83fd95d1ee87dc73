"""The memory bound of construction, in counted bytes: what lives at a time, and what it does not change."""

import subprocess
import sys
import tracemalloc
from collections import Counter

import numpy as np
import pytest
from penumbra_scene import view

from renderers.scene.shapes import sphere
from renderers.transport.penumbra.assemble import Construction, MemoryBoundError, assemble
from renderers.transport.penumbra.build import Casters, map_maker, welded
from renderers.transport.penumbra.cameras import cameras_of
from renderers.transport.penumbra.emitters import stratified
from renderers.transport.penumbra.functions import PenumbraMap
from renderers.transport.penumbra.lockstep import aligned_cameras
from renderers.transport.penumbra.plan import band_of, plan_of
from renderers.transport.penumbra.walk import project

POINTS, PIXELS, TEXELS = 64, 128, 192
MIB = 1 << 20


# prints by how many bytes the resident set of a process that has built before rises above what it held
RESIDENT = """
from jobs.claims.pdsm_stage import knot, peak_bytes, stage_of
stage = stage_of(knot(500, 40))
stage.build(4, 64, 64)
print(peak_bytes(lambda: stage.build({samples}, 256, 256, memory={bound} << 20)))
"""


def lamp(flat: bool) -> np.ndarray:
    """Points of a square lamp, those of a bent one off its plane."""
    even = stratified(POINTS, np.random.default_rng(1)) * 2 - 1
    return np.concatenate([even, np.zeros((POINTS, 1)) if flat else 0.4 * even[:, :1] ** 2], axis=1)


def model() -> Casters:
    """Three balls under the lamp."""
    positions, _, triangles = sphere(1.2, 48, 24)
    at = np.array([[0.0, 0.0, 8.0], [1.6, -1.0, 6.5], [-1.5, 1.2, 7.0]])
    corners = np.concatenate([(positions + centre)[triangles] for centre in at]).reshape(-1, 3).astype(np.float32)
    vertices, joined = welded(corners, np.arange(len(corners)).reshape(-1, 3))
    return Casters(vertices, joined, np.tile([1.0, 0.0], (len(joined), 1)))


def built(
    memory: int, flat: bool, counters: Counter[str] | None = None, compression: str = "vertical", pixels: int = PIXELS
) -> PenumbraMap:
    """The functions of the balls."""
    pyramid, points = view(pixels), lamp(flat)
    how = Construction(bias=0.01, memory=memory, compression=compression)  # type: ignore[arg-type]
    fitting = aligned_cameras(pyramid, points, TEXELS)
    if fitting is None:
        maps = map_maker(pyramid, model(), (TEXELS, TEXELS), 0.5, pyramid.pitch, 0.1)
        return assemble(pyramid, cameras_of(pyramid, points, TEXELS), maps, how, counters)
    cameras, grid = fitting
    return assemble(pyramid, cameras, map_maker(pyramid, model(), grid.shape, 0.5, pyramid.pitch, 0.1), how, counters, grid)


def same(one: PenumbraMap, other: PenumbraMap) -> None:
    """The same bytes."""
    for name in ("start", "depth", "value"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def counted(
    memory: int, flat: bool, counters: Counter[str], compression: str = "vertical", pixels: int = PIXELS
) -> tuple[PenumbraMap, int]:
    """The functions, and the largest number of bytes that numpy and Python held at a time, with those of the functions."""
    tracemalloc.start()
    try:
        made = built(memory, flat, counters, compression, pixels)
        # vertices are in memory that Python doesn't count
        return made, tracemalloc.get_traced_memory()[1] + made.depth.nbytes + made.value.nbytes
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("flat", [True, False])
def test_peak_is_within_the_bound_and_the_bytes_are_the_same(flat: bool) -> None:
    """Counted bytes of all arrays, the finished functions too, are within the bound; under any bound the result is the same.

    Kernels allocate nothing but a line of state, one function's steps, and what cameras see of vertices, which is planned for.
    """
    tally = Counter[str]()
    whole = built(1 << 30, flat, tally)
    assert tally["shadow_maps"] == POINTS
    for bound in (32, 12, 6):
        tally.clear()
        made, peak = counted(bound * MIB, flat, tally)
        assert peak <= bound * MIB
        same(made, whole)
    # the tightest one has to draw maps anew
    assert tally["shadow_maps"] > POINTS


def test_a_bound_that_is_too_small_is_refused_naming_one_that_is_not() -> None:
    """The refusal's figure is enough, and a MiB less is not; what is built under it is the same."""
    with pytest.raises(
        MemoryBoundError, match=r"memory: 1 MiB are too few for a penumbra .* at least \d+ MiB are needed$"
    ) as refused:
        built(MIB, True, pixels=16)
    least = int(str(refused.value).split("at least ")[1].split()[0])
    with pytest.raises(MemoryBoundError, match=f"at least {least} MiB"):
        built((least - 1) * MIB, True, pixels=16)
    tally = Counter[str]()
    made, peak = counted(least * MIB, True, tally, pixels=16)
    assert peak <= least * MIB
    assert tally["shadow_maps"] > 2 * POINTS
    same(made, built(1 << 30, True, pixels=16))


def test_functions_larger_than_expected_leave_less_for_the_rest() -> None:
    """Uncompressed functions are larger than what is set aside for them: the bound holds, or is refused once that is known."""
    whole = built(1 << 30, True, compression="none")
    size = whole.nbytes
    assert size > 2 * built(1 << 30, True).nbytes
    bound = 2 * size
    made, peak = counted(bound, True, Counter[str](), "none")
    assert peak <= bound
    same(made, whole)
    with pytest.raises(MemoryBoundError) as refused:
        built(size // 2, True, compression="none")
    # what is known after some rows is an estimate of the whole
    assert int(str(refused.value).split("at least ")[1].split()[0]) * MIB > size // 2


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
        plan = plan_of(pyramid, range(pyramid.height), cameras, grid.shape, mib * MIB, blocks=False)
        assert [row for slab in plan.slabs for row in slab] == list(range(pyramid.height))
        assert plan.bytes <= mib * MIB
        slabs.append(len(plan.slabs) * -(-len(cameras) // plan.batch))
    assert slabs == sorted(slabs, reverse=True)
    assert slabs[-1] == 1


def test_more_events_than_there_was_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles with more events than expected are finished in halves, a slab with too many too: the same bytes."""
    whole = built(1 << 30, True, pixels=48)
    monkeypatch.setattr("renderers.transport.penumbra.plan.DENSITY", 0.01)
    same(built(1 << 30, True, pixels=48), whole)
    # fewer events to a slab than it has, and not all maps at a time
    monkeypatch.setattr("renderers.transport.penumbra.plan.KEPT", 0.1)
    tally = Counter[str]()
    same(built(6 * MIB, True, tally, pixels=48), whole)
    assert tally["shadow_maps"] > POINTS


@pytest.mark.slow
@pytest.mark.parametrize(("samples", "bound"), [(64, 24), (256, 48), (256, 64)])
def test_resident_memory_is_within_a_tenth_of_the_bound(samples: int, bound: int) -> None:
    """What the kernel counts, in a process of its own: the bound and the tenth that is asked (allocator, threads' stacks)."""
    code = RESIDENT.format(samples=samples, bound=bound)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=600)
    assert int(done.stdout) <= 1.1 * bound * MIB
