"""The five transports against closed forms and against each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import renderers
from renderers.images import luminance
from renderers.reference import render
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import GGX, Lambert, Material, Phong, PointLight, Scene
from renderers.scene.shapes import disc

pytestmark = pytest.mark.mitsuba

CUBE = [
    [(-1, -1, 1), (1, -1, 1), (1, -1, -1), (-1, -1, -1)],
    [(-1, 1, -1), (1, 1, -1), (1, 1, 1), (-1, 1, 1)],
    [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1)],
    [(1, -1, 1), (-1, -1, 1), (-1, 1, 1), (1, 1, 1)],
    [(-1, -1, 1), (-1, -1, -1), (-1, 1, -1), (-1, 1, 1)],
    [(1, -1, -1), (1, -1, 1), (1, 1, 1), (1, 1, -1)],
]


def room(material: Material, light: PointLight | None = None) -> Scene:
    """A closed cube of edge 2 m seen from inside, with a light off its centre."""
    b = SceneBuilder("room")
    wall = b.material(material)
    for corners in CUBE:
        b.quad(corners, wall)
    if light is not None:
        b.light(light, (0.3, 0.4, -0.2))
    b.camera((-0.6, -0.5, 0.7), (0.5, 0.2, -0.4), 1.2)
    return b.build()


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.9])
def test_furnace(albedo: float) -> None:
    """Inside a closed room whose walls all emit 1 and reflect a, radiance is 1 + a + a² + … = 1 / (1 - a)."""
    scene = room(Lambert("wall", (albedo,) * 3, emission=(1.0, 1.0, 1.0)))
    image = render(scene, "full", (16, 12), noise=1.0).image
    assert image.mean() == pytest.approx(1 / (1 - albedo), rel=0.01)
    direct = render(scene, "direct", (16, 12), noise=1.0).image
    np.testing.assert_allclose(direct.mean(), 1 + albedo, rtol=0.01)
    bounced = render(scene, "one-bounce", (16, 12), noise=1.0).image
    np.testing.assert_allclose(bounced.mean(), 1 + albedo + albedo**2, rtol=0.01)


def means(
    scene: Scene, transport: renderers.Transport, size: tuple[int, int] = (16, 12), **more: Any
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Mean image and its standard error per channel."""
    reference = render(scene, transport, size, noise=more.pop("noise", 1.0), **more)
    return reference.image, np.sqrt(reference.variance)


def test_transports_nest_in_the_cornell_box() -> None:
    scene = renderers.load_scene("cornell-box")
    images = {t: means(scene, t)[0] for t in renderers.TRANSPORTS}
    surface = images["full"].sum(axis=2) > 0
    assert np.all(images["direct"] <= images["one-bounce"] + 1e-6)
    one, full = (luminance(images[t])[surface].mean() for t in ("one-bounce", "full"))
    direct, unoccluded = (luminance(images[t])[surface].mean() for t in ("direct", "one-bounce-unoccluded"))
    assert direct < one < full
    assert one < unoccluded
    # White walls of albedo 0.7: the second bounce and later are worth more than a tenth and less than the first.
    assert 0.1 < (full - one) / (one - direct) < 1


@pytest.mark.parametrize(
    "material",
    [
        Lambert("wall", (0.6, 0.5, 0.4)),
        Phong("wall", (0.3, 0.2, 0.1), (0.4, 0.5, 0.6), 30.0),
        GGX("wall", (0.9, 0.6, 0.3), 1.0, 0.4),
        GGX("wall", (0.9, 0.6, 0.3), 0.0, 0.5),
    ],
)
def test_unoccluded_is_one_bounce_where_nothing_occludes(material: Material) -> None:
    """In a convex room every ray pierces one wall: the expectations agree, for diffuse and glossy ends of the path."""
    scene = room(material, PointLight(intensity=2.0))
    a, error_a = means(scene, "one-bounce")
    b, error_b = means(scene, "one-bounce-unoccluded")
    direct, _ = means(scene, "direct")
    spread = np.sqrt(error_a**2 + error_b**2)
    assert (a - direct).mean() > 0.05 * direct.mean()
    score = (a - b) / np.maximum(spread, 1e-7)
    # 576 values: a fair normal score stays under 4.5 with probability 0.996; their mean square is near 1.
    assert np.abs(score).max() < 5
    assert np.mean(score**2) < 1.5


