"""Phong and GGX in Mitsuba against the formulas in numpy, and their sampling against their densities."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytestmark = pytest.mark.mitsuba

F64 = NDArray[np.float64]
BASE = np.array([0.8, 0.5, 0.3])
SPECULAR = np.array([0.2, 0.3, 0.4])
PHONGS = [(1.0,), (20.0,), (500.0,)]
GGXS = [(0.0, 1.0), (0.0, 0.25), (1.0, 0.25), (0.5, 0.04), (1.0, 0.01)]


def phong(wi: F64, wo: F64, exponent: float) -> F64:
    """f, float64 (N, 3)."""
    mirror = wi * [-1, -1, 1]
    lobe = np.maximum((mirror * wo).sum(axis=1), 0) ** exponent
    return BASE / np.pi + SPECULAR * ((exponent + 2) / (2 * np.pi) * lobe)[:, None]


def ggx(wi: F64, wo: F64, metallic: float, alpha: float) -> F64:
    """f, float64 (N, 3), as written in glTF 2.0 Appendix B."""
    h = wi + wo
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    nv, nl, nh, vh = wi[:, 2], wo[:, 2], h[:, 2], np.abs((wi * h).sum(axis=1))
    f0 = 0.04 * (1 - metallic) + BASE * metallic
    fresnel = f0 + (1 - f0) * ((1 - vh) ** 5)[:, None]
    a2 = alpha**2
    d = a2 / (np.pi * (nh**2 * (a2 - 1) + 1) ** 2)
    vis = 0.5 / (nl * np.sqrt(nv**2 * (1 - a2) + a2) + nv * np.sqrt(nl**2 * (1 - a2) + a2))
    return (1 - fresnel) * BASE * (1 - metallic) / np.pi + fresnel * (d * vis)[:, None]


def make_phong(exponent: float) -> Any:
    from renderers.reference.export import mi

    rgb = {f"specular_{c}": float(v) for c, v in zip("rgb", SPECULAR, strict=True)}
    colour = {"type": "rgb", "value": list(BASE)}
    return mi.load_dict({"type": "luxmeter_phong", "diffuse": colour, **rgb, "exponent": exponent, "split": 0.4})


def make_ggx(metallic: float, alpha: float) -> Any:
    from renderers.reference.export import mi

    colour = {"type": "rgb", "value": list(BASE)}
    return mi.load_dict({"type": "luxmeter_ggx", "base": colour, "metallic": metallic, "alpha": alpha})


def directions(n: int, seed: int) -> F64:
    """Unit vectors of the upper hemisphere, not closer than 3 degrees to the horizon."""
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(0.05, 1, n), rng.uniform(0, 2 * np.pi, n)
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def interaction(wi: F64) -> Any:
    from renderers.reference.export import mi

    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(np.ascontiguousarray(wi.T, np.float32))
    si.uv = mi.Point2f(0.5)
    return si


@pytest.mark.parametrize(
    ("make", "oracle", "parameters"),
    [(make_phong, phong, p) for p in PHONGS] + [(make_ggx, ggx, p) for p in GGXS],
)
def test_eval_is_the_formula(make: Any, oracle: Any, parameters: tuple[float, ...]) -> None:
    from renderers.reference.export import mi

    wi = directions(2000, 1)
    # Half of the pairs lie near the mirror direction, where narrow lobes live.
    wo = np.where(np.arange(2000)[:, None] % 2, directions(2000, 2), wi * [-1, -1, 1] + 0.02 * (directions(2000, 3) - 0.5))
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    # The oracle gets the float32 directions that Mitsuba gets: a narrow lobe turns 6e-8 of direction into percents otherwise.
    wi, wo = (v.astype(np.float32).astype(np.float64) for v in (wi, wo))
    wi, wo = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (wi, wo))
    value = np.array(
        make(*parameters).eval(mi.BSDFContext(), interaction(wi), mi.Vector3f(np.ascontiguousarray(wo.T, np.float32)))
    ).T
    expected = oracle(wi, wo, *parameters) * wo[:, 2:3]
    keep = (wo[:, 2] > 0.01) & (wi[:, 2] > 0.01)
    # float32: cosⁿ multiplies the relative error of the cosine (1e-7) by n; D by 1/α² at the rim of the lobe.
    narrow = parameters[0] if make is make_phong else 0.1 / parameters[1] ** 2
    np.testing.assert_allclose(value[keep], expected[keep], rtol=2e-5 + 4e-7 * narrow, atol=1e-6)


@pytest.mark.parametrize(("make", "parameters"), [(make_phong, p) for p in PHONGS] + [(make_ggx, p) for p in GGXS])
def test_below_the_horizon_is_black(make: Any, parameters: tuple[float, ...]) -> None:
    from renderers.reference.export import mi

    wi = directions(64, 1)
    down = mi.Vector3f(np.ascontiguousarray((directions(64, 2) * [1, 1, -1]).T, np.float32))
    value, density = make(*parameters).eval_pdf(mi.BSDFContext(), interaction(wi), down)
    assert not np.array(value).any()
    assert not np.array(density).any()


@pytest.mark.parametrize(("make", "parameters"), [(make_phong, p) for p in PHONGS] + [(make_ggx, p) for p in GGXS])
@pytest.mark.parametrize("tilt", [0.05, 0.9, 1.4])
def test_sampling_follows_the_density(make: Any, parameters: tuple[float, ...], tilt: float) -> None:
    """∫ f cos by sampling equals ∫ f cos by uniform directions about the mirror and in the hemisphere, within 5 standard errors."""
    from renderers.reference.export import mi

    n = 400_000
    bsdf = make(*parameters)
    rng = np.random.default_rng(5)
    wi = np.tile([[np.sin(tilt), 0, np.cos(tilt)]], (n, 1))
    si = interaction(wi)
    u1, u2 = mi.Float(rng.random(n, np.float32)), mi.Point2f(rng.random((2, n), np.float32))
    bs, weight = bsdf.sample(mi.BSDFContext(), si, u1, u2)
    sampled = np.array(weight).T
    value, density = bsdf.eval_pdf(mi.BSDFContext(), si, bs.wo)
    value, density, claimed = np.array(value).T, np.array(density), np.array(bs.pdf)
    np.testing.assert_allclose(density, claimed, rtol=1e-4, atol=1e-6)
    lit = claimed > 0
    np.testing.assert_allclose(sampled[lit], (value / np.maximum(claimed, 1e-30)[:, None])[lit], rtol=1e-4, atol=1e-6)

    # An independent technique: a mixture of uniform directions and a cone about the mirror wide enough for the lobe.
    cone = np.cos(0.5 if parameters[-1] > 100 or (make is make_ggx and parameters[1] < 0.1) else 1.2)
    half = n // 2
    z = np.concatenate([rng.uniform(cone, 1, half), rng.random(half)])
    phi = rng.uniform(0, 2 * np.pi, n)
    r = np.sqrt(1 - z**2)
    local = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)
    mirror = np.array([-np.sin(tilt), 0, np.cos(tilt)])
    side = np.array([np.cos(tilt), 0, np.sin(tilt)])
    about = local[:, :1] * side + local[:, 1:2] * np.array([0, 1, 0]) + local[:, 2:] * mirror
    wo = np.where(np.arange(n)[:, None] < half, about, local)
    chance = 0.5 * ((wo @ mirror >= cone) / (2 * np.pi * (1 - cone))) + 0.5 * (wo[:, 2] >= 0) / (2 * np.pi)
    uniform = np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(np.ascontiguousarray(wo.T, np.float32)))).T / chance[:, None]
    error = np.sqrt(sampled.var(axis=0) / n + uniform.var(axis=0) / n)
    assert np.all(np.abs(sampled.mean(axis=0) - uniform.mean(axis=0)) < 5 * error)


@pytest.mark.parametrize(("make", "parameters"), [(make_phong, (20.0,)), (make_ggx, (0.0, 0.25)), (make_ggx, (1.0, 0.09))])
def test_histogram_of_directions_passes_chi_square(make: Any, parameters: tuple[float, ...]) -> None:
    """Pearson's test over 20x40 cells of (cos θ, φ); the expected counts integrate the density by 8x8 points a cell."""
    from scipy.stats import chi2

    from renderers.reference.export import mi

    n, rows, columns, fine = 500_000, 20, 40, 8
    bsdf = make(*parameters)
    rng = np.random.default_rng(11)
    wi = np.array([[np.sin(0.7), 0, np.cos(0.7)]])
    u1, u2 = mi.Float(rng.random(n, np.float32)), mi.Point2f(rng.random((2, n), np.float32))
    bs, _ = bsdf.sample(mi.BSDFContext(), interaction(np.tile(wi, (n, 1))), u1, u2)
    wo, drawn = np.array(bs.wo).T, np.array(bs.pdf) > 0
    phi = np.arctan2(wo[drawn, 1], wo[drawn, 0]) % (2 * np.pi)
    counts, _, _ = np.histogram2d(wo[drawn, 2], phi, bins=(rows, columns), range=((0, 1), (0, 2 * np.pi)))
    z = (np.arange(rows * fine) + 0.5) / (rows * fine)
    angle = (np.arange(columns * fine) + 0.5) / (columns * fine) * 2 * np.pi
    zz, aa = np.meshgrid(z, angle, indexing="ij")
    r = np.sqrt(1 - zz**2)
    grid = np.stack([r * np.cos(aa), r * np.sin(aa), zz]).reshape(3, -1).astype(np.float32)
    density = np.array(bsdf.pdf(mi.BSDFContext(), interaction(np.tile(wi, (grid.shape[1], 1))), mi.Vector3f(grid)))
    cells = density.reshape(rows, fine, columns, fine).mean(axis=(1, 3)) * (2 * np.pi / (rows * columns))
    expected = cells * n
    full = expected > 20
    statistic = ((counts - expected)[full] ** 2 / expected[full]).sum()
    # Samples that fall below the horizon are one more cell, so the kept cells are free: as many degrees as cells.
    assert statistic < chi2.ppf(0.999, full.sum())
