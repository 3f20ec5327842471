"""A participant's trials: which conditions in which order, from the seed and the participant's code alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from itouch_tools.study import orders
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.study_elements import CATCH, PRACTICE, Study


@dataclass(frozen=True, slots=True)
class Trial:
    """One trial as it is planned.

    ``place`` counts from 0 over the whole session; ``condition`` has a level of each factor; ``shown`` has the
    condition of each interval in the order of presentation, and ``target`` is the interval that holds ``condition``
    and not the standard (-1: there is only one interval).  A trial of a staircase gets its level when it begins.
    """

    place: int
    block: str
    condition: dict[str, str]
    shown: tuple[dict[str, str], ...]
    target: int = -1
    staircase: str = ""


def trials_of(file: StudyFile, participant: str) -> list[Trial]:
    """Return all trials of a participant, practice first."""
    study = file.study
    order = _with_catch(file, participant, _ordered(file, participant))
    planned: list[Trial] = []
    rng = orders.generator(study.seed, participant, "intervals")
    practice = [] if study.practice is None else _practice(file, participant, study.practice.trials)
    for block, condition, staircase in [*practice, *order]:
        planned.append(_trial(study, len(planned), block, condition, staircase, rng))
    return planned


def _ordered(file: StudyFile, participant: str) -> list[tuple[str, dict[str, str], str]]:
    study, order = file.study, file.study.order
    if study.staircases:
        streams = [[one.name] * one.trials for one in study.staircases]
        mixed = orders.interleave(streams, orders.generator(study.seed, participant, "staircases"))
        return [("main", {}, name) for name in mixed]
    conditions = file.conditions()
    rng = orders.generator(study.seed, participant, "order")
    if order.kind == "blocked":
        levels = list(dict.fromkeys(condition[order.by] for condition in conditions))
        levels = [levels[index] for index in rng.permutation(len(levels))]
        blocks = [(level, [c for c in conditions if c[order.by] == level]) for level in levels]
        return [
            (level, condition, "") for level, members in blocks
            for condition in _shuffled(study, members * order.repetitions, rng)
        ]  # fmt: skip
    if order.kind == "random":
        return [("main", condition, "") for condition in _shuffled(study, conditions * order.repetitions, rng)]
    if order.kind == "fixed":
        return [("main", condition, "") for condition in conditions * order.repetitions]
    square = orders.williams(len(conditions)) if order.kind == "williams" else orders.latin_square(len(conditions))
    first = orders.assigned_row(study.seed, participant, len(square))
    return [
        (f"row {(first + repeat) % len(square) + 1}", conditions[index], "")
        for repeat in range(order.repetitions)
        for index in square[(first + repeat) % len(square)]
    ]


def _with_catch(
    file: StudyFile, participant: str, order: list[tuple[str, dict[str, str], str]]
) -> list[tuple[str, dict[str, str], str]]:
    """Insert the catch trials among the others: not before the first, and if possible not beside the same level."""
    catch, asked = file.study.catch, file.study.task.factor
    if catch is None:
        return order
    shown = {factor.name: catch.condition[factor.name] for factor in file.study.factors}
    rng = orders.generator(file.study.seed, participant, "catch")
    places = range(1, len(order) + 1)
    apart = [
        place for place in places
        if all(one.get(asked) != shown[asked] for _, one, _ in order[place - 1 : place + 1])
    ]  # fmt: skip
    chosen = rng.permutation(apart if len(apart) >= catch.trials else list(places))
    found = list(order)
    for place in sorted((int(chosen[n % len(chosen)]) for n in range(catch.trials)), reverse=True):
        found.insert(place, (CATCH, shown, ""))
    return found


def _shuffled(study: Study, items: list[dict[str, str]], rng: np.random.Generator) -> list[dict[str, str]]:
    asked = study.task.factor
    counts = [sum(item[asked] == level for item in items) for level in {item[asked] for item in items}]
    most = max(study.order.most_equal, orders.possible_run(counts))
    return orders.constrained_shuffle(items, rng, key=lambda item: item[asked], most=most)


def _practice(file: StudyFile, participant: str, count: int) -> list[tuple[str, dict[str, str], str]]:
    conditions = file.conditions() if file.study.factors else [{}]
    rng = orders.generator(file.study.seed, participant, "practice")
    picks = [int(index) for _ in range(-(-count // len(conditions))) for index in rng.permutation(len(conditions))]
    names = [one.name for one in file.study.staircases]
    return [(PRACTICE, conditions[pick], names[0] if names else "") for pick in picks[:count]]


def _trial(
    study: Study, place: int, block: str, condition: dict[str, str], staircase: str, rng: np.random.Generator
) -> Trial:
    count = study.task.intervals
    word = int(rng.integers(count)) if count > 1 else -1
    if count == 1:
        return Trial(place, block, condition, (condition,), -1, staircase)
    standard = {} if staircase else {**condition, study.task.factor: study.task.standard}
    shown = tuple(condition if index == word else standard for index in range(count))
    return Trial(place, block, condition, shown, word, staircase)