def plates(middle: bool) -> Scene:
    """Floor, an occluder 1 m above it, and a ceiling at 2 m lit by a lamp between occluder and ceiling."""
    b = SceneBuilder("plates")
    floor, hidden, ceiling = (b.material(Lambert(n, (a,) * 3)) for n, a in (("floor", 0.6), ("middle", 0.9), ("ceiling", 0.7)))
    for radius, height, material in ((1.0, 0.0, floor), (8.0, 1.0, hidden), (8.0, 2.0, ceiling)):
        if material != hidden or middle:
            p, n, t = disc(radius)
            b.node(meshes=(b.mesh(p[:, [0, 2, 1]] + [0, height, 0], t[:, ::-1], material, n[:, [0, 2, 1]]),))
    b.light(PointLight(intensity=5.0), (0, 1.5, 0))
    b.camera((0.5, 0.5, 0), (0, 0, 0), 0.005)
    return b.build()


def test_unoccluded_sees_the_outer_plate_through_the_occluder() -> None:
    """Floor under the lamp: the occluder's underside is dark; the ceiling, h above the lamp and H above the floor, contributes

    L = ρ_f/π ∫ (ρ_c/π) I h/(h² + r²)^{3/2} · H²/(H² + r²)² 2πr dr
    """
    from scipy.integrate import quad

    h, high = 0.5, 2.0
    integral = quad(lambda r: h / (h * h + r * r) ** 1.5 * high**2 / (high**2 + r * r) ** 2 * 2 * np.pi * r, 0, 8)[0]
    expected = 0.6 / np.pi * 0.7 / np.pi * 5 * integral
    image, error = means(plates(middle=True), "one-bounce-unoccluded", (4, 4))
    assert abs(image.mean() - expected) < 5 * np.sqrt((error**2).mean() / 16) + 1e-4 * expected
    assert not means(plates(middle=True), "one-bounce", (4, 4))[0].any()
    direct, _ = means(plates(middle=False), "direct", (4, 4))
    open_image, open_error = means(plates(middle=False), "one-bounce-unoccluded", (4, 4))
    assert abs((open_image - direct).mean() - expected) < 5 * np.sqrt((open_error**2).mean() / 16) + 1e-4 * expected


def corner(height: float) -> Scene:
    b = SceneBuilder("corner")
    white = b.material(Lambert("white", (0.2, 0.2, 0.2)))
    b.quad([(-0.5, 0, 200), (2, 0, 200), (2, 0, -200), (-0.5, 0, -200)], white)
    b.quad([(-0.5, 0, 200), (-0.5, 0, -200), (-0.5, height, -200), (-0.5, height, 200)], white)
    b.light(PointLight(), (0, 1, 0))
    b.camera((0.5, 0.5, 0), (0, 0, 0), 0.01)
    return b.build()


def test_ambient_occlusion_beside_a_long_wall() -> None:
    """At distance d from an endless wall of height h, the sky's share is ½ (1 + d / √(d² + h²)); albedo and light don't count."""
    image, error = means(corner(1.0), "ambient-occlusion", (4, 4))
    expected = 0.5 * (1 + 0.5 / np.hypot(0.5, 1.0))
    assert abs(image.mean() - expected) < 5 * np.sqrt((error**2).mean() / 16) + 1e-3


def test_ambient_occlusion_within_a_radius_is_not_occluded() -> None:
    image, _ = means(corner(1.0), "ambient-occlusion", (4, 4), radius=0.4)
    np.testing.assert_allclose(image, 1.0, rtol=1e-6)


