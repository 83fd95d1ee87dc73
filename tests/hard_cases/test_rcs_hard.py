"""Radiance cache splatting where it is hard: creases, thin things, grazing views, contacts, the dark, thousands of records.

Thin walls, and scenes that leak: `test_rcs_placement`. Tiny and huge scenes, float32, accuracies from √2 on, records at their own
pixel, steep gradients: `test_rcs` and `test_caching`. Mirror-like lobes: `test_rcs_glossy`.
"""

from dataclasses import replace

import numpy as np
import pytest
from caching_rooms import room_2
from numpy.typing import NDArray

import renderers
from renderers.frame import Frame
from renderers.methods.rcs import RadianceCacheSplatting, RcsSettings
from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.solids import box, moved
from renderers.scene.model import Lambert, PointLight, Scene
from renderers.scene.world import World
from renderers.transport.caching.hemisphere import Grid, PolarSampler
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.limits import Limits, limited
from renderers.transport.caching.placement import Placement, fill
from renderers.transport.caching.plane import PlaneSampler
from renderers.transport.caching.records import Sites
from renderers.transport.caching.splat import Canvas, gather
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.seen import Seen

F64 = NDArray[np.float64]
METHOD = RadianceCacheSplatting()
pytestmark = pytest.mark.usefixtures("software_device")  # the CPU path


def drawn(scene: Scene, size: tuple[int, int] = (48, 36), **settings: object) -> Frame:
    """A frame without a pixel that lacks a record."""
    frame = METHOD.render(scene, RcsSettings(**{"rays": 256, **settings}), size=size)  # type: ignore[arg-type]
    assert frame.counters["pixels_missed"] == 0
    assert (frame.layers["indirect"] >= 0).all()
    return frame


FINE = Grid(32, 100)


def exact(world: World, size: tuple[int, int], rays: Grid = FINE, jitter: bool = True) -> tuple[Canvas, Sites, F64]:
    """Pixels of a view, and the irradiance of a hemisphere at each, first channel."""
    gbuffer = cast_gbuffer(world, size)
    canvas = Canvas.of(gbuffer)
    here = Sites(*receivers_of(world, gbuffer, canvas.rows))
    return canvas, here, PolarSampler(world, rays, ReflectedDirectLight(world), 1, jitter)(here).irradiance[:, 0]


class AllButBlack:
    """Radiance 1 from everything but black surfaces, as `Incoming`."""

    def __call__(self, seen: Seen, random: F64) -> tuple[NDArray[np.float32], int]:
        return np.repeat((seen.base[:, :1] > 0).astype(np.float32), 3, axis=1), 0


def test_h8_a_wire_under_one_texel_of_the_plane() -> None:
    """A black wire of 1 cm a metre above, where a texel of the plane is 6 cm: turned about the normal (10° to 80°: along rows it is
    all or nothing) the irradiance of a white surrounding varies by no more than the wire's share, w ∫ dx / (1 + x²)² = w π/2,
    and by less with four times the texels."""
    width, spreads = 0.01, []
    for size in (64, 128):
        values = []
        for angle in np.radians(np.linspace(10, 80, 8)):
            turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
            b = SceneBuilder("wire")
            b.place(box((-60, -60, 9), (60, 60, 10)), b.material(Lambert("white", (1.0,) * 3)))
            wire = moved(box((-9, -width / 2, 1.0), (9, width / 2, 1.0 + width)), (0, 0, 0), turn)
            b.place(wire, b.material(Lambert("black", (0.0,) * 3)))
            b.camera((0, -3, 0.5), (0, 0, 1), 1.0, (0, 0, 1))
            world = b.build().world()
            up = np.array([[0.0, 0.0, 1.0]])
            record = PlaneSampler(world, AllButBlack(), size=size)(Sites((np.zeros((1, 3)) - world.centre) * world.scale, up, up))
            values.append(record.irradiance[0, 0])
        assert max(values) < np.pi
        spreads.append(max(values) - min(values))
    assert spreads[0] <= width * np.pi / 2
    assert spreads[1] < spreads[0]


