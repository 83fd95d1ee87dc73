"""Backward cuts against instant radiosity with the same virtual lights: exact in their limits, unbiased where they claim it."""

from __future__ import annotations

import numpy as np
import pytest

import renderers
from renderers.methods.ir import InstantRadiosity, IrSettings
from renderers.methods.lightcuts_solid_angle import SolidAngleCuts, SolidAngleSettings, TreeMethod, TreeSettings
from renderers.methods.stochastic_lightcuts import StochasticLightcuts, StochasticSettings
from renderers.transport.light_tree import build
from renderers.transport.primary import cast_gbuffer
from renderers.transport.tree_gather import gather_stochastic
from renderers.transport.vpl import Vpls, emit_vpls

SIZE = (24, 14)


@pytest.fixture(autouse=True)
def _software_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """`auto` shall not ask for a GL context."""
    monkeypatch.setattr("renderers.method.device_string", lambda: "llvmpipe")


def indirect(method: object, scene: str, settings: object, seed: int = 2) -> np.ndarray:
    frame = method.render(renderers.load_scene(scene), settings, size=SIZE, seed=seed)  # type: ignore[attr-defined]
    return np.asarray(frame.layers["indirect"], np.float64)


@pytest.mark.parametrize("scene", ["cornell-box", "cornell-glossy"])
def test_a_cut_of_leaves_is_instant_radiosity(scene: str) -> None:
    """ε_Ω → 0 opens all nodes that may bring light; float64 against float32 sums, 1e-5."""
    ours = indirect(SolidAngleCuts(), scene, SolidAngleSettings(vpls=500, epsilon_omega=1e-9))
    theirs = indirect(InstantRadiosity(), scene, IrSettings(vpls=500))
    np.testing.assert_allclose(ours, theirs, rtol=3e-5, atol=1e-7)


@pytest.mark.parametrize("scene", ["thin-wall", "cornell-glossy"])
@pytest.mark.parametrize(
    ("method", "settings"),
    [
        (SolidAngleCuts(), SolidAngleSettings(vpls=500, epsilon_omega=1e-9, visibility="raycast")),
        (StochasticLightcuts(), StochasticSettings(vpls=500, cut_size=4096, tolerance=0, visibility="raycast")),
    ],
)
def test_a_cut_of_leaves_with_shadow_rays_is_instant_radiosity_with_them(
    monkeypatch: pytest.MonkeyPatch, method: TreeMethod, settings: TreeSettings, scene: str
) -> None:
    """Both test all pairs that face one another; rays that graze an edge may end otherwise in the other's roundings."""
    monkeypatch.setattr("renderers.transport.tree_gather.PAIRS", 5000)  # lists of some ten pixels at a time
    ours = indirect(method, scene, settings)
    theirs = indirect(InstantRadiosity(), scene, IrSettings(vpls=500, visibility="raycast"))
    open_ = indirect(InstantRadiosity(), scene, IrSettings(vpls=500))
    off = np.abs(ours - theirs).max(axis=-1) > 1e-4 * theirs.max(axis=-1) + 1e-7
    assert off.mean() < 0.03
    np.testing.assert_allclose(ours.mean(), theirs.mean(), rtol=2e-3)
    assert theirs.mean() < 0.95 * open_.mean()
    assert method.transport(settings) == "one-bounce"


def test_error_and_work_of_the_cut_follow_the_solid_angle() -> None:
    scene = renderers.load_scene("empty-room")
    truth = InstantRadiosity().render(scene, IrSettings(vpls=4096), size=SIZE).layers["indirect"]
    errors, work = [], []
    for epsilon in (0.3, 0.03, 0.003):
        frame = SolidAngleCuts().render(scene, SolidAngleSettings(vpls=4096, epsilon_omega=epsilon), size=SIZE)
        errors.append(float(np.sqrt(np.mean((frame.layers["indirect"] - truth) ** 2)) / truth.mean()))
        work.append(frame.counters["light_evaluations"] / frame.counters["pixels_covered"])
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.01
    assert work[0] < work[1] < work[2]
    assert work[1] < 0.3 * 4096


@pytest.mark.parametrize("cut_size", [1, 16])
@pytest.mark.parametrize("scene", ["cornell-box", "cornell-glossy"])
def test_stochastic_lightcuts_are_unbiased_for_any_cut(scene: str, cut_size: int) -> None:
    """400 seeds of the node sampling with fixed VPLs against their sum: at most 1 % of pixel values beyond 4 standard errors."""
    from collections import Counter

    world = renderers.load_scene(scene).world()
    g = cast_gbuffer(world, SIZE)
    vpls = emit_vpls(world, 200, 5)
    tree = build(vpls)
    runs = np.stack([gather_stochastic(g, world, tree, cut_size, 0.0, s, 1e-3, Counter()) for s in range(400)])[
        :, g.covered
    ].astype(float)
    from renderers.transport.gather import gather

    truth = gather(g, world, vpls.positions, vpls.normals, vpls.intensities, 1e-3)[g.covered]
    error = runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    off = np.abs(runs.mean(axis=0) - truth) > 4 * error + 1e-5 * truth
    assert off.mean() < 0.01
    assert runs.mean() == pytest.approx(truth.mean(), rel=0.02)


def test_a_larger_cut_is_less_noisy() -> None:
    truth = indirect(InstantRadiosity(), "empty-room", IrSettings(vpls=2048))
    errors = [
        np.sqrt(np.mean((indirect(StochasticLightcuts(), "empty-room", StochasticSettings(vpls=2048, cut_size=n)) - truth) ** 2))
        for n in (8, 64)
    ]
    assert errors[1] < 0.6 * errors[0]


def test_the_tree_sums_its_lights() -> None:
    rng = np.random.default_rng(3)
    n = 37
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    arrays = (rng.random((n, 3)), normals, rng.random((n, 3)))
    vpls = Vpls(*(a.astype(np.float32) for a in arrays), np.arange(n), n)
    tree = build(vpls)
    assert len(tree.right) == 2 * n - len(tree.roots)
    assert tree.leaves[tree.roots].sum() == n
    np.testing.assert_allclose(tree.intensity[tree.roots].sum(axis=0), vpls.intensities.sum(axis=0), rtol=1e-6)
    for node in np.flatnonzero(tree.right >= 0):
        for child in (node + 1, tree.right[node]):
            assert (tree.box[child, 0] >= tree.box[node, 0]).all()
            assert (tree.box[child, 1] <= tree.box[node, 1]).all()
            assert tree.leaves[child] < tree.leaves[node]


@pytest.mark.parametrize("method", [SolidAngleCuts(), StochasticLightcuts()])
def test_no_light_is_black_and_bytes_repeat(method: object) -> None:
    first, second = (indirect(method, "cornell-box", method.Settings(vpls=64)) for _ in range(2))  # type: ignore[attr-defined]
    assert first.tobytes() == second.tobytes()
    none = build(Vpls(*(np.zeros((0, 3), np.float32) for _ in range(3)), np.zeros(0, np.int64), 1))
    assert len(none.roots) == len(none.right) == 0