def test_ambient_occlusion_is_mitsubas_direct_under_a_white_sky() -> None:
    from renderers.reference.export import mi, mitsuba_scene
    from renderers.reference.sampling import CENTRE, mean_image, method_stream

    scene, size = renderers.load_scene("cornell-box"), (24, 18)
    ours, error = means(scene, "ambient-occlusion", size)
    clay = mitsuba_scene(scene.world(), size, clay=True)
    parts = {f"shape{k}": s for k, s in enumerate(clay.shapes())}
    lit = mi.load_dict({"type": "scene", "sensor": clay.sensors()[0], "sky": {"type": "constant", "radiance": 1.0}, **parts})
    integrator = mi.load_dict({"type": "direct", "hide_emitters": True})

    def estimate(scene: Any, sampler: Any, ray: Any, active: Any) -> Any:
        return integrator.sample(scene, sampler, mi.RayDifferential3f(ray), None, active)[0]

    theirs = np.array([mean_image(lit, estimate, size, 64, method_stream(1, k), CENTRE) for k in range(16)])
    spread = np.sqrt(error**2 + theirs.var(axis=0, ddof=1) / 16)
    score = (ours - theirs.mean(axis=0))[spread > 0] / spread[spread > 0]
    assert np.mean(score**2) < 1.5
    np.testing.assert_allclose(ours[spread == 0], theirs.mean(axis=0)[spread == 0], atol=1e-6)


def test_closed_scenes_have_no_sky_and_say_so() -> None:
    reference = render(room(Lambert()), "ambient-occlusion", (8, 6), noise=0.1)
    assert not reference.image.any()
    assert "closed scene" in reference.notes[0]


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_scale_does_not_matter(scale: float) -> None:
    """Lengths × s and intensity × s² leave radiance alone; offsets are relative: no leak at 1e-3, no lost shadow at 1e4."""

    def scaled(s: float) -> Scene:
        b = SceneBuilder("scaled")
        grey = b.material(Lambert("grey", (0.5, 0.5, 0.5)))
        b.quad((np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]) * s).tolist(), grey)
        b.quad((np.array([(-0.3, 0.3, 0.3), (0.3, 0.3, 0.3), (0.3, 0.3, -0.3), (-0.3, 0.3, -0.3)]) * s).tolist(), grey)
        b.light(PointLight(intensity=s * s), (0.1 * s, 0.9 * s, 0.0))
        b.camera(np.array([0, 1.2, 1.6]) * s, (0, 0, 0), 0.9)
        return b.build()

    one, other = (render(scaled(s), "direct", (48, 36), noise=1.0).image for s in (1.0, scale))
    differs = np.abs(one - other).max(axis=2) > 1e-3 * one.mean()
    # float32 positions round differently at another scale: a pixel centre on an edge may change sides.
    assert differs.mean() < 0.003


def test_multijitter_has_the_mean_of_independent_samples() -> None:
    """Within 4 standard errors over the image, and pixel by pixel; Mitsuba's own render loop draws the independent ones."""
    from renderers.reference.export import mi, mitsuba_scene

    scene, size = renderers.load_scene("cornell-box"), (24, 18)
    ours = render(scene, "one-bounce", size, noise=0.01, pixel="box")
    traced = mitsuba_scene(scene.world(), size)
    integrator = mi.load_dict({"type": "path", "max_depth": 3})
    theirs = np.array([np.array(mi.render(traced, integrator=integrator, spp=256, seed=1000 + k)) for k in range(16)])
    mean = luminance(theirs).mean(axis=(1, 2))
    total = np.sqrt(mean.var(ddof=1) / 16 + ours.luminance_variance.mean(dtype=np.float64) / ours.luminance_variance.size)
    assert abs(mean.mean() - luminance(ours.image).mean()) < 4 * total
    spread = np.sqrt(luminance(theirs).var(axis=0, ddof=1) / 16 + ours.luminance_variance)
    known = spread > 0
    score = (luminance(theirs).mean(axis=0) - luminance(ours.image))[known] / spread[known]
    assert np.mean(score**2) < 1.5
