"""What makes no array and returns none counts no references; all else counts them as Numba does, and loses none."""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys
from requirements import meant

from contact_heat.dot_product import scratch as contact_scratch
from itouch.compiling import ALONE, kernel, linked, scratch
from itouch.joining import can_join
from itouch.reference_counting import Borrowing


class Pair(NamedTuple):
    """Two arrays."""

    one: Any
    other: Any


@linked
def _first(values: Any) -> float:
    return float(values[0])


@linked
def _doubled(values: Any) -> Any:
    return 2.0 * values


@kernel
def _sum(values: Any) -> float:
    total = 0.0
    for i in range(values.shape[0]):
        total += values[i]
    return total


def _views(table: Any, pair: Any) -> float:
    """Take rows, slices and parts of tuples, make a tuple of them, write to them, and pass them on."""
    row, part = table[1], pair.one[1:3]
    again = Pair(row, part)
    again.other[:] = 3.0
    one, other = pair
    return _first(row) + _sum(part) + _sum(again.one) + one[0] + other[0] + table[0, 1]


def _works(table: Any, pair: Any) -> float:
    """Work in memory that is not asked for, which each call has for itself, and take sizes."""
    total = 0.0
    for turn in range(2):
        one, other = scratch(4), contact_scratch(3)
        for i in range(len(other)):
            one[i], other[i] = turn + table[0, 1], 10.0 * i
        total += _sum(one[:3]) + _sum(other) + one.shape[0]
    return total


def _copies(table: Any, pair: Any) -> float:
    return _sum(table[1].copy())


def _computes(table: Any, pair: Any) -> float:
    return _sum(table[0] + pair.one[:2])


def _chooses(table: Any, pair: Any) -> float:
    return _sum(pair.one[pair.one > 0.0])


def _calls(table: Any, pair: Any) -> float:
    return _sum(_doubled(pair.one))


def _overlaps(table: Any, pair: Any) -> float:
    pair.one[1:] = pair.one[:-1]
    return _sum(pair.one)


def _returns(table: Any, pair: Any) -> Any:
    return pair.one[1:]


def _returns_given(table: Any, pair: Any) -> Any:
    return pair


def _lists(table: Any, pair: Any) -> float:
    return _sum([pair.one, table[0]][0])


def _flattens(table: Any, pair: Any) -> float:
    return _sum(table.reshape(4)) + _sum(table.T[0])


def _loops(table: Any, pair: Any) -> float:
    total = 0.0
    for row in table:
        total += _sum(row)
    return total


def _raises(table: Any, pair: Any) -> float:
    if table[0, 0] < -1e3:
        raise ValueError("too low", table[0, 0])
    return _sum(table[0])


def _asks_python(table: Any, pair: Any) -> float:
    row, part = table[1], pair.one[1:]
    with numba.objmode(total="float64"):
        total = row[0] + part.sum()
    return float(total)


def _reads(table: Any, pair: Any) -> float:
    """Take parts of texts, which are copies."""
    name, total = "ab\u00e9\u4e2d", 0.0
    for i in range(len(name)):
        total += table[1, 0] * (name[i] == "\u4e2d") + len(name[i:]) + len(name[::-2])
    return total


def _yields(table: Any, pair: Any) -> Any:
    for i in range(2):
        yield table[i]


BORROWS = [_views, _works]
COUNTS = [
    _copies, _computes, _chooses, _calls, _overlaps, _returns, _returns_given, _lists, _flattens, _loops, _raises, _yields,
    _asks_python, _reads,
]  # fmt: skip


def _flat(found: Any) -> list[float]:
    if isinstance(found, float):
        return [found]
    return [number for each in found for number in np.ravel(each).tolist()]


@pytest.mark.skipif(not can_join(), reason=meant("kernels run as Python here"))
@pytest.mark.parametrize("function", [*BORROWS, *COUNTS], ids=lambda one: one.__name__)
def test_only_what_makes_or_returns_arrays_counts_references_and_none_is_lost(function: Any) -> None:
    whole: Any = numba.njit(**ALONE, pipeline_class=Borrowing)(function)  # compiled here: kept code can't be looked at

    def arguments() -> tuple[Any, Any]:
        return np.arange(4.0).reshape(2, 2), Pair(np.arange(3.0), np.ones(2))

    whole(*arguments())  # compiled
    given, same = arguments(), arguments()
    held = [sys.getrefcount(array) for array in (given[0], *given[1])]
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    expected = [77.0] if function is _works else _flat(function(*same))  # Python has no such memory
    for _ in range(3):
        given[0][...], given[1].one[...] = arguments()[0], arguments()[1].one
        found = whole(*given)
        assert _flat(found) == expected
        del found
    after = rtsys.get_allocation_stats()
    _nrt_python.memsys_disable_stats()
    assert after.alloc - before.alloc == after.free - before.free
    assert held == [sys.getrefcount(array) for array in (given[0], *given[1])]
    code = "".join(whole.inspect_llvm().values())
    assert ("NRT_incref" in code or "NRT_decref" in code) == (function in COUNTS)


@pytest.mark.skipif(not can_join(), reason=meant("kernels run as Python here"))
def test_an_array_that_a_kernel_gets_from_another_one_lives_as_long_as_it_is_used() -> None:
    made: Any = kernel(lambda n: np.full(n, 7.0))
    passed: Any = kernel(lambda values: values[1:])

    def use(n: int) -> float:
        values = passed(made(n))
        made(n)  # would take the memory of what has been given back
        made(n)
        return _sum(values)

    assert numba.config.DISABLE_JIT == 0
    assert kernel(use)(50) == 7.0 * 49
