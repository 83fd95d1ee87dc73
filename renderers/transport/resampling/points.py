"""Points of constant density on a World's triangles (Laurent 2018, chapter 5): the CPU twin of `renderers.gl.resample`.

    r_m = A_m / η*        r_m ≤ 1: one point with probability r_m        r_m > 1: cut into parts of ratio ≤ 1, each treated alike
    Σ f(y) η* over the points ≈ ∫ f dA, without bias                     expected number |S| / η*

Nothing is built and nothing but the points is stored. A triangle's decision depends on its vertices' numbers and on its area alone:
while geometry stands still the set is the same, and where a part of it moves only the points of that part change.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from renderers.scene.world import World
from renderers.transport.resampling import kernels
from renderers.transport.resampling.numbers import further, keys
from renderers.transport.resampling.pattern import LARGEST, Rule, pattern
from renderers.transport.threads import chunks, in_threads

U64 = NDArray[np.uint64]
F32 = NDArray[np.float32]
Arrays = tuple[NDArray[np.intp], U64, F32, F32, F32]
TRIANGLES, PATCHES = 1 << 16, 1 << 10
BELOW_ONE = np.nextafter(1.0, 0.0)


@dataclass(frozen=True, eq=False)
class Points:
    """N points in the order of their triangles. triangle int64 (N,); u, v float32 (N,): weights of the second and third corner.

    numbers uint64 (N, 2): 32 bits each, first of the draw, then of the place. chance float32 (N,): probability to be here.
    weight float32 (N,): area over η* that the point stands for; 1, and more only where a triangle couldn't be cut up far enough.
    """

    triangle: NDArray[np.int64]
    u: F32
    v: F32
    numbers: U64
    chance: F32
    weight: F32

    def __len__(self) -> int:
        return len(self.triangle)

    @property
    def level_number(self) -> NDArray[np.float64]:
        """What the draw left over, uniform in [0, 1): number / chance. Levels drawn by it are those of equation 5.12.

        A triangle that grows slides towards the denser levels, one that shrinks towards the sparser ones and then away.
        """
        uniform = (self.numbers[:, 0].astype(np.float64) + 0.5) / 2.0**32
        return np.asarray(np.minimum(uniform / self.chance, BELOW_ONE))

    def further(self, count: int) -> NDArray[np.float64]:
        """More uniform numbers in [0, 1), float64 (N, count), that belong to the point and move with it."""
        return further(self.numbers[:, 0], self.numbers[:, 1], count)

    def sorted(self) -> Points:
        """In the order of triangle, then numbers: the same for every way to draw them."""
        order = np.lexsort([self.numbers[:, 1], self.numbers[:, 0], self.triangle])
        return Points(
            self.triangle[order], self.u[order], self.v[order], self.numbers[order], self.chance[order], self.weight[order]
        )


def progressive_shift(draw: int) -> tuple[int, int]:
    """Shift of the draw-th of a sequence of draws: Sobol' points in (keep; b, c), of which each shifts all numbers alike.

    ⊕ with a constant is a digital shift: each draw by itself stays unbiased, and the error of their mean falls faster than the root
    of their number. Draw 0: none.
    """
    if draw == 0:
        return 0, 0
    keep, b, c = (qmc.Sobol(3, scramble=False, bits=32).fast_forward(draw).random(1)[0] * 2.0**32).astype(np.uint64)
    return int(keep), int((c >> np.uint64(16)) << np.uint64(16) | b >> np.uint64(16))


def resample(
    world: World,
    area: float,
    seed: int = 0,
    shift: tuple[int, int] = (0, 0),
    *,
    rule: Rule = "even",
    carry: bool = True,
    patches: int | None = None,
) -> Points:
    """Points of one per `area` (η*, World units²) on average.

    shift: 32-bit integers ⊕ the points' numbers; with fixed vertices each new pair gives another draw (progressive rendering).
    rule, carry: "printed" and False show what the thesis's rules lose. patches: room for so many; large triangles that don't fit
    get one point each, with all their weight. Raises ValueError unless area > 0.
    """
    if not area > 0:
        raise ValueError(f"the area of one point must be positive, got {area}")
    inverse, own = np.float32(1 / area), keys(seed)
    shifts = (np.uint64(shift[0]), np.uint64(shift[1]))
    positions, triangles = world.positions, world.triangles
    fate = np.empty(len(triangles), np.uint8)

    def decide(part: slice) -> None:
        kernels.decide(positions, triangles, part.start, part.stop, inverse, own[0], shifts[0], fate)

    in_threads(decide, chunks(len(triangles), TRIANGLES))
    large = np.flatnonzero(fate == kernels.LARGE)
    ends = np.cumsum([4 ** kernels.cuts_of(kernels.ratio_of(positions, triangles[t], inverse))[0] for t in large], dtype=np.int64)
    if patches is not None:
        fate[large[ends > patches]] = kernels.KEPT
        large, ends = large[ends <= patches], ends[ends <= patches]
    rows = np.flatnonzero(fate == kernels.KEPT)
    whole = _empty(rows)
    kernels.keep_whole(positions, triangles, rows, inverse, own, shifts, carry, *whole[1:])
    if not len(large):
        return _points(*whole)
    parts = _parts(positions, triangles, large, ends, inverse, own, shifts, rule == "even", carry)
    return _points(*_joined(whole, parts)).sorted()


@cache
def warm_up() -> None:
    """Compile the kernels, or load them from numba's cache; once a process."""
    positions, key = np.eye(3, dtype=np.float32), (np.uint64(0), np.uint64(0))
    triangles, rows, one = np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int64), np.float32(1)
    kernels.decide(positions, triangles, 0, 1, one, key[0], key[0], np.empty(1, np.uint8))
    kernels.keep_whole(positions, triangles, rows, one, key, key, True, *_empty(rows)[1:])
    _parts(positions, triangles, rows, rows + 1, np.float32(8), key, key, True, True)