def test_h11_h12_records_around_and_behind_the_camera() -> None:
    """Zones that hold the eye, or lie behind it: the splat is the gather, pixel by pixel, and nothing is added out of reach."""
    world = room_2().world()
    gbuffer = cast_gbuffer(world, (32, 32))
    canvas = Canvas.of(gbuffer, dtype=np.float64)
    here = Sites(*receivers_of(world, gbuffer, canvas.rows))
    eye, backwards = world.camera.pose[:3, 3], world.camera.pose[:3, 2]
    normal = here.normal[:2]
    records = PolarSampler(world, Grid(4, 14), ReflectedDirectLight(world))(Sites(here.position[:2], normal, normal))
    around = replace(records, position=np.stack([eye, eye + 0.01 * backwards]), radius=np.array([4.0, 4.0]))
    canvas.add(around, 1.0)
    value, weights = gather(canvas.position, canvas.normal, around, 1.0)
    np.testing.assert_allclose(canvas.sums[:, 3], weights, rtol=1e-12)
    np.testing.assert_allclose(canvas.irradiance, value, rtol=1e-12)
    assert (weights > 0).sum() > 100
    canvas.clear()
    canvas.add(replace(around, position=np.stack([eye + 3 * backwards] * 2), radius=np.array([1.0, 1.0])), 1.0)
    assert not canvas.sums.any()


def test_h21_the_order_of_the_pixels_changes_the_records_but_not_the_match_with_two_passes() -> None:
    world = room_2().world()
    gbuffer = cast_gbuffer(world, (32, 32))
    canvas = Canvas.of(gbuffer, dtype=np.float64)
    here = Sites(*receivers_of(world, gbuffer, canvas.rows))
    sampler = PolarSampler(world, Grid(8, 25), ReflectedDirectLight(world))
    places = []
    for seed in (0, 1, 2):
        canvas.clear()
        records = fill(canvas, here, sampler, sampler.distances, Placement(a=0.3, seed=seed))
        value, _ = gather(canvas.position, canvas.normal, records, 0.3)
        np.testing.assert_allclose(canvas.irradiance, value, rtol=1e-12)
        places.append({tuple(p) for p in records.position})
    assert places[0] != places[1] != places[2] != places[0]


def test_h22_a_grazing_camera() -> None:
    """Half a degree above the floor, where a pixel is a metre deep: all pixels get records; their light is that of hemispheres to a
    tenth of the mean (root mean square), and neither weights nor pixels with a cosine below 0.1 do harm."""
    scene = room_2(boxes=())
    world = scene.world()
    pose = world.camera.pose.copy()
    pose[:3, 3] = (np.array([0.0, -1.95, 0.05]) - world.centre) * world.scale
    pose[:3, :3] = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # looks along +y
    grazing = replace(world, camera=replace(world.camera, pose=pose))
    canvas, here, light = exact(grazing, (48, 36))
    sampler = PolarSampler(grazing, Grid(16, 50), ReflectedDirectLight(grazing))
    how = Placement(limits=Limits(0.01, 2.0, gradient=False, metric="hessian"))
    fill(canvas, here, sampler, sampler.distances, how)
    assert np.isfinite(canvas.sums).all()
    assert not canvas.missed.any()
    view = pose[:3, 3] - here.position
    cosine = np.abs(np.einsum("nd,nd->n", view, here.normal)) / np.linalg.norm(view, axis=1)
    error = canvas.irradiance[:, 0] - light
    assert (cosine < 0.1).sum() > 100
    for part in (cosine < 0.1, cosine >= 0.1):
        assert np.sqrt(np.mean(error[part] ** 2)) < 0.1 * light.mean()


@pytest.mark.parametrize("gap", [0.1, 1e-2, 1e-3, 1e-4, 0.0])
def test_a_box_that_comes_down_on_the_floor(gap: float) -> None:
    """At every height the image has all its records and stays within the light that there is; the more it lies on, the darker the
    crease: never brighter than twice what hemispheres find anywhere."""
    scene = room_2(boxes=(((-0.5, -0.5, gap), (0.5, 0.5, gap + 0.8)),))
    frame = drawn(scene, rays=512)
    world = scene.world()
    _, _, light = exact(world, (48, 36), Grid(8, 25))
    # albedo 0.7 at most
    assert frame.layers["indirect"].max() < 2 * 0.7 / np.pi * light.max()


