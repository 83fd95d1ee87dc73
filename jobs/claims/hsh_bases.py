"""Figures 3.9 to 3.11 of Gautron 2006: how much of a BRDF's lobe coefficients in several bases hold, and how the lobes ring.

The figures are curves without numbers. What the text says of them is compared, over all angles of the viewer and all numbers of
coefficients here; the publication names neither the angles nor, for figure 3.11, the exponent. Everything is quadrature, without a
renderer or random numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jobs.claims.bench import Bench
from jobs.claims.model import Measurement, PublishedClaim, Row, held, row
from jobs.claims.registry import register

if TYPE_CHECKING:
    from renderers.transport.hemispherical.comparison import Basis
    from renderers.transport.hemispherical.models import Brdf

F64 = NDArray[np.float64]
ORDERS, ANGLES = (2, 3, 4, 5, 7, 10), (0, 30, 45, 60, 75)
SHOWN_ORDERS, SHOWN_ANGLES = (3, 5, 7, 10), (0, 30, 60)
WORDS: dict[Basis, str] = {"hemispherical": "hemispherical harmonics", "spherical": "spherical harmonics", "even": "even ones",
                           "zernike": "Zernike functions"}  # fmt: skip
NEAR = 30
MU_NODES, PHI_NODES = 200, 400  # Ward without cosine is singular at the horizon and converges slowly
RINGING_ORDER, RINGING_ANGLES = 7, (0, 15, 30)
COMPARABLE = 0.05  # "comparable" in the text, as a difference of shares


def shares(brdf: Brdf, basis: Basis, angles: Sequence[float] = ANGLES) -> F64:
    """Share of a lobe's energy that n² coefficients hold, (angles, ORDERS), without cosine, viewer at angles in degrees."""
    from renderers.transport.hemispherical.comparison import orthonormal_values
    from renderers.transport.hemispherical.quadrature import hemisphere_quadrature

    directions, weights = hemisphere_quadrature(MU_NODES, PHI_NODES)
    lobes = np.stack([brdf(directions, view) for view in views_at(angles)])
    coefficients = (lobes * weights) @ orthonormal_values(basis, directions, max(ORDERS) ** 2)
    held_by = np.cumsum(coefficients**2, axis=1)[:, np.array(ORDERS) ** 2 - 1]
    return np.asarray(held_by / (lobes**2 @ weights)[:, None])


def views_at(angles: Sequence[float]) -> F64:
    """Directions in the xz plane at angles in degrees from the normal, (N, 3)."""
    theta = np.radians(angles)
    return np.stack([np.sin(theta), np.zeros(len(theta)), np.cos(theta)], axis=1)


def shown(found: dict[Basis, F64]) -> list[Row]:
    """Rows of some of the shares."""
    return [
        row(f"{basis}.n{n}.{angle}deg", f"share held by {n * n} coefficients, {WORDS[basis]}, {angle}°", "of the energy", None,
            [float(values[ANGLES.index(angle), ORDERS.index(n)])])
        for basis, values in found.items() for n in SHOWN_ORDERS for angle in SHOWN_ANGLES
    ]  # fmt: skip


def phong_lobe(bench: Bench) -> Measurement:
    """Figure 3.9: Phong, exponent 5."""
    from renderers.transport.hemispherical.models import phong

    bench.report("Phong, exponent 5")
    found = {basis: shares(phong(5.0), basis) for basis in WORDS}
    ours = found["hemispherical"]
    rows = shown(found)
    for basis in ("spherical", "even", "zernike"):
        better = ours >= found[basis] - 1e-9
        rows.append(
            held(f"beats.{basis}", f"hemispherical harmonics hold at least as much as {WORDS[basis]}", better.ravel().tolist())
        )
        near = better[np.array(ANGLES) <= NEAR]
        rows.append(held(f"beats.{basis}.near", f"the same, viewer at {NEAR}° at most", near.ravel().tolist(), comparable=False))
    notes = [f"exponent 5 as published, {ORDERS} squared coefficients, viewer at {ANGLES} degrees; all published words count alike"]
    return Measurement("one lobe, no scene", rows, notes)


