"""Chains of compiled calls: they do what the calls do one by one, stop where Python is wanted, and go on from there."""

from __future__ import annotations

import time
from collections import namedtuple
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from numba.core.errors import TypingError
from numpy.typing import NDArray
from requirements import meant

from itouch.compiling import kernel, part_of_its_caller
from itouch.joining import _KINDS, Chain, can_join, prepare, runner
from itouch.plugin import Bound

Floats = NDArray[np.float64]


class Pair(NamedTuple):
    """Two arrays of different types."""

    weights: Floats
    places: NDArray[np.int32]


@kernel
def _add(total: Any, rows: Any, factor: float) -> int:
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            total[0] += factor * rows[i, j]
    return 0


@kernel
def _pick(total: Any, pair: Any, most: float, sign: bool, shift: int, words: Any) -> int:
    for i in range(pair.weights.shape[0]):
        total[0] += pair.weights[i] * (pair.places[i] + shift)
    words[0] += np.uint64(3)
    if sign and total[0] > most:
        return 7
    return 0


def _calls(total: Floats, rows: Floats, most: float) -> list[Bound]:
    pair = Pair(np.array([0.5, 2.0]), np.array([3, -1], np.int32))
    words = np.array([2**63], np.uint64)
    pick = Bound(_pick, total, pair, most, True, 2, words)
    return [Bound(_add, total, rows, 0.25), pick, Bound(_add, total, rows, -1.5), pick]


def test_functions_can_be_joined_here() -> None:
    assert can_join()


@settings(deadline=None, max_examples=30)  # the first one compiles
@given(some.lists(some.floats(-1e3, 1e3), min_size=6, max_size=6), some.floats(-1e3, 1e3))
def test_a_chain_does_what_its_calls_do_and_stops_where_they_ask(numbers: list[float], most: float) -> None:
    rows = np.array(numbers).reshape(2, 3)
    alone, joined = np.zeros(1), np.zeros(1)
    codes = [call() for call in _calls(alone, rows, most)]
    chain = Chain(_calls(joined, rows, most))
    stops, found = [], chain.run()
    while found >= 0:
        stops.append((found >> 32, found & 0xFFFFFFFF))
        found = chain.run((found >> 32) + 1)
    assert stops == [(index, code) for index, code in enumerate(codes) if code]
    assert alone.tobytes() == joined.tobytes()


def test_a_scalar_of_state_is_an_array_of_one_number() -> None:
    total = np.zeros(())
    Chain([Bound(_add, total, np.ones((2, 2)), 1.0)]).run()
    assert total == 4.0


class _Outer:
    class Pair(NamedTuple):
        """Another class of the same name, with other fields."""

        first: Pair
        scale: Floats


@kernel
def _scaled(total: Any, both: Any) -> int:
    total[0] = both.first.weights[0] * both.scale[0]
    return 0


def test_two_classes_of_one_name_are_told_apart() -> None:
    total, inner = np.zeros(1), Pair(np.array([3.0]), np.zeros(1, np.int32))
    Chain([Bound(_scaled, total, _Outer.Pair(inner, np.array([7.0])))]).run()
    assert total[0] == 21.0


class words(NamedTuple):  # noqa: N801
    """Called like what the code of an entry calls its argument."""

    integer: Floats


class function(NamedTuple):  # noqa: N801
    """Called like what an entry calls."""

    float64_1: Floats
    words: words


@kernel
def _nested(total: Any, given: Any, count: int) -> int:
    total[0] = given.float64_1[0] * given.words.integer[0] + count
    return 0


@pytest.mark.parametrize(
    "cls", [function, namedtuple("integer", "float64_1 words"), namedtuple("a0", "float64_1 words")]
)
def test_what_a_named_tuple_is_called_changes_nothing(cls: Any) -> None:
    total = np.zeros(1)
    Chain([Bound(_nested, total, cls(np.array([3.0]), words(np.array([7.0]))), 5)]).run()
    assert total[0] == 26.0


def test_what_is_not_contiguous_is_refused() -> None:
    with pytest.raises(ValueError, match="contiguous"):
        Chain([Bound(_add, np.zeros(1), np.ones((4, 4))[:, ::2], 1.0)])


@kernel
def _weigh(out: Any, kind: Any, plane: Any, empty: Any, absent: Any) -> int:
    out[0] += 1.0 if absent is None and len(empty) == 0 else 0.0
    for i in range(kind.shape[0]):
        for j in range(plane.shape[0]):
            for k in range(plane.shape[1]):
                for m in range(plane.shape[2]):
                    out[0] += kind[i] * (100 * j + 10 * k + m) * plane[j, k, m]
    return 0


@pytest.mark.parametrize("kind", [*_KINDS, np.longlong, np.ulonglong, np.intc])
def test_arrays_of_every_kind_and_shape_arrive_as_they_are(kind: type) -> None:
    """Also those that cannot be written to, nothing at all, and an empty tuple."""
    plane = np.arange(24, dtype=kind).reshape(2, 3, 4)
    plane.flags.writeable = False
    few, outs = np.array([1, 2, 100], kind), [np.zeros(1), np.zeros(1)]
    assert _weigh(outs[0], few, plane, (), None) == 0
    assert Chain([Bound(_weigh, outs[1], few, plane, (), None)]).run() == -1
    places = [100 * j + 10 * k + m for j in range(2) for k in range(3) for m in range(4)]
    assert outs[0] == outs[1] == 1.0 + 103.0 * np.dot(places, np.arange(24.0))


