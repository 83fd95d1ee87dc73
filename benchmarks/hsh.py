"""Speed of the hemispherical harmonics, in millions or thousands a second: `python -m benchmarks.hsh`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.shared.clock import best_of
from renderers.transport.hemispherical.basis import directions_of, hemispherical_harmonics, spherical_harmonics
from renderers.transport.hemispherical.brdf_table import brdf_table
from renderers.transport.hemispherical.conversion import to_hemispherical
from renderers.transport.hemispherical.environment import incoming
from renderers.transport.hemispherical.models import phong
from renderers.transport.hemispherical.rotation import rotate

REPEATS = 5
ORDERS = (5, 10, 20)


def seconds(function: Callable[[], object]) -> float:
    """Best wall-clock time of a few calls, after one to warm up."""
    function()
    return best_of(function, REPEATS)


def main() -> None:
    """Print one line for each operation."""
    rng = np.random.default_rng(0)
    count = 1 << 15
    directions = directions_of(rng.random(count), 2 * np.pi * rng.random(count))
    for order in ORDERS:
        values = count * order**2 / 1e6
        for kind in (np.float64, np.float32):
            typed = directions.astype(kind)
            rates = [
                values / seconds(lambda f=f, d=typed, n=order: f(d, n)) for f in (hemispherical_harmonics, spherical_harmonics)
            ]
            print(f"order {order:2d} {kind.__name__}: {rates[0]:7.0f} M values/s hemispherical, {rates[1]:7.0f} spherical")
    rotations = Rotation.from_euler("ZYZ", rng.uniform([-3, 0.1, -3], [3, 1.5, 3], (256, 3))).as_matrix()
    for order in ORDERS[:2]:
        coefficients = rng.standard_normal((256, order**2, 3))
        for method in ("precomputed", "spherical", "analytic"):
            rate = 256 / seconds(lambda m=method, c=coefficients: rotate(c, rotations, m))
            print(f"order {order:2d} rotation, RGB, {method:12s}: {rate / 1e3:7.2f} k/s")
        spherical = rng.standard_normal((order**2, 3))
        rate = 256 / seconds(lambda s=spherical, n=order: incoming(s, rotations, n))
        whole = rng.standard_normal((256, 3, order**2))
        share = seconds(lambda w=whole, n=order: to_hemispherical(w, n)) / 256 * rate
        print(f"order {order:2d} environment to the frame of a point: {rate / 1e3:7.2f} k/s, conversion {share:.0%} of it")
        table = brdf_table(phong(15), order, 32)
        rate = count / seconds(lambda t=table: t.lookup(directions))
        print(f"order {order:2d} look-ups in a BRDF table of 32x32: {rate / 1e6:7.2f} M/s")


if __name__ == "__main__":
    main()
