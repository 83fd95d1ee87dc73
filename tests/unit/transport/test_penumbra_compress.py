"""Compression: worked examples, and the bound as a property of any step function."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from renderers.transport.penumbra.compress import NONE, PERPENDICULAR, VERTICAL, compress
from renderers.transport.penumbra.lookup import value_at


def steps(z: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Step form of changes at z to the values v."""
    return np.repeat(z, 2).astype(float), np.stack([np.concatenate([[0.0], v[:-1]]), v], axis=1).ravel()


def compressed(z: np.ndarray, v: np.ndarray, method: int, epsilon: float, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    out_z, out_v = np.empty(len(z) + 2), np.empty(len(z) + 2)
    n = compress(z, v, len(z), method, epsilon, scale, out_z, out_v)
    return out_z[:n], out_v[:n]


def limits(z: np.ndarray, v: np.ndarray, where: float) -> tuple[float, float]:
    """Left and right limit at `where` of a polyline with vertical parts, 0 before its first vertex."""
    left = value_at(z, v, 0, len(z), where)
    after = np.searchsorted(z, where, side="right")
    if after == 0:
        return left, 0.0
    if after == len(z) or z[after - 1] == where:
        return left, float(v[after - 1])
    return left, left


def test_worked_examples() -> None:
    """Five events, and 64 entries followed by 64 exits."""
    z, v = steps(np.array([4, 5, 6, 7, 8.0]), np.array([0.01, 0.02, 0.03, 0.5, 0.51]))
    for epsilon, expected in (
        (0.02, [(4, 0), (7, 0.0325), (7, 0.5), (8, 0.505)]),
        (0.05, [(4, 0), (7, 0.04), (7, 0.5), (8, 0.505)]),
    ):
        np.testing.assert_allclose(np.stack(compressed(z, v, VERTICAL, epsilon), axis=1), expected, atol=1e-12)
    k = np.arange(1, 65)
    z, v = steps(np.concatenate([5 + (k - 1) / 64, 8 + (k - 1) / 64]), np.concatenate([k / 64, 1 - k / 64]))
    few = np.stack(compressed(z, v, VERTICAL, 0.02), axis=1)
    expected = [(5, 0), (5.984375, 0.99), (8.03125, 0.9843), (8.03125, 0.9531), (8.984375, 0.01)]
    np.testing.assert_allclose(few, expected, atol=5e-4)
    assert len(compressed(z, v, VERTICAL, 0.005)[0]) >= 255


def test_a_lone_jump_is_one_vertex() -> None:
    """0 before the first vertex is implied."""
    for method in (NONE, VERTICAL):
        z, v = compressed(*steps(np.array([10.02]), np.array([1.0])), method, 0.02)
        assert (z.tolist(), v.tolist()) == ([10.02], [1.0])


# depths as float32 gives them between 1 and 17: differences under 2⁻²⁰ don't occur
FUNCTIONS = st.integers(1, 64).flatmap(
    lambda n: st.lists(
        st.tuples(st.integers(0, 2**24).map(lambda k: 1 + k / 2**20), st.integers(0, n)),
        min_size=1,
        max_size=40,
        unique_by=lambda change: change[0],
    ).map(lambda changes: (np.array(sorted(c[0] for c in changes)), np.array([c[1] for c in changes]) / n))
)


@given(FUNCTIONS, st.sampled_from([0.005, 0.02, 0.05, 0.1]))
@settings(max_examples=300, deadline=None)
def test_vertical_bound(function: tuple[np.ndarray, np.ndarray], epsilon: float) -> None:
    """A9, A10: |V' - V| ≤ ε from both sides of every change, and V' within [0, 1] without clamping vertices."""
    z, v = steps(*function)
    cz, cv = compressed(z, v, VERTICAL, epsilon)
    assert cv.min() >= -1e-12
    assert cv.max() <= 1 + 1e-12
    for where in np.unique(np.concatenate([z, cz])):
        for ours, theirs in zip(limits(cz, cv, where), limits(z, v, where), strict=True):
            assert abs(ours - theirs) <= epsilon * (1 + 1e-6) + 1e-9


@given(FUNCTIONS, st.sampled_from([0.02, 0.1]), st.sampled_from([1.0, 10.0]))
@settings(max_examples=200, deadline=None)
def test_perpendicular_bound(function: tuple[np.ndarray, np.ndarray], epsilon: float, kappa: float) -> None:
    """A11: every input vertex within ε of the polyline in the scaled plane; a dropped leading vertex counts as (z, 0)."""
    z, v = steps(*function)
    cz, cv = compressed(z, v, PERPENDICULAR, epsilon, kappa)
    line = np.stack([np.concatenate([z[:1], cz]) * kappa, np.concatenate([[0.0], cv])], axis=1)
    start, way = line[:-1], np.diff(line, axis=0)
    length2 = np.maximum((way**2).sum(1), 1e-30)
    for x, y in zip(z * kappa, v, strict=True):
        t = np.clip((([x, y] - start) * way).sum(1) / length2, 0, 1)
        assert np.hypot(*([x, y] - start - t[:, None] * way).T).min() <= epsilon * (1 + 1e-6) + 1e-9
    assert cv.min() >= 0
    assert cv.max() <= 1


@pytest.mark.parametrize("method", [NONE, VERTICAL, PERPENDICULAR])
def test_nothing_stays_nothing(method: int) -> None:
    """A pixel without events has no vertices."""
    assert len(compressed(np.zeros(0), np.zeros(0), method, 0.02)[0]) == 0
