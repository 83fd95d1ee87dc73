"""Importance sampling of BRDFs: a cosine lobe and a specular lobe, each taken with probability one half where both exist.

    Phong   (n+1)/(2π) cosⁿ about the mirror direction                       (Lafortune & Willems 1994)
    GGX     visible normals, then mirrored: pdf = G1(v) D / (4 n·v)          (Heitz 2018)

Sampled directions may fall below the horizon: their f is 0 and the estimator stays unbiased. Pdfs integrate to 1 over the sphere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import GGX_KIND, LAMBERT, PHONG
from renderers.transport.brdf import Materials
from renderers.transport.sampling import cosine_hemisphere, frame

F64 = NDArray[np.float64]


def sample_brdf(m: Materials, n: F64, view: F64, random: F64) -> F64:
    """Unit directions to the light, float64 (N, 3); n, view unit (N, 3), random (N, 3) in [0, 1): lobe choice and direction."""
    direction = cosine_hemisphere(n, random[:, 1:])
    choose = random[:, 0] >= cosine_share(m)
    rows = np.flatnonzero(choose & (m.kind == PHONG))
    if len(rows):
        direction[rows] = _phong_sample(m.exponent[rows], n[rows], view[rows], random[rows, 1:])
    rows = np.flatnonzero(choose & (m.kind == GGX_KIND))
    if len(rows):
        direction[rows] = _ggx_sample(m.alpha[rows], n[rows], view[rows], random[rows, 1:])
    return direction


def sampling_pdf(m: Materials, n: F64, view: F64, light: F64) -> F64:
    """Density of `sample_brdf` per steradian, float64 (N,)."""
    share = cosine_share(m)
    nl, nv = _dot(n, light), _dot(n, view)
    pdf = share * np.maximum(nl, 0) / np.pi
    rows = np.flatnonzero((share < 1) & (m.kind == PHONG))
    if len(rows):
        mirror = 2 * nv[rows, None] * n[rows] - view[rows]
        k = m.exponent[rows]
        pdf[rows] += (1 - share[rows]) * (k + 1) / (2 * np.pi) * np.maximum(_dot(mirror, light[rows]), 0) ** k
    rows = np.flatnonzero((share < 1) & (m.kind == GGX_KIND) & (nv > 0))
    if len(rows):
        pdf[rows] += (1 - share[rows]) * _ggx_pdf(m.alpha[rows], n[rows], view[rows], light[rows], nv[rows])
    return pdf


def cosine_share(m: Materials) -> F64:
    """Probability of the cosine lobe, (N,): 1 for Lambert, 0 for pure metals and black-based Phong, else one half."""
    diffuse = np.where(m.kind == GGX_KIND, m.metallic < 1, m.base.any(axis=1))
    glossy = np.where(m.kind == PHONG, m.specular.any(axis=1), m.kind == GGX_KIND)
    return np.where(m.kind == LAMBERT, 1.0, np.where(glossy, np.where(diffuse, 0.5, 0.0), 1.0))


def _phong_sample(exponent: F64, n: F64, view: F64, random: F64) -> F64:
    mirror = 2 * _dot(n, view)[:, None] * n - view
    cos = (1 - random[:, 0]) ** (1 / (exponent + 1))
    sin, phi = np.sqrt(np.maximum(0, 1 - cos * cos)), 2 * np.pi * random[:, 1]
    s, t = frame(mirror)
    return np.asarray((sin * np.cos(phi))[:, None] * s + (sin * np.sin(phi))[:, None] * t + cos[:, None] * mirror)


def _ggx_sample(alpha: F64, n: F64, view: F64, random: F64) -> F64:
    s, t = frame(n)
    local = np.stack([alpha * _dot(s, view), alpha * _dot(t, view), _dot(n, view)], axis=1)
    local /= np.linalg.norm(local, axis=1, keepdims=True)
    r, phi = np.sqrt(random[:, 0]), 2 * np.pi * random[:, 1]
    # The visible half disc is foreshortened along t2, so t1 must be horizontal; any horizontal axis does for a vertical view.
    flat = np.hypot(local[:, 0], local[:, 1])
    level = np.stack([-local[:, 1], local[:, 0], 0 * flat], axis=1) / np.maximum(flat, 1e-12)[:, None]
    t1 = np.where((flat > 1e-12)[:, None], level, [1.0, 0.0, 0.0])
    t2 = np.cross(local, t1)
    p1, p2 = r * np.cos(phi), r * np.sin(phi)
    mix = 0.5 * (1 + local[:, 2])
    p2 = (1 - mix) * np.sqrt(np.maximum(0, 1 - p1 * p1)) + mix * p2
    p3 = np.sqrt(np.maximum(0, 1 - p1 * p1 - p2 * p2))
    h = p1[:, None] * t1 + p2[:, None] * t2 + p3[:, None] * local
    h = np.stack([alpha * h[:, 0], alpha * h[:, 1], np.maximum(1e-12, h[:, 2])], axis=1)
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    half = h[:, :1] * s + h[:, 1:2] * t + h[:, 2:] * n
    return np.asarray(2 * _dot(view, half)[:, None] * half - view)


def _ggx_pdf(alpha: F64, n: F64, view: F64, light: F64, nv: F64) -> F64:
    half = light + view
    length = np.linalg.norm(half, axis=1)
    half /= np.maximum(length, 1e-12)[:, None]
    nh, cross, a2 = _dot(n, half), np.cross(n, half), alpha * alpha
    d = a2 / (np.pi * (nh * nh * a2 + _dot(cross, cross)) ** 2)
    g1 = 2 * nv / (nv + np.sqrt(nv * nv * (1 - a2) + a2))
    return np.where((length > 1e-12) & (nh > 0), g1 * d / (4 * nv), 0.0)


def _dot(a: F64, b: F64) -> F64:
    return np.asarray(np.einsum("ij,ij->i", a, b))
