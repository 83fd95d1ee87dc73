"""rsm, ssdo and dss against closed forms, against instant radiosity where they hold the same light, and GL against CPU."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

import renderers
from renderers.methods.dss import DeepScreenSpace
from renderers.methods.ir import InstantRadiosity, IrSettings
from renderers.methods.rsm import ReflectiveShadowMaps
from renderers.methods.ssdo import ScreenSpaceOcclusion
from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.exact import parallel_plates_irradiance
from renderers.scene.model import Environment, Lambert, Scene
from renderers.transport.primary import cast_gbuffer

SIZE = (48, 36)
PEERS = [ReflectiveShadowMaps(), ScreenSpaceOcclusion(), DeepScreenSpace()]
# widest discs and spheres: nothing is cut off
WHOLE: dict[str, Any] = {"rsm": {"radius": 1.5, "samples": 4096}, "dss": {"radius": 2.0, "surfel_size": 2.0}}


def indirect(method: Any, scene: Scene, size: tuple[int, int] = SIZE, seed: int = 0, **settings: Any) -> np.ndarray:
    frame = method.render(scene, method.Settings(**{"backend": "cpu"} | settings), size=size, seed=seed)
    return np.asarray(frame.layers["indirect"], np.float64)


@pytest.fixture
def _software_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """No GL context is asked for."""
    monkeypatch.setattr("renderers.method.device_string", lambda: "llvmpipe")


@pytest.mark.usefixtures("_software_device")
@pytest.mark.parametrize(("method", "within"), [(PEERS[0], 0.03), (PEERS[2], 0.02)], ids=["rsm", "dss"])
def test_one_bounce_between_plates_is_the_form_factor(method: Any, within: float) -> None:
    """Each pixel of the lower plate against Lambert's polygon formula. dss: a surfel is 2 pixels wide, midpoint quadrature. rsm: of
    the disc 1/13 is lit, so some 1,260 of 16,384 samples count; those of a Sobol' set err by less than 1/√1260 = 3 %."""
    scene = renderers.load_scene("parallel-plates")
    world, g = scene.world(), cast_gbuffer(scene.world(), SIZE)
    found = indirect(method, scene, eps_b=0.0, **WHOLE[method.name] | ({"samples": 16384} if method.name == "rsm" else {}))
    lower = g.covered & (world.centre[1] + g.position[..., 1] / world.scale < 1e-3)
    points = world.centre + g.position[lower] / world.scale
    exact = parallel_plates_irradiance(points, 1.0, 1.0, 0.5) * 0.5 / np.pi
    assert lower.sum() > 100
    np.testing.assert_allclose(found[lower][:, 0], exact, rtol=within)


@pytest.mark.usefixtures("_software_device")
@pytest.mark.parametrize("scene", ["cornell-box", "cornell-glossy", "corner"])
@pytest.mark.parametrize("method", [PEERS[0], PEERS[2]], ids=["rsm", "dss"])
def test_without_a_bound_the_mean_is_that_of_instant_radiosity(method: Any, scene: str) -> None:
    loaded = renderers.load_scene(scene)
    truth = indirect(InstantRadiosity(), loaded, vpls=32768, sampler="low-discrepancy")
    found = indirect(method, loaded, **WHOLE[method.name])
    assert found.mean() == pytest.approx(truth.mean(), rel=0.01)
    # some hundred samples meet what is lit, in the worst scene
    assert np.abs(found - truth).mean() < 0.03 * truth.mean()


@pytest.mark.usefixtures("_software_device")
@pytest.mark.parametrize(
    ("scene", "reach"), [({"name": "empty-room", "light": "spot"}, 16.0), ({"name": "cornell-box", "light": "area"}, 1.0)]
)
def test_reflective_maps_of_spot_and_area_lights(scene: dict[str, str], reach: float) -> None:
    """A cone, one tile; four lamp points, five tiles each."""
    loaded = renderers.load_scene(**scene)
    truth = indirect(InstantRadiosity(), loaded, vpls=32768, sampler="low-discrepancy")
    found = indirect(ReflectiveShadowMaps(), loaded, radius=reach, samples=2048)
    assert found.mean() == pytest.approx(truth.mean(), rel=0.03)


