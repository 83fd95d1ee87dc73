"""All bounces gathered from a coarse cache: closed forms, one bounce in the limit of black rooms, order of refinement."""

from dataclasses import replace

import numpy as np
import pytest
from caching_rooms import ALBEDOS_2, INTENSITY_2, room_2

from renderers.methods.rcs import RadianceCacheSplatting, RcsSettings
from renderers.scene.load import load_scene
from renderers.scene.model import Lambert, Scene
from renderers.transport.caching.bounces import AllReflectedLight, anchors_of
from renderers.transport.caching.hemisphere import Grid, PolarSampler
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Sites
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.sampling import surface_points
from renderers.transport.surface import surface_at

METHOD = RadianceCacheSplatting()
SIZE = (16, 12)
pytestmark = pytest.mark.usefixtures("software_device")  # the CPU path


def painted(albedo: float) -> Scene:
    scene = room_2(boxes=())
    return replace(scene, materials=tuple(Lambert(m.name, (albedo,) * 3) for m in scene.materials))


def test_a_closed_room_multiplies_its_light_by_the_geometric_series() -> None:
    """All walls of albedo ρ: by energy, the area-weighted mean of the irradiance of all bounces but direct is ρ/(1-ρ) times that of
    the direct light, 4πI over the walls' 80 m². Measured at 900 points spread by area; the indirect light is smooth: 2 %."""
    rho = 0.5
    world = painted(rho).world()
    gbuffer = cast_gbuffer(world, (48, 36))
    seen = Sites(*receivers_of(world, gbuffer, np.flatnonzero(gbuffer.covered)))
    direct = ReflectedDirectLight(world)
    anchors = anchors_of(world, seen, direct)
    points = surface_points(world, 900, 1, "low-discrepancy")
    surface = surface_at(world, points.triangle.astype(np.int32), points.u.astype(np.float32), points.v.astype(np.float32))
    geometric = world.normals_of(points.triangle)
    here = Sites(surface.position.astype(np.float64), geometric, geometric)
    found = PolarSampler(world, Grid(16, 50), AllReflectedLight(world, direct, anchors))(here).irradiance.mean()
    assert found == pytest.approx(rho / (1 - rho) * 4 * np.pi * INTENSITY_2 / 80, rel=0.02)


def test_black_walls_leave_one_bounce() -> None:
    """What is hit from a pixel reflects, what that sees doesn't: with black surfaces everywhere nothing is added at all."""
    for bounces in ("one", "all"):
        frame = METHOD.render(painted(0.0), RcsSettings(rays=64, bounces=bounces), size=SIZE)
        assert not frame.layers["indirect"].any()


def test_more_bounces_are_brighter_and_say_so() -> None:
    settings = RcsSettings(rays=256)
    one = METHOD.render(room_2(), settings, size=SIZE)
    whole = METHOD.render(room_2(), settings.model_copy(update={"bounces": "all"}), size=SIZE)
    assert METHOD.transport(settings) == "one-bounce"
    assert METHOD.transport(settings.model_copy(update={"bounces": "all"})) == "full"
    assert whole.counters["anchors"] > 100
    # albedos of 0.25 to 0.7: the further bounces of a closed room of mean albedo m are 1/(1-m) times the first, within its spread
    mean = np.mean(list(ALBEDOS_2.values()))
    ratio = whole.layers["indirect"].mean() / one.layers["indirect"].mean()
    assert 1 / (1 - min(ALBEDOS_2.values())) < ratio < 1.2 / (1 - mean)


def test_same_bytes_at_any_thread_count_with_all_bounces() -> None:
    import numba

    threads, images = numba.get_num_threads(), []
    try:
        for count in (1, threads):
            numba.set_num_threads(count)
            images.append(METHOD.render(room_2(), RcsSettings(rays=64, bounces="all"), size=SIZE).layers["indirect"].tobytes())
    finally:
        numba.set_num_threads(threads)
    assert images[0] == images[1]


@pytest.mark.parametrize("bounces", ["one", "all"])
@pytest.mark.parametrize("thickness", [0.0, 0.02])
def test_no_light_goes_through_a_thin_wall(bounces: str, thickness: float) -> None:
    """No path joins the rooms but through the wall, and none is found, although zones and the bounces' grid are larger than it."""
    scene = load_scene("thin-wall", thickness=thickness)
    frame = RadianceCacheSplatting().render(scene, RcsSettings(bounces=bounces, rays=256), size=(48, 27))
    world = scene.world()
    gbuffer = cast_gbuffer(world, (48, 27))
    x = gbuffer.position[..., 0] / world.scale + world.centre[0]
    indirect = frame.layers["indirect"].mean(axis=-1)
    assert indirect[gbuffer.covered & (x > 0)].mean() > 0.05
    assert not indirect[gbuffer.covered & (x < -0.01)].any()