@pytest.mark.parametrize("kind", ["bool", "complex128", "float16", "M8[s]", "S4", [("a", "f8")]])
def test_an_array_that_no_kernel_can_be_given_is_refused(kind: Any) -> None:
    with pytest.raises(ValueError, match="an array that is bound is of one of float64, .* not of "):
        Chain([Bound(_weigh, np.zeros(1), np.zeros(3, kind), np.zeros((1, 1, 1)), (), None)])


@kernel
def _keep(out: Any, number: Any, pair: Any) -> int:
    out[0], out[1] = number, pair[0]
    return 0


@pytest.mark.parametrize(
    "number", [0.5, True, -3, *(kind(2.5) for kind in _KINDS), np.float16(0.5), np.longdouble(0.5), np.bool_(True)]
)
def test_a_number_of_every_kind_arrives_as_it_is(number: Any) -> None:
    """A float32 lost its fraction: 0.5 arrived as 0."""
    joined, called = np.zeros(2), np.zeros(2)
    Chain([Bound(_keep, joined, number, (number,))]).run()
    assert Bound(_keep, called, number, (number,))() == 0
    assert joined.tolist() == called.tolist() == [float(number)] * 2


@pytest.mark.parametrize(
    ("number", "why"),
    [("12", "'12' is bound, which is neither a number"), (b"1", "neither"), (1 + 2j, "neither"), (2**63, "64 bits")],
)
def test_what_is_no_number_of_a_word_is_refused(number: Any, why: str) -> None:
    with pytest.raises(ValueError, match=f"'_keep' can't be called with what is bound to it: .*{why}"):
        prepare(Bound(_keep, np.zeros(2), number, (1,)))


@kernel
def _returns_nothing(out: Any) -> None:
    out[0] += 1.0


@kernel
def _asks_for_what_is_not_there(out: Any) -> int:
    return out.there  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    ("function", "why"),
    [
        (_returns_nothing, "'_returns_nothing' can't be compiled .*: it returns nothing, where 0 or another number is"),
        (_asks_for_what_is_not_there, "'_asks_for_what_is_not_there' can't be compiled .*: Unknown attribute 'there'"),
    ],
)
def test_what_cannot_be_compiled_is_told_in_a_sentence_whoever_calls_it(function: Any, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        prepare(Bound(function, np.zeros(1)))
    with pytest.raises(ValueError, match=why):
        Bound(function, np.zeros(1))()


def test_the_stamps_are_of_the_clock_that_python_reads() -> None:
    calls = _calls(np.zeros(1), np.ones((2, 3)), np.inf)
    chain, stamps = Chain(calls), np.zeros(len(calls) + 1)
    before = time.perf_counter()
    assert chain.run_timed(stamps, 1) == -1
    after = time.perf_counter()
    assert before <= stamps[1]
    assert (np.diff(stamps[1:]) >= 0.0).all()
    assert stamps[-1] <= after


def test_rehearsing_changes_nothing() -> None:
    total = np.zeros(1)
    Bound(_add, total, np.ones((2, 2)), 1.0).warm_up()
    assert total[0] == 0.0


@kernel
def _sum_into(rows: Floats, out: Floats) -> int:
    out[0] = rows.sum()
    return 0


@kernel
def _spoil(rows: Floats) -> int:
    rows[0] = 1.0
    return 0


@pytest.mark.skipif(not can_join(), reason=meant("compiling is switched off"))
def test_what_is_read_only_stays_so_where_calls_are_joined() -> None:
    """One type for both ways of calling: nothing is compiled twice, and nothing writes what a model holds."""
    fixed, out = np.arange(4.0), np.zeros(1)
    fixed.setflags(write=False)
    run = runner((Bound(_sum_into, fixed, out),))
    assert run() == -1 and out[0] == 6.0
    assert _sum_into(fixed, out) == 0
    assert len(_sum_into.signatures) == 1
    with pytest.raises(TypingError, match="readonly"):
        runner((Bound(_spoil, fixed),))
    assert fixed.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_what_others_compiled_in_their_way_stays_as_they_did() -> None:
    @numba.njit(error_model="numpy", fastmath=True)
    def double(total: Any) -> int:
        total[0] *= 2.0
        return 0

    assert part_of_its_caller(double) is double
    assert part_of_its_caller(_add) is not _add
    total = np.array([3.0])
    Chain([Bound(double, total), Bound(_add, total, np.ones((2, 2)), 0.5)]).run()
    assert total[0] == 8.0


@kernel
def _count(total: Any, *more: Any) -> int:
    total[0] += len(more)
    return 0


def test_a_call_may_have_any_number_of_arguments() -> None:
    total = np.array([1.0])
    Chain([Bound(_count, total, 1.0, 2), Bound(_count, total)]).run()
    assert total[0] == 3.0


def test_a_call_whose_compilation_was_interrupted_is_compiled_when_it_is_asked_for_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A signal may come at any moment, as the suite's own alarm does: what was begun then stayed without its code."""

    @kernel
    def _doubled(numbers: NDArray[np.float64]) -> int:
        numbers[0] *= 2.0
        return 0

    numbers = np.array([3.0])
    call = Bound(_doubled, numbers)

    class Interrupted:
        def compile(self, signature: object) -> None:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("itouch.joining.addressed_kernel", lambda function: Interrupted())
        with pytest.raises(KeyboardInterrupt):
            runner((call, call))
    runner((call, call))()
    assert numbers[0] == 12.0