@pytest.mark.usefixtures("_software_device")
def test_printed_weights_keep_constant_light_but_not_light_nearby() -> None:
    """Σ w = measure of the disc for both; the printed ξ² takes from what is near, where the bounce is strongest."""
    from renderers.methods.rsm import views_of
    from renderers.transport.reflective import disc_samples

    world = renderers.load_scene("corner").world()
    view = views_of(world, 1, 16)[0]
    area, printed = (disc_samples(view, 0.5, 4096, 0, w)[:, 3] for w in ("area", "published"))
    reach = float(view.half.max())
    assert area.sum() == pytest.approx(np.pi * reach**2, rel=1e-3)
    assert printed.sum() == pytest.approx(np.pi * reach**2, rel=1e-3)
    scene = renderers.load_scene("corner")
    ours, theirs = (indirect(ReflectiveShadowMaps(), scene, weights=w, **WHOLE["rsm"]).mean() for w in ("area", "published"))
    assert theirs < 0.6 * ours


@pytest.mark.usefixtures("_software_device")
@pytest.mark.parametrize("method", [PEERS[0], PEERS[2]], ids=["rsm", "dss"])
def test_a_bound_only_takes_light_away(method: Any) -> None:
    scene = renderers.load_scene("cornell-box")
    bounded = [indirect(method, scene, **{**WHOLE[method.name], "radius": r}).mean() for r in (0.1, 0.3, 2.0)]
    assert 0 < bounded[0] < bounded[1] < bounded[2]


@pytest.mark.usefixtures("_software_device")
def test_surfels_cut_at_a_radius_give_the_disc_form_factor() -> None:
    """A receiver at distance d from a wide plane of radiance L: πL (1 - d²/R²), the disc of radius √(R² - d²)."""
    from renderers.gbuffer import GBuffer
    from renderers.transport.surfels import splat_surfels
    from renderers.transport.vpl import Vpls

    b = SceneBuilder("floor")
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], b.material(Lambert("white", (1.0, 1.0, 1.0))))
    b.camera((0, 2, 0.1), (0, 0, 0), 0.5)
    world = b.build().world()
    one = np.ones((1, 1, 3), np.float32)
    up = np.array([[[0, 1, 0]]], np.float32)
    eye = np.array([0.0, 1.0, 0.0])
    g = GBuffer(0 * one, up, one, 0 * one, np.zeros((1, 1), np.int32), np.zeros((1, 1), np.int32), eye)
    side, d, radius = 400, 0.2, 0.7
    at = (np.arange(side) + 0.5) / side * 2 - 1
    x, z = (a.ravel() for a in np.meshgrid(at, at))
    positions = np.stack([x, np.full_like(x, d), z], axis=1).astype(np.float32)
    normals = np.tile(np.array([[0, -1, 0]], np.float32), (side**2, 1))
    surfels = Vpls(positions, normals, np.full_like(positions, 4 / side**2), np.arange(side**2), side**2)
    counters = Counter[str]()
    image = splat_surfels(g, world, surfels, radius, 0.0, counters)
    # reflected radiance of albedo 1 is E/π; the disc's edge is known to half a cell, 1 % of its radius
    assert image[0, 0, 0] == pytest.approx(1 - d**2 / radius**2, rel=0.01)
    assert counters["pixels_touched"] == pytest.approx(np.pi * (radius**2 - d**2) / 4 * side**2, rel=0.01)


@pytest.mark.usefixtures("_software_device")
def test_pieces_cover_all_triangles_once_and_look_small() -> None:
    from renderers.transport.surfels import pieces_of

    world = renderers.load_scene("cornell-box").world()
    pieces = pieces_of(world, 100, 8.0, 6)
    np.testing.assert_allclose(np.bincount(pieces.points.triangle, pieces.area, len(world.triangles)), world.areas, rtol=1e-9)
    u, v = pieces.points.u, pieces.points.v
    assert ((u > 0) & (v > 0) & (u + v < 1)).all()
    coarse = pieces_of(world, 100, 32.0, 6)
    assert len(coarse.area) < len(pieces.area) / 8
    assert len(pieces_of(world, 100, 1.0, 0).area) == len(world.triangles)


@pytest.mark.usefixtures("_software_device")
def test_interleaved_surfels_keep_the_mean() -> None:
    scene = renderers.load_scene("cornell-box")
    whole = indirect(DeepScreenSpace(), scene, **WHOLE["dss"])
    parts = np.stack([indirect(DeepScreenSpace(), scene, seed=s, interleave=4, **WHOLE["dss"]) for s in range(8)])
    means = parts.mean(axis=(1, 2, 3))
    error = means.std(ddof=1) / np.sqrt(len(means))
    # the filter's weights at silhouettes move the mean by under 1 %
    assert abs(means.mean() - whole.mean()) < 4 * error + 0.01 * whole.mean()


