"""Orders of conditions: laws for all of them."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch_tools.study import orders


@given(st.integers(1, 12))
def test_williams_designs_balance_neighbours(count: int) -> None:
    rows = orders.williams(count)
    assert len(rows) == (count if count % 2 == 0 or count == 1 else 2 * count)
    assert all(sorted(row) == list(range(count)) for row in rows)
    pairs = Counter(pair for row in rows for pair in itertools.pairwise(row))
    assert len(pairs) == count * (count - 1)
    assert len(set(pairs.values())) <= 1  # each equally often
    for place in range(count):
        assert len(set(Counter(row[place] for row in rows).values())) == 1


def test_the_published_square() -> None:
    assert orders.williams(4) == [[0, 1, 3, 2], [1, 2, 0, 3], [2, 3, 1, 0], [3, 0, 2, 1]]


@given(st.integers(1, 9))
def test_latin_squares(count: int) -> None:
    square = orders.latin_square(count)
    for lines in (square, list(zip(*square, strict=True))):
        assert all(sorted(line) == list(range(count)) for line in lines)


@given(st.lists(st.integers(0, 9), min_size=1, max_size=6), st.integers(1, 3), st.integers(0, 2**31))
def test_constrained_orders_keep_their_promise(counts: list[int], most: int, seed: int) -> None:
    items = [(kind, number) for kind, count in enumerate(counts) for number in range(count)]
    rng = np.random.default_rng(seed)
    if orders.possible_run(counts) > most:
        with pytest.raises(ValueError, match="no order"):
            orders.constrained_shuffle(items, rng, key=lambda item: item[0], most=most)
        return
    found = orders.constrained_shuffle(items, rng, key=lambda item: item[0], most=most)
    assert Counter(found) == Counter(items)
    assert orders.longest_run(found, lambda item: item[0]) <= most


@given(st.lists(st.integers(0, 6), min_size=1, max_size=5), st.integers(1, 3), st.integers(0, 2**31))
def test_orders_that_are_built_keep_it_too(counts: list[int], most: int, seed: int) -> None:
    if orders.possible_run(counts) > most:
        return
    items = [kind for kind, count in enumerate(counts) for _ in range(count)]
    found = orders._built(items, np.random.default_rng(seed), lambda item: item, most)
    assert Counter(found) == Counter(items)
    assert orders.longest_run(found, lambda item: item) <= most


def test_possible_runs_are_the_smallest() -> None:
    for counts in itertools.product(range(4), repeat=3):
        items = [kind for kind, count in enumerate(counts) for _ in range(count)]
        if len(items) > 7:
            continue
        least = min(
            (orders.longest_run(order, lambda item: item) for order in set(itertools.permutations(items))), default=0
        )
        assert orders.possible_run(counts) == least


def test_all_allowed_orders_are_equally_probable() -> None:
    rng = np.random.default_rng(3)
    found = Counter("".join(orders.constrained_shuffle("aabb", rng, key=str, most=1)) for _ in range(4000))
    assert set(found) == {"abab", "baba"}
    assert abs(found["abab"] - 2000) < 160


def test_a_participant_gets_the_same_order_from_seed_and_code_alone() -> None:
    def drawn(seed: int, code: str, purpose: str) -> list[int]:
        return orders.generator(seed, code, purpose).integers(1000, size=5).tolist()

    assert drawn(7, "P07", "order") == drawn(7, "P07", "order") == [48, 38, 995, 956, 686]
    different = [drawn(7, "P08", "order"), drawn(8, "P07", "order"), drawn(7, "P07", "row"), drawn(7, "P0", "7order")]
    assert all(other != drawn(7, "P07", "order") for other in different)
    rows = Counter(orders.assigned_row(1, f"P{n}", 4) for n in range(800))
    assert min(rows.values()) > 150


def test_a_square_without_rows_is_refused_in_a_sentence() -> None:
    with pytest.raises(ValueError, match="a square has at least one row"):
        orders.assigned_row(1, "p1", 0)
    assert orders.assigned_row(1, "p1", 1) == 0


def test_streams_are_mixed_in_their_own_order() -> None:
    mixed = orders.interleave(["abc", "xy"], np.random.default_rng(1))
    assert [c for c in mixed if c in "abc"] == list("abc")
    assert [c for c in mixed if c in "xy"] == list("xy")
    assert orders.interleave([], np.random.default_rng(1)) == []


def test_a_long_order_is_built_from_its_kinds_and_is_what_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """An order of 20 000 trials took hours, because each item that was left was looked at for each place."""
    real, looked = orders._leaves_possible, []

    def plain(pool: list[str], rng: np.random.Generator, most: int) -> list[str]:
        left = [pool[index] for index in rng.permutation(len(pool))]
        counts, found, run = Counter(left), list[str](), 0
        while left:
            last = found[-1] if found else None
            weights = np.array([real(counts, one, last, run, most) for one in left], float)
            one = left.pop(int(rng.choice(len(left), p=weights / weights.sum())))
            counts[one] -= 1
            run = run + 1 if one == last else 1
            found.append(one)
        return found

    def watched(*words: Any) -> bool:
        looked.append(words)
        return real(*words)

    monkeypatch.setattr(orders, "_leaves_possible", watched)
    pool = ["a", "b", "c"] * 40 + ["a"] * 20
    found = orders._built(pool, np.random.default_rng(3), lambda item: item, 2)
    assert len(looked) == 3 * len(pool)
    assert found == plain(pool, np.random.default_rng(3), 2)
