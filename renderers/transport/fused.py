"""Products and sums for numba kernels whose bytes shall not depend on the compiler.

Without `fastmath` numba never fuses a product and a sum. With it, whoever optimises last decides where, and in which order lanes of
a sum are added: kernels just compiled and kernels loaded from the cache then differ in the last bit. Here it is said:

| function     | value                                                                                                   |
| ------------ | ------------------------------------------------------------------------------------------------------- |
| fma(a, b, c) | a · b + c, rounded once                                                                                 |
| dot(a, b)    | Σ a b in LANES lanes, then halves of the lanes added to one another, then what is left over, one by one |

A fused operation is one instruction of x86-64 since 2013 and of all 64-bit ARM; older CPUs call the C library's, much slower, for
the same bits.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import float32, float64, types
from numba.core import cgutils as untyped_code
from numba.core.errors import TypingError
from numba.extending import intrinsic
from numba.np.arrayobj import make_array as untyped_array

LANES = 16
code: Any = untyped_code
array: Any = untyped_array


def _fma(_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Types of a call, and what writes it; mixed types don't compile."""
    if not (a == b == c and a in (float32, float64)):
        raise TypingError(f"fma takes three float32 or three float64, not {a}, {b}, {c}")

    def generate(_target: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return builder.fma(*values)

    return a(a, a, a), generate


fma: Any = intrinsic(_fma)


def _dot(_context: Any, first: Any, second: Any) -> Any:
    """Types of a call, and what writes it."""
    if not first == second == types.Array(float32, 1, "C"):
        raise TypingError(f"dot takes two contiguous rows of float32, not {first}, {second}")

    def generate(target: Any, builder: Any, signature: Any, values: Any) -> Any:
        rows = [array(kind)(target, builder, value) for kind, value in zip(signature.args, values, strict=True)]
        wide, pointers = ir.VectorType(ir.FloatType(), LANES), [row.data for row in rows]
        fused = code.get_or_insert_function(builder.module, ir.FunctionType(wide, [wide] * 3), f"llvm.fma.v{LANES}f32")
        count = builder.extract_value(rows[0].shape, 0)
        whole = builder.and_(count, count.type(-LANES))
        lanes, total = code.alloca_once_value(builder, wide([0.0] * LANES)), code.alloca_once(builder, ir.FloatType())
        with code.for_range_slice(builder, count.type(0), whole, count.type(LANES)) as (i, _):
            a, b = (builder.load(builder.bitcast(builder.gep(p, [i]), wide.as_pointer()), align=4) for p in pointers)
            builder.store(builder.call(fused, [a, b, builder.load(lanes)]), lanes)
        builder.store(_halved(builder, builder.load(lanes)), total)
        with code.for_range_slice(builder, whole, count, count.type(1)) as (i, _):
            a, b = (builder.load(builder.gep(p, [i])) for p in pointers)
            builder.store(builder.fma(a, b, builder.load(total)), total)
        return builder.load(total)

    return float32(first, second), generate


def _halved(builder: Any, lanes: Any) -> Any:
    """Sum of a vector: the upper half is added to the lower one, until one number is left."""
    half = lanes.type.count // 2
    if half == 0:
        return builder.extract_element(lanes, ir.IntType(32)(0))
    index = ir.VectorType(ir.IntType(32), half)
    low, high = (builder.shuffle_vector(lanes, lanes, index(list(range(s, s + half)))) for s in (0, half))
    return _halved(builder, builder.fadd(low, high))


dot: Any = intrinsic(_dot)