def open_floor(wall: bool, back: bool = False) -> Scene:
    """A white floor under a constant sky of radiance 1; a wall on it, seen from the front or from behind."""
    b = SceneBuilder("floor")
    white = b.material(Lambert("white", (0.8, 0.8, 0.8)))
    b.quad([(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], white, "floor")
    if wall:
        b.quad([(-2, 0, -1), (2, 0, -1), (2, 1.5, -1), (-2, 1.5, -1)], white, "wall")
    b.environment = Environment((1.0, 1.0, 1.0))
    b.camera((0, 1.5, -4) if back else (0, 1.5, 4), (0, 0.3, -1), 0.7)
    return b.build()


@pytest.mark.usefixtures("_software_device")
def test_open_sky_without_blockers_is_the_albedo() -> None:
    """L = ρ · L_sky and no bounce; N = 256 points of a scrambled Sobol' set over 16 places: 1 %."""
    frame = ScreenSpaceOcclusion().render(open_floor(False), ScreenSpaceOcclusion.Settings(samples=256, backend="cpu"), size=SIZE)
    seen = cast_gbuffer(open_floor(False).world(), SIZE).covered
    np.testing.assert_allclose(frame.layers["direct"][seen], 0.8, rtol=0.01)
    np.testing.assert_array_equal(frame.layers["indirect"], 0)
    np.testing.assert_allclose(frame.layers["direct"][~seen], 1.0, rtol=1e-6)


@pytest.mark.usefixtures("_software_device")
def test_a_wall_in_view_blocks_the_sky_as_its_form_factor_says() -> None:
    """Before an endless wall of height h, at distance z, the sky's share is (1 + z/√(z²+h²))/2. Not all samples go as far as that:
    λ is uniform in [0, r_max], so a blocker at distance s hides a share (1 - s/r_max) of its directions. Hence the loss lies
    between 0 and the form factor, grows to the wall, and ends at r_max."""
    scene = open_floor(True)
    world, g = scene.world(), cast_gbuffer(scene.world(), (96, 72))
    settings = ScreenSpaceOcclusion.Settings(samples=256, radius=0.3, backend="cpu")
    frame = ScreenSpaceOcclusion().render(scene, settings, size=(96, 72))
    place = world.centre + g.position / world.scale
    floor = g.covered & (place[..., 1] < 1e-4) & (np.abs(place[..., 0]) < 0.5)
    z = place[..., 2][floor] + 1
    loss = 1 - frame.layers["direct"][floor][:, 0] / 0.8
    reach = 0.3 / world.scale
    # the filter looks 3 pixels, some 0.3 m, around
    assert np.abs(loss[z > reach + 0.3]).max() < 0.02
    near = (z > 0.1) & (z < 0.3)
    assert near.sum() > 10
    bound = (1 - z / np.hypot(z, 1.5)) / 2
    assert (loss[near] > 0.1).all()
    assert (loss[near] < bound[near] + 0.02).all()


@pytest.mark.usefixtures("_software_device")
def test_light_of_what_the_camera_does_not_see_is_missing() -> None:
    """The floor gets light from the wall's front; seen from behind, that side is hidden. dss doesn't ask the camera."""
    scenes = {back: open_floor(True, back) for back in (False, True)}
    ssdo = {back: indirect(ScreenSpaceOcclusion(), s, radius=0.5, samples=64).sum() for back, s in scenes.items()}
    assert ssdo[False] > 0
    front = cast_gbuffer(scenes[True].world(), SIZE)
    place = scenes[True].world().centre + front.position / scenes[True].world().scale
    before = front.covered & (place[..., 1] < 1e-4) & (place[..., 2] > -1)
    image = indirect(ScreenSpaceOcclusion(), scenes[True], radius=0.5, samples=64, block=1)
    # what is seen over the wall's edge, on the floor before its front: no lit surface of the front is visible
    assert np.abs(image[before]).sum() == 0


@pytest.mark.usefixtures("_software_device")
def test_one_sender_is_the_published_formula() -> None:
    """Two pixels, floor and wall, one sample at a time: the sum over N samples of ρ/π L A cos cos / d², written out as a loop."""
    from renderers.transport.screen_space import Search, bounce, sample_pattern

    scene = open_floor(True)
    world = scene.world()
    g = cast_gbuffer(world, (16, 12))
    search = Search(sample_pattern(16, 2, 3), 0.6, 0.05)
    senders = np.random.default_rng(1).random((12, 16, 3)).astype(np.float32)
    found = bounce(g, world, search, senders, 1e-4)
    pose, tangent = world.camera.pose, np.tan(world.camera.yfov / 2)
    expected = np.zeros((12, 16, 3))
    for y, x in np.argwhere(g.covered):
        p, n = g.position[y, x].astype(float), g.normal[y, x].astype(float)
        s = 1.0 if n[2] >= 0 else -1.0
        a = -1 / (s + n[2])
        t = np.array([1 + s * n[0] ** 2 * a, s * n[0] * n[1] * a, -s * n[0]])
        u = np.array([n[0] * n[1] * a, s + n[1] ** 2 * a, -n[1]])
        for local in search.pattern[(y % 2) * 2 + x % 2].astype(float):
            q = p + (local[0] * t + local[1] * u + local[2] * n) * local[3] * 0.6
            c = pose[:3, :3].T @ (q - pose[:3, 3])
            column = int(np.floor((c[0] / -c[2] / (tangent * 16 / 12) + 1) / 2 * 16))
            row = int(np.floor((1 - c[1] / -c[2] / tangent) / 2 * 12))
            if not (0 <= column < 16 and 0 <= row < 12 and g.covered[row, column]):
                continue
            seen = g.position[row, column].astype(float)
            way = seen - p
            behind = -(pose[:3, :3].T @ (seen - pose[:3, 3]))[2] < -c[2]
            if not behind or way @ n <= 0.05 * np.linalg.norm(way):
                continue
            d = way / np.linalg.norm(way)
            cosines = max(n @ d, 0) * max(-g.normal[row, column].astype(float) @ d, 0)
            expected[y, x] += 0.8 / np.pi * senders[row, column] * cosines / max(way @ way, 1e-4) * np.pi * 0.36 / 16
    assert (expected > 0).sum() > 50
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)


