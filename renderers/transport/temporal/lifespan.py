"""How long a record may be used: as long as its light, changing at the rate foreseen, changes by at most a_t.

    w_t(t) = 1 / (|τ - 1| (t - t_k)),   k may contribute  ⟺  w_t ≥ 1/a_t  and  t - t_k < δ_max            Gautron 2006, 5.5 to 5.7
    life   = min(δ_max, ⌊a_t / |τ - 1|⌋ + 1)                                                  frames, that of the record included

The modulus is missing in the printed weight: without it a record whose light fades is never used again.

    |τ - 1| = max_c |E_1c - E_0c| / max(max_c E_0c, E_min)                                    of irradiance, c: colour channels
    |τ - 1| = max( max_{i ∈ I} |λ_1i/λ_0i - 1|, ‖λ_1 - λ_0‖ / ‖λ_0‖ ),  I = {i: |λ_0i| ≥ 10⁻² ‖λ_0‖}           of coefficients λ

The printed max_i λ_1i/λ_0i takes one unchanged coefficient for a static scene and a tiny one that grows for a great change. By
default the norms alone decide: they are the relative change of the radiance function, of which a single coefficient is a small
part. In a glossy box with a turning cube the maximum over coefficients makes three times as many records for the same error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.transport.caching.records import Float, Records

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
TIE = 1e-9  # relative: exact ties count as admitted, as "≥" demands, whatever the rounding of their quotient
NOTABLE = 1e-2
DARK = 1e-4
FOREVER = 1 << 40


def irradiance_rate(now: Float, next_: Float, least: float) -> F64:
    """|τ - 1| per frame, (K,), of irradiances (K, 3) now and one frame later; least: E_min > 0, see `darkness`."""
    change = np.abs(next_ - now).max(axis=1)
    return np.asarray(change / np.maximum(now.max(axis=1), least))


def radiance_rate(now: Float, next_: Float, least: float) -> F64:
    """|τ - 1| per frame, (K,), of coefficients (K, n) now and one frame later; least > 0: floor of ‖λ_0‖."""
    norm, whole = np.linalg.norm(now, axis=1), norm_rate(now, next_, least)
    notable = (np.abs(now) >= NOTABLE * norm[:, None]) & (np.abs(now) > NOTABLE * least)
    single = np.where(notable, np.abs(next_ - now) / np.where(notable, np.abs(now), 1), 0)
    return np.asarray(np.maximum(single.max(axis=1, initial=0.0), whole))


def darkness(irradiance: Float) -> float:
    """E_min for irradiances (K, 3): so much less than their mean that nobody sees it; a positive number even in the dark."""
    mean = float(irradiance.mean()) if irradiance.size else 0.0
    return DARK * mean if mean > 0 else 1e-30


def norm_rate(now: Float, next_: Float, least: float) -> F64:
    """The second part of `radiance_rate`, (K,): the relative change of the radiance function, whose basis is orthonormal."""
    return np.asarray(np.linalg.norm(next_ - now, axis=1) / np.maximum(np.linalg.norm(now, axis=1), least))


def change_rate(now: Records, later: Records, least: float, together: bool = False) -> F64:
    """|τ - 1| per frame, (K,), of records now and one frame later: of their coefficients, where they carry radiance.

    least: see `dark_level`. Coefficients of all channels count as those of one function, so that its brightest channel decides;
    together: by the relative change of that function alone (its norm), not of any single coefficient.
    """
    if now.coefficients is None or later.coefficients is None:
        return irradiance_rate(now.irradiance, later.irradiance, least)
    count = len(now)
    first, last = now.coefficients.reshape(count, -1), later.coefficients.reshape(count, -1)
    return norm_rate(first, last, least) if together else radiance_rate(first, last, least)


def dark_level(records: Records) -> float:
    """The floor of `change_rate` for records: `darkness` of irradiance, or of the norms of coefficients."""
    if records.coefficients is None:
        return darkness(records.irradiance)
    return darkness(np.linalg.norm(records.coefficients, axis=(1, 2))[:, None])


def lifespan(rate: F64, a_t: float, longest: int) -> I64:
    """Frames (K,), at least 1, for rates (K,) ≥ 0 and a_t > 0, δ_max = longest ≥ 1."""
    frames = np.where(rate > 0, a_t / np.where(rate > 0, rate, 1) * (1 + TIE), np.inf)
    return np.asarray(np.minimum(np.floor(np.minimum(frames, longest)) + 1, longest), np.int64)


def staggered(life: I64, number: I64, longest: int) -> I64:
    """Lifespans of first records of places, cut so that those made together don't expire together: (K,) at place numbers (K,).

    The cut lengths are a golden-ratio sequence over 1 … δ_max: any run of successive places is spread evenly. Only first records
    are cut, so that the price is half a lifespan a place, once.
    """
    phase = np.modf((number + 1) * 0.6180339887498949)[0]
    return np.asarray(np.minimum(life, 1 + (phase * longest).astype(np.int64)))
