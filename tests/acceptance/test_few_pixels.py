"""Glossy pixels too few for a radiance record: which ones are traced instead, by what, and what becomes of their places in time."""

from dataclasses import replace

import numpy as np
import pytest
from caching_rooms import room_2
from temporal_rooms import room

from renderers import Frame, get_method, load_scene
from renderers.scene.model import GGX, Material, Phong, Scene
from renderers.scene.world import GGX_KIND, PHONG
from renderers.transport.caching.hemisphere import Grid
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.radiance import RadianceSampler
from renderers.transport.caching.records import Sites
from renderers.transport.caching.reflectance import Lobes, Shape, gloss_of, lobe_table
from renderers.transport.caching.splat import Canvas
from renderers.transport.caching.traced import LEAST, PIXELS_PER_DRAW, Price, few_at, numbers_of_pixels, traced_alone, traced_lobes
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer

SIZE = (24, 18)
COARSE = {"rays": 128, "a": 0.4, "glossy_rays": 256, "glossy_a": 0.4, "glossy_pixels": 4, "lobe_rays": 8}


@pytest.fixture(autouse=True)
def _software_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("renderers.method.device_string", lambda: "llvmpipe (LLVM 15.0.6, 256 bits)")


def glossy_room(material: Material, scene: Scene | None = None) -> Scene:
    scene = room_2() if scene is None else scene
    return replace(scene, materials=tuple(replace(material, name=m.name) for m in scene.materials))


def slow_cube() -> Scene:
    """A glossy room, and a glossy cube that slides along by 1 cm a frame."""
    cube = room(cube=lambda t: np.stack([-0.6 + 0.01 * t, 0.4 + 0 * t, 0.45 + 0 * t], 1), frames=60)
    return glossy_room(Phong("p", (0.3, 0.25, 0.2), (0.4,) * 3, 10.0), cube)


def frames_of(scene: Scene, count: int, first: int = 0, **settings: object) -> list[Frame]:
    method = get_method("trc")
    return list(
        method.render_frames(scene, method.Settings(**{**COARSE, **settings}), size=SIZE, frames=(first, first + count - 1))
    )


def bytes_of(frame: Frame) -> bytes:
    return frame.layers["beauty"].tobytes() + frame.layers["indirect"].tobytes()


def floor(side: int = 40) -> Canvas:
    """Pixels of a unit square, each 1/side wide."""
    x, y = np.meshgrid(*[(np.arange(side) + 0.5) / side] * 2)
    position = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    return Canvas(np.arange(side**2), side, position, np.tile([0.0, 0, 1], (side**2, 1)))


def test_zones_of_too_few_new_pixels_are_left() -> None:
    """A disc of 5 pixels' radius holds about 79 of them: a limit far above leaves every pixel, one below leaves edges alone."""
    whole, most, none = floor(), floor(), floor()
    order, radius = np.random.default_rng(0).permutation(len(whole)), np.full(len(whole), 1.25)
    most.few[:], none.few[:] = 20, 200
    plain, some, nothing = (c.thinned(order, radius, 0.1, "ward", np.zeros(len(c), bool), 10**6) for c in (whole, most, none))
    assert len(nothing) == 0
    assert none.left.all()
    np.testing.assert_array_equal(none.alone, none.rows)
    assert not none.missed.any()
    assert len(plain) > len(some) > 0
    assert not whole.left.any()
    assert 0 < most.left.sum() < 20 * (len(plain) - len(some)) + 1  # each record less leaves fewer than 20 pixels
    assert not np.isin(some, np.flatnonzero(most.left)).any()


@pytest.mark.parametrize(
    ("shape", "share"),
    [
        (Shape(PHONG, 0.0), None),
        # of cosⁿ about a mirror direction far above the horizon, without the cosine, which hardly varies over it: (2n+1)/(n+1)²
        (Shape(PHONG, 60.0), 121 / 61**2),
        (Shape(GGX_KIND, 0.5), None),
    ],
)
def test_the_share_of_the_hemisphere_that_a_lobe_fills(shape: Shape, share: float | None) -> None:
    table = lobe_table(shape, 4)
    assert table is not None
    assert 0 < table.fill <= 1
    if share is not None:
        assert table.fill == pytest.approx(share, rel=0.1)


def test_how_few_pixels_a_record_is_made_for() -> None:
    """Half as many as a hemisphere holds of a lobe, unless that leaves fewer than LEAST rays a pixel; or what is asked for."""
    world = load_scene("cornell-glossy").world()
    gbuffer, gloss = cast_gbuffer(world, SIZE), gloss_of(world)
    rows = np.flatnonzero(gloss.cached(gbuffer))
    table = lobe_table(Shape(PHONG, 20.0), 9)
    assert table is not None
    expected = {Price(65536, None): 0.5 / table.fill, Price(4096, None): 0.5 * 4096 / LEAST, Price(4096, 7): 7}
    for price, few in expected.items():
        np.testing.assert_allclose(few_at(gloss, gbuffer, rows, price), few, rtol=1e-12)
    assert 5 < 0.5 / table.fill < 7