@pytest.mark.gl
@pytest.mark.parametrize("method", PEERS, ids=lambda m: m.name)
@pytest.mark.parametrize(
    "scene", [{"name": "cornell-glossy"}, {"name": "colonnade", "triangles": 20000, "sky": True}], ids=lambda s: s["name"]
)
def test_gl_is_the_cpu_path(method: Any, scene: dict[str, Any]) -> None:
    """Rasterised and ray-cast G-buffers and maps differ at silhouettes, sample tests at their borders: 95 % of pixels to 1 %, means
    to 0.5 %."""
    loaded = renderers.load_scene(**scene)
    settings = {"samples": 64} if method.name != "dss" else {}
    frames = [method.render(loaded, method.Settings(backend=b, **settings), size=SIZE) for b in ("cpu", "gl")]
    for layer in ("direct", "indirect"):
        cpu, gl = (f.layers[layer].astype(np.float64) for f in frames)
        assert gl.mean() == pytest.approx(cpu.mean(), rel=0.005)
        assert (np.abs(gl - cpu) < 0.01 * np.maximum(cpu, 0.1 * cpu.mean())).mean() > 0.95


@pytest.mark.usefixtures("_software_device")
@pytest.mark.parametrize("method", PEERS, ids=lambda m: m.name)
def test_bytes_repeat_and_layers_add_up(method: Any) -> None:
    scene = renderers.load_scene("cornell-box")
    first, second = (method.render(scene, method.Settings(subpixels=2), size=(16, 12), seed=3) for _ in range(2))
    for name, layer in first.layers.items():
        assert layer.tobytes() == second.layers[name].tobytes()
    assert dict(first.counters) == dict(second.counters)
    assert first.counters["pixels_covered"] > 4 * 100
    np.testing.assert_array_equal(first.layers["beauty"], first.layers["direct"] + first.layers["indirect"])
    direct = InstantRadiosity().render(scene, IrSettings(subpixels=2, vpls=1), size=(16, 12), seed=3).layers["direct"]
    np.testing.assert_array_equal(first.layers["direct"], direct)


@pytest.mark.usefixtures("_software_device")
def test_settings_out_of_range_are_refused_by_name() -> None:
    for method, field, value in ((PEERS[0], "radius", 0.0), (PEERS[1], "block", 3), (PEERS[2], "levels", 11)):
        with pytest.raises(ValueError, match=field):
            method.Settings(**{field: value})
