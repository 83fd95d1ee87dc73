"""BRDFs: one formula each, used by numpy (float64 arrays) and by numba kernels (scalars) alike.

n unit shading normal, l to the light, v to the viewer, both above the horizon (n·l > 0, n·v > 0, else f = 0); h their half vector.

    Lambert   ρ/π
    Phong     ρ_d/π + ρ_s (n+2)/(2π) max(0, r·v)ⁿ, r the mirror of l about n              Lafortune & Willems 1994
    GGX       (1-F) c_diff/π + F·D·Vis                                                    glTF 2.0 Appendix B
              f0 = lerp(0.04, base, metallic), c_diff = base (1-metallic), F = f0 + (1-f0)(1-|v·h|)⁵
              D = α²/(π(α² c² + s²)²) with c = n·h, s² = |n×h|² (equal to the textbook's (n·h)²(α²-1)+1, without its cancellation)
              Vis = 0.5/(n·l √((n·v)²(1-α²)+α²) + n·v √((n·l)²(1-α²)+α²))

Lambert and Phong keep energy (albedo ≤ ρ, and ≤ ρ_d + ρ_s). GGX with one bounce between microfacets loses energy on rough surfaces:
the furnace figures are in the tests.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import GGX_KIND, PHONG, MaterialTable

F64 = NDArray[np.float64]


class Materials(NamedTuple):
    """Material parameters per point: kind int32 (N,), base and specular float64 (N, 3), exponent, metallic, alpha float64 (N,)."""

    kind: NDArray[np.int32]
    base: F64
    specular: F64
    exponent: F64
    metallic: F64
    alpha: F64

    def rows(self, index: NDArray[np.intp] | slice) -> Materials:
        """The selected points."""
        return Materials(
            self.kind[index],
            self.base[index],
            self.specular[index],
            self.exponent[index],
            self.metallic[index],
            self.alpha[index],
        )


def materials_at(table: MaterialTable, material: NDArray[np.int32], base: NDArray[np.floating]) -> Materials:
    """Parameters of points with material rows (N,) and textured base colours (N, 3)."""
    return Materials(
        kind=table.kind[material],
        base=base.astype(np.float64),
        specular=table.specular[material].astype(np.float64),
        exponent=table.exponent[material].astype(np.float64),
        metallic=table.metallic[material].astype(np.float64),
        alpha=table.alpha[material].astype(np.float64),
    )


def phong_lobe(exponent: Any, rv: Any) -> Any:
    """(n+2)/(2π) max(0, r·v)ⁿ."""
    return (exponent + 2) / (2 * np.pi) * np.maximum(0.0, rv) ** exponent


def ggx_lobe(alpha: Any, nl: Any, nv: Any, nh: Any, sin2: Any) -> Any:
    """D·Vis; sin2 = |n×h|²."""
    a2 = alpha * alpha
    d = a2 / (np.pi * (nh * nh * a2 + sin2) ** 2)
    return d * 0.5 / (nl * np.sqrt(nv * nv * (1 - a2) + a2) + nv * np.sqrt(nl * nl * (1 - a2) + a2))


def schlick(vh: Any) -> Any:
    """(1 - |v·h|)⁵."""
    m = 1 - np.minimum(np.abs(vh), 1.0)
    return m * m * m * m * m


phong_lobe_scalar = numba.njit(phong_lobe, cache=True)
ggx_lobe_scalar = numba.njit(ggx_lobe, cache=True)
schlick_scalar = numba.njit(schlick, cache=True)


def evaluate(m: Materials, n: F64, light: F64, view: F64) -> F64:
    """f(l, v), float64 (N, 3); n, light, view unit (N, 3). 0 where light or view lie below the horizon of n."""
    nl, nv = _dot(n, light), _dot(n, view)
    f = m.base / np.pi
    rows = np.flatnonzero((m.kind == PHONG) & (nl > 0) & (nv > 0))
    if len(rows):
        rv = 2 * nl[rows] * nv[rows] - _dot(light[rows], view[rows])
        f[rows] += m.specular[rows] * phong_lobe(m.exponent[rows], rv)[:, None]
    rows = np.flatnonzero((m.kind == GGX_KIND) & (nl > 0) & (nv > 0))
    if len(rows):
        f[rows] = _ggx(m.rows(rows), n[rows], light[rows], view[rows], nl[rows], nv[rows])
    return np.where(((nl > 0) & (nv > 0))[:, None], f, 0.0)


def _ggx(m: Materials, n: F64, light: F64, view: F64, nl: F64, nv: F64) -> F64:
    half = light + view
    half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
    cross = np.cross(n, half)
    lobe = ggx_lobe(m.alpha, nl, nv, _dot(n, half), _dot(cross, cross))[:, None]
    f0, diffuse = ggx_colors(m)
    fresnel = f0 + (1 - f0) * schlick(_dot(view, half))[:, None]
    return np.asarray((1 - fresnel) * diffuse / np.pi + fresnel * lobe)


def ggx_colors(m: Materials) -> tuple[F64, F64]:
    """f0 and c_diff of GGX rows, float64 (N, 3) each."""
    metallic = m.metallic[:, None]
    return 0.04 * (1 - metallic) + m.base * metallic, m.base * (1 - metallic)


def mean_albedo(m: Materials) -> F64:
    """Reflected share of uniform incident light, float64 (N, 3): the albedo of the diffuse stand-in for a glossy source."""
    albedo = m.base.copy()
    for exponent in np.unique(m.exponent[m.kind == PHONG]):
        rows = np.flatnonzero((m.kind == PHONG) & (m.exponent == exponent))
        albedo[rows] += m.specular[rows] * phong_albedo(float(exponent))
    for alpha in np.unique(m.alpha[m.kind == GGX_KIND]):
        rows = np.flatnonzero((m.kind == GGX_KIND) & (m.alpha == alpha))
        f0, diffuse = ggx_colors(m.rows(rows))
        reflected, grazing, base = ggx_albedo(float(alpha))
        albedo[rows] = f0 * reflected + grazing + (1 - f0) * diffuse * base
    return albedo


@lru_cache(maxsize=256)
def phong_albedo(exponent: float) -> float:
    """Bihemispherical albedo of the Phong lobe for ρ_s = 1; 1 minus what falls below the horizon at oblique incidence."""
    m = Materials(np.full(1, PHONG, np.int32), np.zeros((1, 3)), np.ones((1, 3)), np.full(1, exponent), np.zeros(1), np.ones(1))
    return _bihemispherical(m)


@lru_cache(maxsize=256)
def ggx_albedo(alpha: float) -> tuple[float, float, float]:
    """(A, B, C): the bihemispherical albedo of GGX is f0·A + B + (1-f0)·c_diff·C for every colour.

    A = ⟨(1-s)·D·Vis⟩, B = ⟨s·D·Vis⟩, C = ⟨(1-s)/π⟩ with s Schlick's term; solved from three materials, since f is linear in them.
    """

    def of(base: float, metallic: float) -> float:
        return _bihemispherical(
            Materials(
                np.full(1, GGX_KIND, np.int32),
                np.full((1, 3), base),
                np.zeros((1, 3)),
                np.zeros(1),
                np.full(1, metallic),
                np.full(1, alpha),
            )
        )

    black, white, clear = of(0.0, 1.0), of(1.0, 1.0), of(1.0, 0.0)
    reflected = white - black
    return reflected, black, (clear - 0.04 * reflected - black) / 0.96


def _bihemispherical(m: Materials) -> float:
    """∬ f cos cos / π by importance-sampled quadrature: 16 angles of incidence × a fixed lattice of sampled directions."""
    from renderers.transport.lobes import sample_brdf, sampling_pdf
    from renderers.transport.sampling import lattice

    count, angles = 1 << 12, 16
    n = np.tile([0.0, 0.0, 1.0], (count, 1))
    points = lattice(count, 3)
    many = m.rows(np.zeros(count, np.intp))
    total = 0.0
    for k in range(angles):
        cosine = np.sqrt((k + 0.5) / angles)  # equal shares of cosine-distributed light
        view = np.tile([np.sqrt(1 - cosine * cosine), 0.0, cosine], (count, 1))
        light = sample_brdf(many, n, view, points)
        pdf = sampling_pdf(many, n, view, light)
        value = evaluate(many, n, light, view)[:, 0] * np.maximum(light[:, 2], 0)
        total += float(np.mean(value / np.maximum(pdf, 1e-300)))
    return total / angles


def _dot(a: F64, b: F64) -> F64:
    return np.asarray(np.einsum("ij,ij->i", a, b))
