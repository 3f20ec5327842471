"""The method of constant stimuli: how often each level is judged colder than the standard, with a fitted function."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from itouch.schema import units
from itouch.schema.quantities import parse_number, split_unit
from itouch_tools.study import statistics as stats
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.study_store import Row

#: Fewest levels to which a function is fitted, and the share of answers that do not depend on the stimulus.
LEAST, LAPSE = 3, 0.02
#: Distance from the middle of the standard normal distribution to its upper quartile.
QUARTILE = 0.674489750196082


def stimuli(file: StudyFile) -> dict[str, float]:
    """Return the number of each level of the factor that is asked for; empty if the levels are no series of numbers.

    They are in the unit in which all are written; in SI if that differs.
    """
    task = file.study.task
    factor = next((one for one in file.study.factors if one.name == task.factor), None)
    if task.kind != "colder" or factor is None:
        return {}
    numbers = _numbers(factor.taken)
    found = dict(zip(factor.names, numbers, strict=True)) if numbers else {}
    return found if len(set(found.values())) >= LEAST else {}


def _numbers(values: Sequence[str]) -> list[float]:
    """Return the numbers of a series; empty: it is none.

    They are in the unit that all values have, or in SI where units differ.  Of several numbers, such as a position, it
    is the one that differs.
    """
    found: list[tuple[list[float], units.Unit]] = []
    for value in values:
        words, unit = split_unit(value)
        try:
            found.append(([parse_number(word) for word in words], units.parse_unit(unit)))
        except ValueError:
            return []
    if len({unit.text for _, unit in found}) > 1:
        if len({unit.dimension for _, unit in found if unit.text}) > 1:  # a number without a unit is in SI
            return []
        found = [([number * unit.factor + unit.offset for number in numbers], unit) for numbers, unit in found]
    if len({len(numbers) for numbers, _ in found}) != 1:
        return []
    series = [list(column) for column in zip(*(numbers for numbers, _ in found), strict=True) if len(set(column)) > 1]
    return series[0] if len(series) == 1 else []


def judged_colder(file: StudyFile, rows: Iterable[Row]) -> list[tuple[float, int, int]]:
    """Return triples (level, how often it was judged colder than the standard, trials), in the order of levels.

    Trials in which both intervals held the standard are left out: neither could be colder.
    """
    levels, asked = stimuli(file), file.study.task.factor
    counts: dict[float, list[int]] = {}
    for row in rows:
        level = row.condition.get(asked, "")
        if level not in levels or level == file.study.task.standard or row.answer is None:
            continue
        places = [index for index, shown in enumerate(row.shown) if shown.get(asked) == level]
        if len(places) != 1:
            continue
        entry = counts.setdefault(levels[level], [0, 0])
        entry[0] += int(row.answer) == places[0]
        entry[1] += 1
    return [(level, chosen, trials) for level, (chosen, trials) in sorted(counts.items())]


def point_of_equality(counts: Sequence[tuple[float, int, int]]) -> tuple[float, float]:
    """Return the level that is judged colder as often as not, and the difference from there to the 75 % level.

    A cumulative normal function is fitted, rising or falling with the level, with 2 % of answers independent of it.
    Both are NaN where the answers do not bound them, or if the point of equality lies beyond the levels shown.
    """
    found = _fitted(counts)
    return (math.nan, math.nan) if found is None else (found[0] * found[1].threshold, QUARTILE * found[1].spread)


def interval_of_equality(counts: Sequence[tuple[float, int, int]]) -> tuple[float, float]:
    """Return the 95 % profile interval of the point of equality; an end is NaN where the answers do not bound it."""
    found = _fitted(counts)
    if found is None:
        return math.nan, math.nan
    sign, best = found
    levels, chosen, trials = (np.array(each, float) for each in zip(*counts, strict=True))
    ends = stats.profile_interval(sign * levels, chosen, trials, best)
    low, high = sorted(sign * end for end in ends)
    return (low if math.isfinite(low) else math.nan), (high if math.isfinite(high) else math.nan)


def _fitted(counts: Sequence[tuple[float, int, int]]) -> tuple[float, stats.Psychometric] | None:
    """Return the better of a rising (1.0) and a falling (-1.0) function; None where the answers do not bound it."""
    if len(counts) < LEAST:
        return None
    levels, chosen, trials = (np.array(each, float) for each in zip(*counts, strict=True))
    blind = 0.5 * LAPSE
    ways = [
        (sign, stats.fit_psychometric(sign * levels, chosen, trials, guess=blind, lapse=blind)) for sign in (1.0, -1.0)
    ]
    sign, best = min(ways, key=lambda way: way[1].loss)
    inside = levels.min() <= sign * best.threshold <= levels.max()
    return None if best.bounded or not inside else (sign, best)


def constant(file: StudyFile, rows: Sequence[Row], *, draws: int) -> dict[str, Any] | None:
    """Return the series of levels with each person's point of equality and threshold; None for any other study."""
    if not stimuli(file):
        return None
    people = sorted({row.participant for row in rows})
    found = {person: point_of_equality(judged_colder(file, [r for r in rows if r.participant == person]))
             for person in people}  # fmt: skip
    whole = point_of_equality(judged_colder(file, rows))
    named: dict[str, Any] = {}
    for index, name in enumerate(("equal", "threshold")):
        values = [pair[index] for pair in found.values() if math.isfinite(pair[index])]
        named[name] = {
            "pooled": whole[index], "people": {person: pair[index] for person, pair in found.items()},
            "mean": float(np.mean(values)) if values else math.nan,
            "panel_95": stats.participant_interval(
                values, lambda some: float(np.mean(some)), seed=file.study.seed, draws=draws
            ),
        }  # fmt: skip
    counts = {person: judged_colder(file, [r for r in rows if r.participant == person]) for person in people}
    named["equal"]["people_95"] = {person: interval_of_equality(own) for person, own in counts.items()}
    series = [
        {
            "level": level, "chosen": chosen, "trials": trials, "wilson_95": stats.wilson(chosen, trials),
            "panel_95": stats.share_interval(
                [(c, n) for own in counts.values() for at, c, n in own if at == level],
                seed=file.study.seed, draws=draws,
            ),
        }
        for level, chosen, trials in judged_colder(file, rows)
    ]  # fmt: skip
    return {"factor": file.study.task.factor, "standard": file.study.task.standard, "series": series, **named}
