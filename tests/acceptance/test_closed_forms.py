"""The built-in scenes of known answer: every renderer within 1 % of it, in the mean and pixel by pixel where it has no noise."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import renderers
from renderers.gbuffer import GBuffer
from renderers.images import luminance
from renderers.scene.builtin import exact
from renderers.scene.model import Scene

pytestmark = pytest.mark.mitsuba

SIZE = (36, 24)
PART_IN_HUNDRED = 0.01
F64 = NDArray[np.float64]


def seen(scene: Scene) -> tuple[GBuffer, F64]:
    """First hits, and their positions in metres, float64 (H, W, 3)."""
    from renderers.transport.primary import cast_gbuffer

    world = scene.world()
    gbuffer = cast_gbuffer(world, SIZE)
    return gbuffer, world.centre + gbuffer.position / world.scale


def upward(gbuffer: GBuffer, points: F64) -> NDArray[np.bool_]:
    """Pixels that see the upper side of the plane y = 0, where the formulas hold."""
    return gbuffer.covered & (np.abs(points[..., 1]) < 1e-4) & (gbuffer.normal[..., 1] > 0.99)


def assert_close(image: NDArray[np.float32], truth: F64, where: NDArray[np.bool_]) -> None:
    """The mean over the pixels `where` is within 1 % of the exact one."""
    assert np.count_nonzero(where) > 50
    assert luminance(image)[where].mean() == pytest.approx(truth[where].mean(), rel=PART_IN_HUNDRED)


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.9])
def test_pt_in_the_furnace(albedo: float) -> None:
    """L = 1 / (1 - a), in the mean, and in each pixel within its own noise."""
    scene = renderers.load_scene("furnace", albedo=albedo)
    pt = renderers.get_method("pt")
    frames = np.stack([luminance(pt.render(scene, pt.Settings(spp=16), size=SIZE, seed=s).layers["beauty"]) for s in range(8)])
    assert frames.mean() == pytest.approx(exact.furnace_radiance(albedo), rel=PART_IN_HUNDRED)
    error = frames.std(axis=0, ddof=1) / np.sqrt(len(frames))
    off = np.abs(frames.mean(axis=0) - exact.furnace_radiance(albedo))
    # Student's t with 7 degrees of freedom exceeds 8 in 1 of 11,000 draws; 864 pixels may hold one.
    assert np.count_nonzero(off > 8 * error + 1e-5) <= 1


@pytest.mark.parametrize("spp", [4, 16, 64])
def test_few_samples_are_as_right_as_many(spp: int) -> None:
    """Long paths, few samples: samplers that stratify too few of them lose energy here. Four standard errors over 32 seeds."""
    scene = renderers.load_scene("furnace", albedo=0.9, shape="box")
    pt = renderers.get_method("pt")
    means = np.array([pt.render(scene, pt.Settings(spp=spp), size=SIZE, seed=s).layers["beauty"].mean() for s in range(32)])
    assert abs(means.mean() - exact.furnace_radiance(0.9)) < 4 * means.std(ddof=1) / np.sqrt(32)


@pytest.mark.parametrize("occluder", [0.0, 0.4])
def test_direct_light_of_a_rectangle(occluder: float) -> None:
    """Lambert's formula, with and without a penumbra: ray casting and Mitsuba."""
    from renderers.transport.direct import direct

    scene = renderers.load_scene("rectangle-light", occluder=occluder)
    gbuffer, points = seen(scene)
    floor = upward(gbuffer, points)
    albedo, radiance = 0.6, 5.0
    truth = albedo / np.pi * exact.rectangle_irradiance(points, radiance=radiance, occluder=occluder)
    ours = direct(scene.world(), gbuffer, light_samples=64, seed=1)
    assert_close(ours, truth, floor)
    assert_close(renderers.reference.render(scene, "direct", SIZE, 0.01).image, truth, floor)


def test_form_factor_of_parallel_plates() -> None:
    """π·L·F is the mean irradiance over the lower plate; here pixel by pixel, as direct light and as one bounce."""
    from renderers.transport.direct import direct

    lit = renderers.load_scene("parallel-plates", light="area")
    gbuffer, points = seen(lit)
    lower = upward(gbuffer, points)
    truth = 0.5 / np.pi * exact.parallel_plates_irradiance(points)
    assert_close(direct(lit.world(), gbuffer, light_samples=64, seed=1), truth, lower)
    assert_close(renderers.reference.render(lit, "direct", SIZE, 0.01).image, truth, lower)
    beam = renderers.load_scene("parallel-plates", light="directional")
    bounced = (
        renderers.reference.render(beam, "one-bounce", SIZE, 0.01).image
        - renderers.reference.render(beam, "direct", SIZE, 0.01).image
    )
    assert_close(bounced, 0.5 * truth, lower)


@pytest.mark.parametrize("visibility", ["none", "raycast"])
def test_ir_between_parallel_plates(visibility: str) -> None:
    """Without clamp and contact: 64 seeds of 256 VPLs within four standard errors, and within 1 % in the mean."""
    scene = renderers.load_scene("parallel-plates", light="directional")
    ir = renderers.get_method("ir")
    gbuffer, points = seen(scene)
    lower = upward(gbuffer, points)
    truth = float((0.25 / np.pi * exact.parallel_plates_irradiance(points))[lower].mean())
    settings = ir.Settings(vpls=256, eps_b=0.0, visibility=visibility, sampler="low-discrepancy")
    means = np.array([luminance(ir.render(scene, settings, size=SIZE, seed=s).layers["indirect"])[lower].mean() for s in range(64)])
    assert means.mean() == pytest.approx(truth, rel=PART_IN_HUNDRED)
    assert abs(means.mean() - truth) < 4 * means.std(ddof=1) / 8 + 1e-5 * truth


@pytest.mark.parametrize("method", ["ir", "pt"])
def test_more_samples_never_move_the_mean(method: str) -> None:
    """|Δ energy| from N to 4N stays under max(0.5 %, 4 standard errors) over 32 seeds."""
    scene = renderers.load_scene("cornell-box")
    m = renderers.get_method(method)
    name, few = {"ir": ("vpls", 128), "pt": ("spp", 4)}[method]
    means = [
        np.array(
            [luminance(m.render(scene, m.Settings(**{name: n}), size=SIZE, seed=s).layers["beauty"]).mean() for s in range(32)]
        )
        for n in (few, 4 * few)
    ]
    error = float(np.sqrt(sum(x.var(ddof=1) / 32 for x in means)))
    energy = float(means[1].mean())
    assert abs(float(means[0].mean()) - energy) < max(0.005 * energy, 4 * error)


@pytest.mark.parametrize(("source", "bounces"), [("sphere", None), ("sphere", 1), ("point", None)])
def test_spheres(source: str, bounces: int | None) -> None:
    """A sphere in a sphere and the integrating sphere: multiple bounces have a geometric series."""
    scene = renderers.load_scene("sphere-in-sphere", source=source)
    gbuffer, points = seen(scene)
    outer = gbuffer.covered & (np.linalg.norm(points, axis=-1) > 0.9)
    if source == "sphere":
        irradiance = exact.enclosed_sphere_irradiance(bounces=bounces)
    else:
        irradiance = exact.integrating_sphere_irradiance(bounces=bounces)
    truth = np.full(outer.shape, 0.5 / np.pi * irradiance)
    image = renderers.reference.render(scene, "full" if bounces is None else "one-bounce", SIZE, 0.01).image
    assert_close(image, truth, outer)
