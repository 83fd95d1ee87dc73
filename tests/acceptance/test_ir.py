"""Instant radiosity against closed forms: parallel plates, clamp energy, unbiasedness, convergence, bytes, scale, Transport."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import renderers
from renderers.gbuffer import GBuffer
from renderers.methods.ir import InstantRadiosity, IrSettings
from renderers.methods.one_bounce import backend_of
from renderers.scene.builder import SceneBuilder, look_rotation
from renderers.scene.model import DirectionalLight, Lambert, Scene
from renderers.transport.gather import gather

ROOT = Path(__file__).parents[2]
METHOD = InstantRadiosity()
SIZE = (12, 8)
SUN_ANGLE, SUN, RHO_SOURCE, RHO = 0.9, 3.0, 0.8, 0.5
CPU = "llvmpipe (LLVM 15.0.6, 256 bits)"


@pytest.fixture(autouse=True)
def _software_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """These tests are about the CPU path: `auto` shall not ask for a GL context."""
    monkeypatch.setattr("renderers.method.device_string", lambda: CPU)


def plates(scale: float = 1.0, gap: float = 1.0) -> Scene:
    """Unit squares facing each other at distance `gap`; a slanting sun reaches the upper one from below, past the lower one.

    tan(0.9) = 1.26 > 1: over the gap the ray moves farther sideways than the plate is wide, so the lower plate shadows nothing and
    gets no direct light on its upper side. The upper plate then has radiance ρ/π · E cos 0.9 everywhere.
    """
    b = SceneBuilder("plates")
    lower, upper = b.material(Lambert("lower", (RHO,) * 3)), b.material(Lambert("upper", (RHO_SOURCE,) * 3))
    ring = np.array([(-0.5, 0, 0.5), (0.5, 0, 0.5), (0.5, 0, -0.5), (-0.5, 0, -0.5)])
    b.quad(ring * scale, lower)
    b.quad((ring[::-1] + np.array([0, gap, 0])) * scale, upper)
    b.light(DirectionalLight("sun", intensity=SUN), rotation=look_rotation(np.array([np.sin(SUN_ANGLE), np.cos(SUN_ANGLE), 0])))
    b.camera(np.array([0.0, 0.9 * gap, 0.8]) * scale, (0, 0, 0), 0.5)
    return b.build()


def exact_plates(scene: Scene, g: GBuffer, gap: float = 1.0, scale: float = 1.0) -> np.ndarray:
    """Indirect radiance of the lower plate: ρ L F, F the form factor of a point and a parallel rectangle (Howell B-3)."""
    world = scene.world()
    metres = (g.position.astype(np.float64) / world.scale + world.centre) / scale
    radiance = RHO_SOURCE / np.pi * SUN * np.cos(SUN_ANGLE)

    def corner(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        p, q = np.sqrt(1 + a * a), np.sqrt(1 + b * b)
        return np.asarray((a / p * np.arctan(b / p) + b / q * np.arctan(a / q)) / (2 * np.pi))

    x, z = metres[..., 0], metres[..., 2]
    sides = [(s * (0.5 + s * x)) / gap for s in (1, -1)], [(s * (0.5 + s * z)) / gap for s in (1, -1)]
    (right, left), (front, back) = ((s[0], -s[1]) for s in sides)
    factor = corner(left, back) + corner(left, front) + corner(right, back) + corner(right, front)
    return np.where(g.covered, RHO * radiance * factor, 0)


def gbuffer_of(scene: Scene) -> GBuffer:
    from renderers.transport.primary import cast_gbuffer

    return cast_gbuffer(scene.world(), SIZE)


def indirect(scene: Scene, seed: int, **settings: object) -> np.ndarray:
    frame = METHOD.render(scene, IrSettings(**settings), size=SIZE, seed=seed)  # type: ignore[arg-type]
    return frame.layers["indirect"][..., 0].astype(np.float64)


@pytest.mark.parametrize("visibility", ["none", "raycast"])
@pytest.mark.parametrize("sampler", ["uniform", "low-discrepancy"])
def test_plates_have_their_closed_form_without_bias(visibility: str, sampler: str) -> None:
    scene = plates()
    exact = exact_plates(scene, gbuffer_of(scene))
    assert np.count_nonzero(exact) > 30
    runs = np.stack([indirect(scene, s, vpls=256, eps_b=0.0, visibility=visibility, sampler=sampler) for s in range(48)])
    mean, error = runs.mean(axis=0), runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    # float32 positions, intensities and sums: a relative 1e-5 on top of the sampling error.
    assert (np.abs(mean - exact) <= 4 * error + 1e-5 * exact).all()


def test_scrambled_sobol_points_beat_independent_ones() -> None:
    scene = plates()
    exact = exact_plates(scene, gbuffer_of(scene))
    rms = [
        np.sqrt(np.mean([(indirect(scene, s, vpls=1024, eps_b=0.0, sampler=k) - exact) ** 2 for s in range(16)]))
        for k in ("uniform", "low-discrepancy")
    ]
    assert rms[1] < rms[0] / 2


def test_error_falls_with_the_square_root_of_n() -> None:
    """Slope of log RMS over log N. 128 seeds whose image error has about 2 degrees of freedom each give the RMS to 1/√512 = 4.4 %,
    the slope over a factor of 64 in N to √2 · 0.044 / ln 64 = 0.015: 0.05 is 3 of those."""
    scene = plates()
    exact = exact_plates(scene, gbuffer_of(scene))
    counts = (32, 256, 2048)
    rms = [np.sqrt(np.mean([(indirect(scene, s, vpls=n, eps_b=0.0) - exact) ** 2 for s in range(128)])) for n in counts]
    slope = np.polyfit(np.log(counts), np.log(rms), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.05)


def test_the_mean_does_not_move_from_n_to_4n() -> None:
    scene = renderers.load_scene("cornell-box")
    means = {n: np.array([indirect(scene, s, vpls=n).mean() for s in range(48)]) for n in (64, 256)}
    error = np.sqrt(sum(m.var(ddof=1) / len(m) for m in means.values()))
    assert abs(means[64].mean() - means[256].mean()) < 4 * error


def receiver(world_scene: Scene, points: np.ndarray) -> GBuffer:
    """A G-buffer of chosen points facing +Y, albedo 1."""
    n = len(points)
    one = np.ones((1, n, 3), np.float32)
    up = np.tile(np.array([0, 1, 0], np.float32), (1, n, 1))
    zero = np.zeros((1, n), np.int32)
    eye = world_scene.world().camera.pose[:3, 3]
    return GBuffer(points.astype(np.float32).reshape(1, n, 3), up, one, 0 * one, zero, zero, eye)


def lattice_lights(center: np.ndarray, u: np.ndarray, v: np.ndarray, normal: np.ndarray, count: int) -> tuple[np.ndarray, ...]:
    """count² lights of unit radiance on the rectangle centre ± u ± v: the midpoint rule."""
    s = (np.arange(count) + 0.5) / count * 2 - 1
    a, b = (x.ravel()[:, None] for x in np.meshgrid(s, s, indexing="ij"))
    positions = center + a * u + b * v
    area = 4 * np.linalg.norm(np.cross(u, v))
    intensity = np.full_like(positions, area / count**2)
    return positions.astype(np.float32), np.tile(normal, (len(positions), 1)).astype(np.float32), intensity.astype(np.float32)


def lost_energy(lights: tuple[np.ndarray, ...], eps_b: float) -> float:
    """E - E_b at the origin (E from radiance 1)."""
    scene = plates()
    g, world = receiver(scene, np.zeros((1, 3))), scene.world()
    images = [gather(g, world, *lights, eps)[0, 0, 0] * np.pi for eps in (0.0, eps_b)]
    return float(images[0]) - float(images[1])


@pytest.mark.parametrize("q", [0.1, 0.3, 0.7])
def test_clamped_energy_of_a_parallel_plane(q: float) -> None:
    """Spec 2.3: E_b/E = q (1 + ln(1/q)), q = d²/ε_b, E = π. The loss is all from within √ε_b, so a finite plate shows it."""
    d = 0.1
    lights = lattice_lights(np.array([0, d, 0]), np.array([0.5, 0, 0]), np.array([0, 0, 0.5]), np.array([0, -1.0, 0]), 900)
    assert lost_energy(lights, d * d / q) == pytest.approx(np.pi * (1 - q * (1 + np.log(1 / q))), abs=2e-3)


@pytest.mark.parametrize(("share", "ratio"), [(0.1, 0.2351), (0.2, 0.4327), (0.5, 0.8270), (0.8, 0.9827)])
def test_clamped_energy_of_a_wall(share: float, ratio: float) -> None:
    """Spec 2.3: half-infinite wall at distance d = share · √ε_b, E = π/2: the table's ratios."""
    d = 0.05
    eps_b = (d / share) ** 2
    reach = 1.02 * np.sqrt(eps_b)
    wall = lattice_lights(
        np.array([d, reach / 2, 0]), np.array([0, reach / 2, 0]), np.array([0, 0, reach]), np.array([-1.0, 0, 0]), 900
    )
    assert lost_energy(wall, eps_b) == pytest.approx(np.pi / 2 * (1 - ratio), abs=2e-3)


