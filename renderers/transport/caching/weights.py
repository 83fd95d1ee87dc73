"""How much a record says about a point: Ward's error bound, weights made of it, and the zone where they count.

    e_k(p, n) = |p - p_k| / R_k + √(1 - n·n_k),     k contributes  ⟺  e_k ≤ a                        Gautron 2006, equation 2.8

√(1 - n·n_k) is computed as |n - n_k| / √2: for unit vectors the same, but exactly 0 for equal normals in float32 too, where the
printed form is NaN for one pair in five. The zone lies inside the sphere of radius a·R_k, since the second term is ≥ 0.

| weight | w(e) | |
| --- | --- | --- |
| ward | 1 / max(e, 10⁻³) | the published one |
| shifted | 1 / max(e, 10⁻³) - 1/a | 0 on the rim of the zone |
| tent | 1 - max(distance term, normal term) / a | Tabellion & Lamorlette 2004; 0 on the rim of its own zone, max ≤ a |
"""

from __future__ import annotations

from typing import Literal

import numba
import numpy as np

Weight = Literal["ward", "shifted", "tent"]
WEIGHTS: dict[Weight, int] = {"ward": 0, "shifted": 1, "tent": 2}
SHIFTED, TENT = 1, 2
CAP = 1e-3
RIM = 1e-6  # a point on the rim still gets a positive weight, so that "no weight" always means "no record"
LARGEST_ACCURACY = float(np.sqrt(2))


def checked_accuracy(a: float) -> float:
    """The accuracy. Raises ValueError unless 0 < a < √2: from √2 on, opposite faces of a thin wall would share records."""
    if not 0 < a < LARGEST_ACCURACY:
        raise ValueError(f"the accuracy must lie in (0, √2), got {a}")
    return a


@numba.njit(cache=True)
def weight(kind: int, distance: float, bend: float, a: float) -> float:
    """w of a point at distance / R and normal term `bend`, 0 outside of the zone; kind as in WEIGHTS; callable from kernels."""
    e = distance + bend
    if kind == TENT:
        return max(1 - max(distance, bend) / a, RIM) if max(distance, bend) <= a else 0.0
    if e > a:
        return 0.0
    ward = 1 / max(e, CAP)
    return max(ward - 1 / a, RIM) if kind == SHIFTED else ward