def test_objects_of_one_pixel() -> None:
    """A hundred cubes of 4 cm in a room 4 m wide, about a pixel each: as many records as needed, none left out."""
    rng = np.random.default_rng(1)
    places = rng.uniform((-1.5, -1, 0.2), (1.5, 1.5, 2.5), (100, 3))
    scene = room_2(boxes=tuple((tuple(p), tuple(p + 0.04)) for p in places))
    frame = drawn(scene, (64, 48), rays=64)
    bare = drawn(room_2(boxes=()), (64, 48), rays=64)
    assert bare.counters["records"] < frame.counters["records"] < frame.counters["pixels_covered"]
    covered = frame.layers["indirect"].max(axis=2) > 0
    assert covered.mean() > 0.95


@pytest.mark.parametrize("placement", ["split-sphere", "bounded", "hessian"])
def test_black_surroundings(placement: str) -> None:
    """A lone floor under a lamp sees nothing: R is infinite, the zones are the largest there may be, and no light is indirect."""
    b = SceneBuilder("floor")
    b.quad(np.array([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]), b.material(Lambert("floor", (0.8,) * 3)))
    b.light(PointLight("lamp", (1.0, 1.0, 1.0), 10.0), (0, 0, 1))
    b.camera((0, -3, 2), (0, 0, 0), 1.0, (0, 0, 1))
    frame = drawn(b.build(), placement=placement)
    assert not frame.layers["indirect"].any()
    assert frame.layers["direct"].any()
    assert frame.counters["records"] < 60


def test_twenty_thousand_records() -> None:
    """a = 0.02, no smallest radius: 20,000 records and more in one image, computed in batches."""
    frame = drawn(room_2(), (224, 168), rays=16, a=0.02, r_min=1e-4, footprint=0, placement="split-sphere")
    assert frame.counters["records"] > 20_000
    assert frame.counters["records"] <= frame.counters["pixels_covered"]


def test_k6_accuracies_from_two_hundredths_to_one() -> None:
    """The smaller a, the more records and the less error against a record at every pixel. Rays leave through the centres of their
    cells: there is no noise, and the image converges to that of the records at every pixel."""
    world = room_2().world()
    canvas, here, light = exact(world, (48, 48), jitter=False)
    sampler = PolarSampler(world, FINE, ReflectedDirectLight(world), jitter=False)
    counts, errors = [], []
    for a in (1.0, 0.5, 0.25, 0.1, 0.05, 0.02):
        canvas.clear()
        how = Placement(a=a, limits=Limits(1e-3, 2.0, gradient=False, metric="hessian"))
        counts.append(len(fill(canvas, here, sampler, sampler.distances, how)))
        assert not canvas.missed.any()
        errors.append(np.sqrt(np.mean((canvas.irradiance[:, 0] - light) ** 2)) / light.mean())
    assert counts == sorted(counts)
    assert errors == sorted(errors, reverse=True)
    # two hundredths leave no pixel without a record of its own: float32 sums
    assert counts[-1] == len(canvas)
    assert errors[-1] < 1e-5


def test_an_image_of_one_pixel_and_a_limit_of_one_record() -> None:
    """The smallest image there is, and a limit of one record."""
    scene = renderers.load_scene("cornell-box")
    assert METHOD.render(scene, RcsSettings(rays=64), size=(1, 1)).layers["indirect"].shape == (1, 1, 3)
    frame = METHOD.render(scene, RcsSettings(rays=64, records=1), size=(16, 12))
    assert frame.counters["records"] == 1


def test_limits_hold_for_records_in_the_dark() -> None:
    """A record without any light has no curvature: its radius is the mean distance of what it sees, not the largest one."""
    world = room_2(intensity=0.0).world()
    _, here, light = exact(world, (8, 6), Grid(4, 14))
    assert not light.any()
    records = PolarSampler(world, Grid(8, 25), ReflectedDirectLight(world))(here)
    limits = Limits(1e-6, 1000.0, gradient=False, metric="hessian")
    np.testing.assert_allclose(limited(records, limits).radius, records.radius)