@pytest.mark.parametrize("scale", [1e-3, 1e4])
@pytest.mark.parametrize("visibility", ["none", "raycast"])
def test_scale_invariance(scale: float, visibility: str) -> None:
    """Same scene in other metres, irradiance light: the same image. Default clamp scales with the scene."""
    one = indirect(plates(), 3, vpls=512, visibility=visibility)
    other = indirect(plates(scale), 3, vpls=512, visibility=visibility)
    np.testing.assert_allclose(other, one, rtol=2e-5, atol=1e-7)


SCRIPT = """
import hashlib, sys
import renderers, renderers.method
renderers.method.device_string = lambda: "llvmpipe"
method = renderers.get_method("ir")
for visibility in ("none", "raycast"):
    scene = renderers.load_scene("cornell-box")
    frame = method.render(scene, method.Settings(vpls=700, visibility=visibility, sampler="low-discrepancy"), size=(96, 54), seed=5)
    print(hashlib.sha256(frame.layers["beauty"].tobytes()).hexdigest(), dict(frame.counters))
"""


def test_same_bytes_in_other_processes_and_at_other_thread_counts() -> None:
    outputs = [
        subprocess.run(
            [sys.executable, "-c", SCRIPT],
            env=os.environ | {"NUMBA_NUM_THREADS": str(n), "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for n in (1, 2, 2)
    ]
    assert len(outputs[0].splitlines()) == 2
    assert outputs[0] == outputs[1] == outputs[2]


@pytest.mark.mitsuba
def test_one_bounce_matches_path_tracing() -> None:
    """Transport one-bounce: beauty with ray-cast visibility, no clamp, against Mitsuba's path of depth 3."""
    from tests.unit.transport.mitsuba_world import path_traced

    scene = renderers.load_scene("cornell-box")
    world = scene.world()
    settings = IrSettings(vpls=1024, eps_b=0.0, visibility="raycast", sampler="low-discrepancy")
    runs = np.stack([METHOD.render(scene, settings, size=(24, 14), seed=s).layers["beauty"] for s in range(16)]).astype(np.float64)
    truth, noise = path_traced(world, (24, 14), 3, 4096)
    error = np.sqrt((runs.std(axis=0, ddof=1) / 4) ** 2 + noise**2) + 1e-4 * truth
    z = (runs.mean(axis=0) - truth)[error > 0] / error[error > 0]
    # An unclamped 1/r² has heavy tails near edges, so the 16-run standard error understates it there: 97 % of pixels within 4.
    assert np.mean(np.abs(z) < 4) > 0.97
    assert np.median(np.abs(runs.mean(axis=0) - truth) / np.maximum(truth, 1e-3)) < 0.01


@pytest.mark.gl
@pytest.mark.parametrize("scene", ["cornell-box", "cornell-glossy"])
def test_both_backends_draw_one_image(scene: str) -> None:
    """Coverage may differ in pixels whose centre an edge crosses; elsewhere float32 G-buffers (1e-6 of size 1) move G_b by about
    2e-6/r, with r ≥ the clamp's 0.01 of size: 2e-4."""
    layers = [
        METHOD.render(renderers.load_scene(scene), IrSettings(vpls=256, backend=backend), size=(64, 36)).layers["beauty"]
        for backend in ("cpu", "gl")
    ]
    difference = np.abs(layers[0] - layers[1]).max(axis=-1)
    assert np.mean(difference > 2e-4 * layers[0].max(axis=-1) + 1e-6) < 0.002


@pytest.mark.gl
def test_shadow_maps_change_the_direct_layer_alone() -> None:
    scene = renderers.load_scene("cornell-box")
    exact, mapped = (
        METHOD.render(scene, IrSettings(vpls=64, direct_visibility=kind), size=(64, 36)).layers
        for kind in ("raycast", "shadow-map")
    )
    np.testing.assert_array_equal(exact["indirect"], mapped["indirect"])
    off = np.abs(exact["direct"] - mapped["direct"]).max(axis=-1) > 1e-3 * exact["direct"].max(axis=-1) + 1e-6
    assert np.mean(off) < 0.01


def test_layers_and_counters() -> None:
    frame = METHOD.render(renderers.load_scene("cornell-box"), IrSettings(vpls=64, subpixels=2), size=SIZE)
    np.testing.assert_array_equal(frame.layers["beauty"], frame.layers["direct"] + frame.layers["indirect"])
    assert frame.counters["vpls_drawn"] == 64
    assert frame.counters["light_evaluations"] == frame.counters["pixels_covered"] * frame.counters["vpls_lit"]
    assert {t.name: t.stage for t in frame.timings} == {
        "warm-up": "prepare", "vpls": "render", "gbuffer": "render", "direct": "render", "gather": "render",
    }  # fmt: skip


def test_the_sky_is_seen_on_the_background() -> None:
    from renderers.scene.model import Environment

    b = SceneBuilder("sky above a plate")
    b.quad([(-0.1, 0, 0.1), (0.1, 0, 0.1), (0.1, 0, -0.1), (-0.1, 0, -0.1)], b.material(Lambert("plate")))
    b.environment = Environment((0.1, 0.2, 0.3))
    b.camera((0, 0.2, 1), (0, 0.2, 0), 1.0)
    for visibility in ("none", "raycast"):
        frame = METHOD.render(b.build(), IrSettings(vpls=8, visibility=visibility), size=SIZE)
        np.testing.assert_allclose(frame.layers["beauty"][0], np.broadcast_to(np.float32([0.1, 0.2, 0.3]), (SIZE[0], 3)))


def test_settings_are_resolved_by_a_table() -> None:
    scene = plates(2.0)
    assert METHOD.resolve(scene, IrSettings(), "NVIDIA H100/PCIe").backend == "gl"
    assert METHOD.resolve(scene, IrSettings(), CPU).backend == "cpu"
    assert METHOD.resolve(scene, IrSettings(backend="gl"), CPU).backend == "gl"
    assert backend_of("gl", "raycast", "NVIDIA") == "cpu"
    # Half diagonal of a box 2×2×2.
    assert METHOD.resolve(scene, IrSettings(), CPU).eps_b == pytest.approx((0.01 * np.sqrt(3)) ** 2)
    assert METHOD.resolve(scene, IrSettings(eps_b=0.0), CPU).eps_b == 0
    assert METHOD.transport(IrSettings()) == "one-bounce-unoccluded"
    assert METHOD.transport(IrSettings(visibility="raycast")) == "one-bounce"