def ward_lobe(bench: Bench) -> Measurement:
    """Figure 3.10: anisotropic Ward, α = 0.2, 0.5."""
    from renderers.transport.hemispherical.models import ward

    bench.report("Ward, 0.2 and 0.5")
    found = {basis: shares(ward(0.2, 0.5), basis) for basis in WORDS}
    ours = found["hemispherical"]
    rows = [
        *shown(found),
        held("beats.spherical", "hemispherical harmonics hold at least as much as spherical ones",
             (ours >= found["spherical"]).ravel().tolist()),
        held("even_is_best", "even spherical harmonics hold most",
             [bool(found["even"][i, j] >= max(v[i, j] for v in found.values())) for i, j in np.ndindex(*ours.shape)]),
        held("zernike_alike", f"hemispherical harmonics and Zernike functions hold the same within {COMPARABLE}",
             (np.abs(ours - found["zernike"]) <= COMPARABLE).ravel().tolist()),
    ]  # fmt: skip
    return Measurement("one lobe, no scene", rows, [f"α = 0.2, 0.5 as published, viewer at {ANGLES} degrees along x"])


def ringing(bench: Bench) -> Measurement:
    """Figure 3.11: lobes of order 7 seen as they are, hemispherical against spherical harmonics."""
    from renderers.transport.hemispherical.basis import hemispherical_harmonics, spherical_harmonics
    from renderers.transport.hemispherical.models import phong, ward
    from renderers.transport.hemispherical.quadrature import hemisphere_quadrature

    quadrature = hemisphere_quadrature(MU_NODES, PHI_NODES)
    bases = {"hemispherical": hemispherical_harmonics, "spherical": spherical_harmonics}
    under: dict[str, list[float]] = {name: [] for name in bases}
    error: dict[str, list[float]] = {name: [] for name in bases}
    for brdf in (phong(15.0), phong(20.0), ward(0.2, 0.5)):
        for view in views_at(RINGING_ANGLES):
            bench.report("ringing")
            lobe = brdf(quadrature.directions, view)
            for name, basis in bases.items():
                values = basis(quadrature.directions, RINGING_ORDER)
                back = values @ (values.T @ (lobe * quadrature.weights))
                under[name].append(100 * float(max(0.0, -back.min()) / lobe.max()))
                error[name].append(float(np.sqrt(((back - lobe) ** 2 @ quadrature.weights) / (lobe**2 @ quadrature.weights))))
    rows = [row(f"{name}.undershoot", f"depth of the rings, {WORDS[name]}", "% of the peak", None, under[name], "lower")  # type: ignore[index]
            for name in bases]  # fmt: skip
    rows += [row(f"{name}.error", f"relative L² error on the hemisphere, {WORDS[name]}", "1", None, error[name], "lower")  # type: ignore[index]
             for name in bases]  # fmt: skip
    for quantity, found in (("rings less deep", under), ("error smaller", error)):
        outcomes = [a <= b for a, b in zip(found["hemispherical"], found["spherical"], strict=True)]
        rows.append(held(quantity.replace(" ", "_"), f"{quantity} than those of spherical harmonics", outcomes))
    notes = [f"order {RINGING_ORDER}; Phong of exponents 15 and 20 and Ward 0.2, 0.5, viewer at {RINGING_ANGLES} degrees: the "
             "publication's exponent isn't printed, and a lobe of exponent 5 doesn't ring in either basis"]  # fmt: skip
    return Measurement("lobes, no scene", rows, notes)


register(PublishedClaim("hsh-figure-3.9", "A Phong lobe in bases of the hemisphere", "Gautron 2006 figure 3.9", phong_lobe))
register(PublishedClaim("hsh-figure-3.10", "An anisotropic lobe in bases of the hemisphere", "Gautron 2006 figure 3.10", ward_lobe))
register(PublishedClaim("hsh-figure-3.11", "Ringing of lobes of order 7", "Gautron 2006 figure 3.11", ringing))
