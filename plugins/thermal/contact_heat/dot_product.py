"""A dot product in eight lanes for compiled kernels, and the memory that a step needs while it runs.

Without ``fastmath`` a compiler may not reorder a sum, so a plain loop adds one number at a time.  Here the order is
explicit, eight partial sums and then a tree: several times faster, and the same bits on every processor.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

_numba: Any = numba  # what it exports is not typed
LANES = 8

_TREE = ((0, 4), (2, 6), (1, 5), (3, 7))


def padded(count: int) -> int:
    """Return the smallest multiple of the number of lanes that is at least ``count``."""
    return -(-count // LANES) * LANES


def _dot(typing: Any, a: Any, i: Any, b: Any, j: Any, count: Any) -> Any:
    """Return the sum of ``a[i + k] * b[j + k]`` for k below ``count``, a multiple of eight; 1-D float64 arrays."""
    signature = types.float64(a, types.intp, b, types.intp, types.intp)
    return signature, _generate


def _generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    double, vector = ir.DoubleType(), ir.VectorType(ir.DoubleType(), LANES)
    starts = [_start(context, builder, signature.args[n], values[n], values[n + 1]) for n in (0, 2)]
    total = cgutils.alloca_once_value(builder, ir.Constant(vector, [0.0] * LANES))
    step = ir.Constant(values[4].type, LANES)
    zero = ir.Constant(values[4].type, 0)
    with cgutils.for_range_slice(builder, zero, values[4], step, intp=values[4].type) as (offset, _):
        loaded = [
            builder.load(builder.gep(start, [offset], source_etype=double), align=8, typ=vector) for start in starts
        ]
        builder.store(builder.fadd(builder.load(total), builder.fmul(*loaded)), total)
    return _tree_sum(builder, builder.load(total))


def _start(context: Any, builder: Any, array_type: Any, array: Any, offset: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [offset], source_etype=ir.DoubleType())


def _tree_sum(builder: Any, vector: Any) -> Any:
    lane = [builder.extract_element(vector, ir.Constant(ir.IntType(32), n)) for n in range(LANES)]
    pairs = [builder.fadd(lane[m], lane[n]) for m, n in _TREE]
    return builder.fadd(builder.fadd(pairs[0], pairs[1]), builder.fadd(pairs[2], pairs[3]))


def _dot_in_python(a: Any, i: int, b: Any, j: int, count: int) -> float:
    """Return what `_dot` does, in the same order: NumPy adds row to row, it does not reorder a sum over the rows."""
    lane = np.add.reduce((a[i : i + count] * b[j : j + count]).reshape(-1, LANES), axis=0, initial=0.0)
    pairs = [lane[m] + lane[n] for m, n in _TREE]
    return float((pairs[0] + pairs[1]) + (pairs[2] + pairs[3]))


#: The dot product for kernels; where compiling is switched off, they run as Python, which cannot call an intrinsic.
dot: Any = _dot_in_python if _numba.config.DISABLE_JIT else intrinsic(_dot)


def _scratch(typing: Any, size: Any) -> Any:
    """Return an array of so many float64, a constant, in the memory of the caller, which must not return it."""
    kind = types.Array(types.float64, 1, "C")

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        count = size.literal_value
        memory = cgutils.alloca_once(builder, ir.DoubleType(), size=count)
        array = context.make_array(kind)(context, builder)
        step = context.get_constant(types.intp, 8)
        populate_array(
            array, data=memory, shape=[context.get_constant(types.intp, count)], strides=[step], itemsize=step,
            meminfo=None,
        )  # fmt: skip
        return array._getvalue()  # noqa: SLF001 - Numba's name for it

    return (kind(size), generate) if isinstance(size, types.IntegerLiteral) else None


#: Scratch memory for kernels, not initialized: asking the system for it, each time, costs as much as a short step.
scratch: Any = np.empty
if not _numba.config.DISABLE_JIT:
    scratch = intrinsic(prefer_literal=True)(_scratch)
    scratch.counts_nothing = True  # for a host that leaves out counts of references
