"""Figure 4.7 of Laurent 2018: C⁰ support functions against C⁻¹ ones; 64K virtual lights, five levels, no indirect shadows.

Both families use the same positions, shares and areas. Contours show where the image over that of instant radiosity with the same
virtual lights changes between neighbouring pixels of one plane. The figure names neither its scene nor a_1 and q_a.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jobs.claims.bench import Bench
from jobs.claims.model import Measurement, PublishedClaim, Row, held, row
from jobs.claims.registry import register
from jobs.scenes import NamedScene

SCENES = ("empty-room", "colonnade", "cornell-box")
SIZE = (320, 180)
SEEDS = 6
FAMILIES = {"c0": "C⁰", "c-1": "C⁻¹"}
# R_5 = R_1 · q_a² spans the scene
LEVELS: dict[str, Any] = {"levels": 5, "reach": 0.25, "q_a": 2.0, "q_n": 2.0, "vpls": 65536}
COMMON: dict[str, Any] = {"visibility": "none", "sampler": "uniform"}
DIM = 0.05
PLANE = 1e-4


def measure(bench: Bench) -> Measurement:
    """Contours and cost of both families in every scene."""
    rows = [r for text in SCENES for r in rows_of(bench, bench.open(text))]
    notes = (
        "the figure names neither its scene nor a_1 and q_a: built-in scenes, R_1 = 0.25 scene radii, q_a = q_N = 2, so that five "
        "levels span the scene",
        "contour: mean absolute difference of neighbouring pixels of one plane in the image over that of ir with the same lights",
        "the text says that both cost the same; in pixels touched C⁻¹ is cheaper, as its supports are narrower",
    )
    return Measurement(f"{', '.join(SCENES)} (built-in) in place of the figure's scene", rows, notes)


def rows_of(bench: Bench, scene: NamedScene) -> list[Row]:
    """Figures of one scene over SEEDS seeds."""
    pairs = plane_neighbours(scene)
    contours: dict[str, list[float]] = {family: [] for family in FAMILIES}
    touched: dict[str, list[int]] = {family: [] for family in FAMILIES}
    for seed in range(SEEDS):
        whole = bench.render(scene, "ir", size=SIZE, seed=seed, vpls=LEVELS["vpls"], **COMMON).layers["indirect"]
        for family in FAMILIES:
            frame = bench.render(scene, "flc", size=SIZE, seed=seed, family=family, **LEVELS, **COMMON)
            contours[family].append(contour(frame.layers["indirect"], whole, pairs))
            touched[family].append(frame.counters["pixels_touched"])
    smoother = [a < b for a, b in zip(contours["c0"], contours["c-1"], strict=True)]
    ratio = [b / a for a, b in zip(touched["c0"], touched["c-1"], strict=True)]
    name = scene.name
    return [
        *(row(f"{name}.{f}.contour", f"contour of {FAMILIES[f]}", "1", None, contours[f]) for f in FAMILIES),
        held(f"{name}.c0_smoother", "C⁰ has less contour than C⁻¹", smoother),
        row(f"{name}.pixels_ratio", "pixels touched by C⁻¹ over those by C⁰", "1", 1.0, ratio, "equal", within=0.05),
    ]


def plane_neighbours(scene: NamedScene) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Flat indices of neighbouring pixels that see one plane, first and second (P,)."""
    from renderers.transport.primary import cast_gbuffer

    world = scene.scene.world()
    gbuffer = cast_gbuffer(world, SIZE)
    index = np.arange(gbuffer.triangle.size).reshape(gbuffer.triangle.shape)
    first = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    second = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    triangle, position = gbuffer.triangle.ravel(), gbuffer.position.reshape(-1, 3)
    normal = world.face_normals[triangle]
    apart = np.abs(np.einsum("ij,ij->i", normal[first], position[second] - position[first]))
    aligned = np.abs(np.einsum("ij,ij->i", normal[first], normal[second])) > 1 - PLANE
    one = (triangle[first] >= 0) & (triangle[second] >= 0) & aligned & (apart < PLANE)
    return first[one], second[one]


def contour(image: NDArray[np.float32], whole: NDArray[np.float32], pairs: tuple[NDArray[np.intp], NDArray[np.intp]]) -> float:
    """Mean |a/A - b/B| of neighbouring pixels a, b of an image and A, B of the whole sum, where both are brighter than DIM."""
    from renderers.images import luminance

    light, full = luminance(image).ravel(), luminance(whole).ravel()
    bright = full > DIM * full.mean()
    ratio = np.where(bright, light / np.where(bright, full, 1), 0)
    first, second = pairs
    both = bright[first] & bright[second]
    return float(np.abs(ratio[first] - ratio[second])[both].mean())


register(PublishedClaim("flc-fig-4.7", "Contours of C⁻¹ support functions and of C⁰ ones", "Laurent 2018 Figure 4.7", measure))