@pytest.mark.parametrize("material", [Phong("p", (0.4,) * 3, (0.4,) * 3, 20.0), GGX("g", (0.8, 0.6, 0.5), 0.3, 0.7)])
def test_pixels_alone_show_what_records_there_would(material: Material) -> None:
    """All terms, by 6144 rays along the lobe and 3072 by the cosine, against records at these pixels: 5 % apart (RMS over mean)."""
    world = glossy_room(material).world()
    gbuffer, gloss = cast_gbuffer(world, (12, 9)), gloss_of(world)
    rows, incoming = np.flatnonzero(gloss.cached(gbuffer))[::4], ReflectedDirectLight(world)
    records = RadianceSampler(world, Grid(100, 314), incoming, gloss.order)(Sites(*receivers_of(world, gbuffer, rows)))
    assert records.coefficients is not None
    by_records = np.einsum("pci,pic->pc", Lobes(world, gbuffer, rows, gloss)(slice(0, len(rows))), records.coefficients)
    traced = traced_alone(world, gbuffer, rows, gloss, Price(18432, 1), incoming)
    assert np.sqrt(np.mean((traced - by_records) ** 2)) <= 0.05 * by_records.mean()


def test_a_pixel_has_its_own_numbers_whichever_others_are_asked_for() -> None:
    whole = numbers_of_pixels(3, "lobes", np.arange(3 * PIXELS_PER_DRAW))
    some = np.array([0, 7, PIXELS_PER_DRAW - 1, PIXELS_PER_DRAW, 2 * PIXELS_PER_DRAW + 5])
    np.testing.assert_array_equal(numbers_of_pixels(3, "lobes", some), whole[some])
    assert len(np.unique(whole)) > 0.999 * whole.size
    assert (numbers_of_pixels(4, "lobes", some) != whole[some]).all()
    assert numbers_of_pixels(3, "lobes", some[:0]).shape == (0, 9)


def test_a_traced_pixel_does_not_depend_on_which_others_are() -> None:
    world = glossy_room(Phong("p", (0.4,) * 3, (0.4,) * 3, 20.0)).world()
    gbuffer, incoming = cast_gbuffer(world, (12, 9)), ReflectedDirectLight(world)
    rows = np.flatnonzero(gbuffer.covered)
    whole, part = (traced_lobes(world, gbuffer, some, 16, incoming) for some in (rows, rows[1::3]))
    np.testing.assert_allclose(part, whole[1::3], rtol=1e-5, atol=1e-9)


def test_small_glossy_things_get_no_records() -> None:
    """By the counters: none, records alone, and both, with fewer rays than records alone take."""
    scene, rcs = load_scene("bouncing-spheres"), get_method("rcs")
    none, alone, both = (rcs.render(scene, rcs.Settings(**{**COARSE, "glossy_pixels": p}), size=SIZE) for p in (65536, 1, 4))
    shiny = int(gloss_of(scene.world()).cached(cast_gbuffer(scene.world(), SIZE)).sum())
    assert none.counters["radiance_records"] == 0
    assert none.counters["pixels_alone"] == shiny
    assert alone.counters["pixels_alone"] == 0
    assert 0 < both.counters["pixels_alone"] < shiny
    assert both.counters["radiance_records"] < alone.counters["radiance_records"]
    rays = [frame.counters["rays"] + frame.counters.get("lobe_rays", 0) for frame in (both, alone)]
    assert rays[0] < rays[1]


def test_per_frame_caching_of_few_pixels_is_that_of_radiance_cache_splatting() -> None:
    rcs, scene = get_method("rcs"), load_scene("bouncing-spheres")
    (frame,) = frames_of(scene, 1, 3, cache="per-frame")
    plain = rcs.render(scene, rcs.Settings(placement="hessian-bounded", **COARSE), size=SIZE, frame=3)
    assert bytes_of(frame) == bytes_of(plain)
    assert frame.counters["pixels_alone"] == plain.counters["pixels_alone"] > 0


@pytest.mark.parametrize("mode", ["none", "interpolated"])
def test_frames_with_few_pixels_do_not_depend_on_the_end_of_their_range(mode: str) -> None:
    scene = slow_cube()
    whole = frames_of(scene, 5, 3, gradients_in_time=mode, delta_max=4)
    part = frames_of(scene, 3, 3, gradients_in_time=mode, delta_max=4)
    assert [bytes_of(f) for f in part] == [bytes_of(f) for f in whole[:3]]
    assert sum(f.counters["pixels_alone"] for f in whole) > 0


def test_places_that_live_long_are_worth_fewer_pixels() -> None:
    """Among surfaces at rest records last: after the first frame fewer pixels are traced than in caches of one frame."""
    kept, plain = (frames_of(slow_cube(), 6, cache=cache) for cache in ("temporal", "per-frame"))
    alone = [sum(f.counters["pixels_alone"] for f in frames[1:]) for frames in (kept, plain)]
    assert alone[0] < 0.5 * alone[1]
    assert all(f.counters["pixels_missed"] == 0 for f in kept)
