"""Products and sums that are rounded where they say, in every kernel."""

from __future__ import annotations

import ast
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

from renderers.transport.fused import LANES, dot, fma

RENDERERS = Path(__file__).parents[3] / "renderers"
FUNCTIONS = [
    (path.relative_to(RENDERERS).as_posix(), node)
    for path in sorted(RENDERERS.rglob("*.py"))
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    if isinstance(node, ast.FunctionDef)
]
PARALLEL = [(path, node) for path, node in FUNCTIONS if any("parallel=True" in ast.unparse(d) for d in node.decorator_list)]


@numba.njit
def _fma(a, b, c):  # type: ignore[no-untyped-def]
    return fma(a, b, c)


@numba.njit
def _dot(a, b):  # type: ignore[no-untyped-def]
    return dot(a, b)


def once(value: np.ndarray) -> np.ndarray:
    """A float64 rounded to float32: of a product and sum of float32, whose rounding to 53 bits doesn't matter to 24."""
    return np.asarray(value, np.float32)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_fma_rounds_once(kind: type[np.floating]) -> None:
    """(1 + ε)² - fl((1 + ε)²) is ε², all that a product rounded by itself has lost."""
    one = kind(1) + np.finfo(kind).eps
    assert _fma(one, one, -one * one) == np.finfo(kind).eps ** 2


@pytest.mark.parametrize("count", [0, 1, 4, 9, 16, 25, 49, 64, 100, 256])
def test_dot_adds_in_the_order_it_says(count: int) -> None:
    rng = np.random.default_rng(count)
    a, b = rng.normal(size=(2, count)).astype(np.float32)
    wide = a.astype(np.float64) * b
    whole = count // LANES * LANES
    lanes = np.zeros(LANES, np.float32)
    for start in range(0, whole, LANES):
        lanes = once(wide[start : start + LANES] + lanes)
    while len(lanes) > 1:
        lanes = lanes[: len(lanes) // 2] + lanes[len(lanes) // 2 :]
    total = lanes[0]
    for product in wide[whole:]:
        total = np.float32(product + total)
    assert _dot(a, b) == total
    assert abs(total - wide.sum()) <= 1e-6 * np.abs(wide).sum()


def test_mixed_types_do_not_compile() -> None:
    with pytest.raises(TypingError, match="fma takes three"):
        _fma(np.float32(1), 1.0, np.float32(1))
    with pytest.raises(TypingError, match="dot takes two"):
        _dot(np.zeros((4, 2), np.float32)[:, 0], np.zeros(4, np.float32))


def test_no_kernel_leaves_the_order_of_a_sum_to_the_compiler() -> None:
    """`fastmath`, in a decorator or a call of one, for which kernels just compiled and kernels from the cache may differ."""
    sources = [path for path in RENDERERS.rglob("*.py") if "fastmath=" in path.read_text(encoding="utf-8")]
    assert sources == []


@pytest.mark.parametrize(("path", "kernel"), PARALLEL, ids=[f"{path}:{node.name}" for path, node in PARALLEL])
def test_no_parallel_loop_carries_a_number(path: str, kernel: ast.FunctionDef) -> None:
    """A number from before the loop that its iterations change would be summed thread by thread: its rounding would count them."""
    loops = [n for n in ast.walk(kernel) if isinstance(n, ast.For) and "prange" in ast.unparse(n.iter)]
    assert loops
    for loop in loops:
        before = {
            n.id for n in ast.walk(kernel) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store) and n.lineno < loop.lineno
        }
        inside = {n.id for n in ast.walk(loop) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        assert not before & inside, path