def _parts(
    positions: F32,
    triangles: NDArray[np.int32],
    rows: NDArray[np.intp],
    ends: NDArray[np.int64],
    inverse: np.float32,
    own: tuple[np.uint64, np.uint64],
    shifts: tuple[np.uint64, np.uint64],
    even: bool,
    carry: bool,
) -> Arrays:
    """Points of the parts of large triangles, whose patches end at `ends`: triangle, numbers, chances, weights, (u, v)."""
    patch, ratios, numbers = np.empty((ends[-1], 4), np.int64), np.empty(ends[-1], np.float32), np.empty((ends[-1], 2), np.uint64)
    starts = np.concatenate([[0], ends[:-1]])
    kernels.patches(positions, triangles, rows, inverse, own, even, starts, patch, ratios, numbers)
    used = set(np.unique(patch[:, 3]).tolist())
    tables = [pattern(n) if n in used else np.zeros((0, 3, 2), np.int64) for n in range(LARGEST + 1)]
    offsets, lattice = np.concatenate([[0], np.cumsum([len(t) for t in tables])]), np.concatenate(tables)
    counts = np.empty(len(patch), np.int64)

    def count(part: slice) -> None:
        kernels.count_parts(patch, ratios, numbers, part.start, part.stop, offsets, lattice, shifts[0], counts)

    in_threads(count, chunks(len(patch), PATCHES))
    found = _empty(np.repeat(patch[:, 0], counts))
    first = np.cumsum(counts) - counts

    def keep(part: slice) -> None:
        kernels.keep_parts(patch, ratios, numbers, part.start, part.stop, offsets, lattice, shifts, carry, first, *found[1:])

    in_threads(keep, chunks(len(patch), PATCHES))
    return found


def _empty(triangle: NDArray[np.intp]) -> Arrays:
    count = len(triangle)
    return (
        triangle, np.empty((count, 2), np.uint64),
        np.empty(count, np.float32), np.empty(count, np.float32), np.empty((count, 2), np.float32),
    )  # fmt: skip


def _joined(a: Arrays, b: Arrays) -> Arrays:
    return (
        np.concatenate([a[0], b[0]]), np.concatenate([a[1], b[1]]), np.concatenate([a[2], b[2]]),
        np.concatenate([a[3], b[3]]), np.concatenate([a[4], b[4]]),
    )  # fmt: skip


def _points(triangle: NDArray[np.intp], numbers: U64, chance: F32, weight: F32, where: F32) -> Points:
    return Points(triangle.astype(np.int64), where[:, 0], where[:, 1], numbers, chance, weight)
