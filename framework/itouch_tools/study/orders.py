"""The order of conditions: squares, blocks and constrained shuffles; for a participant it is always the same.

All randomness comes from `generator`, which depends only on the study's seed, the participant's code and a purpose.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")

#: Attempts of rejection sampling, which is uniform over all allowed orders, before an order is built.
ATTEMPTS = 2000


def generator(seed: int, participant: str, *purpose: str) -> np.random.Generator:
    """Return the random generator of one participant and purpose: the same for the same arguments, on every machine.

    Parameters
    ----------
    seed
        The study's seed.
    participant
        The participant's code.
    purpose
        What it is for, such as ``"order"``; different purposes draw independently.
    """
    text = "\x1f".join((str(seed), participant, *purpose)).encode()
    words = np.frombuffer(hashlib.sha256(text).digest(), "<u8")
    return np.random.Generator(np.random.PCG64([int(word) for word in words]))


def assigned_row(seed: int, participant: str, rows: int) -> int:
    """Return the row of a square that a participant gets, from seed and code alone.

    Raises
    ------
    ValueError
        If there are no rows.
    """
    if rows < 1:
        raise ValueError("a square has at least one row")
    return int(generator(seed, participant, "row").integers(rows))


def latin_square(count: int) -> list[list[int]]:
    """Return the cyclic Latin square, shape (count, count): each condition is once in each row and at each place."""
    return [[(row + place) % count for place in range(count)] for row in range(count)]


def williams(count: int) -> list[list[int]]:
    """Return a Williams design: each condition is once in each row, and all ordered pairs of neighbours equally often.

    An even number of conditions needs as many rows, an odd one twice as many (Williams 1949, Aust. J. Sci. Res. A
    2:149): the second half is the first half with each row reversed.
    """
    if count < 1:
        return []
    first, low, high = [], 0, count - 1
    for place in range(count):  # 0, 1, n-1, 2, n-2 ...
        if place == 0:
            first.append(0)
        elif place % 2:
            low += 1
            first.append(low)
        else:
            first.append(high)
            high -= 1
    rows = [[(value + row) % count for value in first] for row in range(count)]
    return rows if count % 2 == 0 or count == 1 else rows + [row[::-1] for row in rows]


def longest_run(items: Sequence[T], key: Callable[[T], Hashable]) -> int:
    """Return the length of the longest run of equal keys."""
    longest = run = 0
    before: object = object()
    for item in items:
        value = key(item)
        run = run + 1 if value == before else 1
        before, longest = value, max(longest, run)
    return longest


def possible_run(counts: Sequence[int]) -> int:
    """Return the smallest longest run with which items can be ordered, given the number of items of each key."""
    if not counts or max(counts) == 0:
        return 0
    largest = max(counts)
    gaps = sum(counts) - largest + 1
    return -(-largest // gaps)


def constrained_shuffle(
    items: Sequence[T], rng: np.random.Generator, *, key: Callable[[T], Hashable], most: int
) -> list[T]:
    """Return the items in random order, with at most ``most`` of equal key in a row.

    Shuffles are drawn until one is allowed, so that all allowed orders are equally probable; if allowed orders are too
    rare for that, one is built by drawing each next item among those after which the rest can still be ordered.

    Parameters
    ----------
    items
        The items to order.
    rng
        The participant's generator.
    key
        Returns what must not repeat too often, such as the material of a trial.
    most
        Greatest number of equal keys in a row.

    Raises
    ------
    ValueError
        If no such order exists.
    """
    pool = list(items)
    counts = Counter(key(item) for item in pool)
    least = possible_run(list(counts.values()))
    if most < least:
        raise ValueError(
            f"no order of {len(pool)} trials has at most {most} equal in a row: {max(counts.values())} are equal, "
            f"at least {least} must follow one another"
        )
    keys = [key(item) for item in pool]
    for _ in range(ATTEMPTS):
        drawn = rng.permutation(len(pool))
        if _allowed((keys[index] for index in drawn), most):
            return [pool[index] for index in drawn]
    return _built(pool, rng, key, most)


def _allowed(keys: Iterable[Hashable], most: int) -> bool:
    """Tell whether at most ``most`` equal keys follow one another."""
    run, before = 0, object()
    for value in keys:
        run, before = (run + 1 if value == before else 1), value
        if run > most:
            return False
    return True


def _built(pool: list[T], rng: np.random.Generator, key: Callable[[T], Hashable], most: int) -> list[T]:
    left = [pool[index] for index in rng.permutation(len(pool))]
    counts = Counter(key(item) for item in left)
    known = {value: number for number, value in enumerate(counts)}
    kinds = np.array([known[key(item)] for item in left], int)
    order: list[T] = []
    last: Hashable = None
    run = 0
    while left:
        possible = np.array([_leaves_possible(counts, value, last, run, most) for value in known], float)
        weights = possible[kinds]
        index = int(rng.choice(len(left), p=weights / weights.sum()))
        item, kinds = left.pop(index), np.delete(kinds, index)
        value = key(item)
        counts[value] -= 1
        run = run + 1 if order and value == last else 1
        last = value
        order.append(item)
    return order


def _leaves_possible(counts: Counter[Hashable], value: Hashable, last: Hashable, run: int, most: int) -> bool:
    """Tell whether the rest can still be ordered if an item with the key ``value`` is taken next."""
    now = run + 1 if run and value == last else 1
    if now > most:
        return False
    total = sum(counts.values()) - 1
    for other, count in counts.items():
        rest = count - (other == value)
        gaps = total - rest  # of other items, each of which opens a place for at most ``most``
        room = (most - now if other == value else most) + gaps * most
        if rest > room:
            return False
    return True


def interleave(streams: Sequence[Sequence[T]], rng: np.random.Generator) -> list[T]:
    """Return several streams interleaved at random, each in its own order; all mixtures are equally probable."""
    labels = [index for index, stream in enumerate(streams) for _ in stream]
    at = [0] * len(streams)
    mixed: list[T] = []
    for label in rng.permutation(np.array(labels, int)) if labels else ():
        mixed.append(streams[label][at[label]])
        at[label] += 1
    return mixed
