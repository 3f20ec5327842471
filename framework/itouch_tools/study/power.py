"""How many participants does a study need?  Panels are drawn from simulated observers who differ from one another.

The twins are touched once for each condition and finger temperature; observers then answer from what was felt there,
so that hundreds of people cost no more touches than a few.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from itouch.plugin.discovery import Catalog
from itouch.schema import ItouchError
from itouch_tools.study import orders
from itouch_tools.study import statistics as stats
from itouch_tools.study.observer_catalog import observer_of
from itouch_tools.study.observers import Felt, Observer, Person
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.tasks import is_right
from itouch_tools.study.touches import Presented, TouchRunner
from itouch_tools.study.trials import Trial

#: Finger temperatures [degC] at which the twins are touched: the mean, and one standard deviation to both sides, of the
#: 32 people of Bhattacharjee et al. 2021; a simulated person feels what the nearest of them felt.
FINGERS = (25.7, 28.5, 31.3)
#: Touches of each condition at each finger temperature, which differ by the noise of the twins.
TOUCHES = 2

#: Tasks for which power can be computed.
POWERED = ("identify", "colder", "odd", "same")


class PowerError(ItouchError):
    """A study whose power can't be computed in this way."""


class Touches(Protocol):
    """Makes touches; see `TouchRunner`."""

    def touch(self, condition: Mapping[str, str], seed: int) -> Presented:
        """Return a touch."""


@dataclass(frozen=True, slots=True)
class Power:
    """What a panel would find.

    ``half_width`` is that of the 95 % interval of the proportion right; ``equivalence`` holds, for each pair of levels
    of a factor that is not asked for, the power of the test of equivalence (margin 10 %), as these observers answer.
    """

    panel: int
    repetitions: int
    proportion: float
    half_width: float
    equivalence: Mapping[str, float]


def library(
    file: StudyFile, made: Callable[[float], Touches], *, told: Callable[[float, str], None] = lambda done, words: None
) -> list[dict[str, list[Felt]]]:  # fmt: skip
    """Return what is felt: for each of `FINGERS` the touches of each condition, by the condition's repr.

    ``made`` returns what makes touches with a finger of a temperature [K]; ``told`` is told the progress: the
    share that is done, 0 to 1, and words.

    Raises
    ------
    PowerError
        If the study is adaptive, or has no right answers.
    """
    check_powered(file)
    found: list[dict[str, list[Felt]]] = []
    conditions = _touched(file)
    for number, celsius in enumerate(FINGERS, 1):
        touches = made(celsius + 273.15)
        felt: dict[str, list[Felt]] = {}
        for place, condition in enumerate(conditions, 1):
            felt[repr(condition)] = [touches.touch(condition, seed).felt for seed in range(TOUCHES)]
            share = (number - 1 + place / len(conditions)) / len(FINGERS)
            told(share, f"condition {place} of {len(conditions)} with finger {number} of {len(FINGERS)}")
        found.append(felt)
    return found


def touch_runner(file: StudyFile, catalog: Catalog) -> Callable[[float], Touches]:
    """Return a function that returns what makes touches on the twins with a finger of a temperature [K]."""
    return lambda kelvin: TouchRunner(file, catalog, skin_temperature=kelvin)


def power(
    file: StudyFile, felt: Sequence[Mapping[str, Sequence[Felt]]], panels: Sequence[int], *, model: str = "flux",
    repetitions: Sequence[int] = (), pool: int = 240, studies: int = 400, seed: int = 1,
) -> list[Power]:  # fmt: skip
    """Return the power of each panel size and number of repetitions.

    Parameters
    ----------
    file
        The study.
    felt
        What is felt, as `library` returns it.
    panels
        Numbers of participants.
    model
        Name of the observers' model.
    repetitions
        Numbers of repetitions of each condition; default: the study's.
    pool
        How many people are simulated; panels are drawn from them.
    studies
        How many panels are drawn for each number of participants.
    seed
        Seed of people and panels.

    Raises
    ------
    PowerError
        If the study is adaptive, or has no right answers.
    """
    check_powered(file)
    found = []
    for count in repetitions or (file.study.order.repetitions,):
        shares = [_shares(file, felt, model, count, orders.generator(seed, f"pool{n}")) for n in range(pool)]
        rng = orders.generator(seed, "panels", str(count))
        found += [_panel(file, np.array(shares), size, count, studies, rng) for size in panels]
    return found


def check_powered(file: StudyFile) -> None:
    """Check that the power of a study can be computed.

    Raises
    ------
    PowerError
        If the study is adaptive, or has no right answers.
    """
    if file.study.staircases or file.study.task.kind not in POWERED:
        other = "this one has staircases, ratings or a plugin's task"
        raise PowerError(f"power needs a study with conditions and right answers: {other}")
    if not _judged(file):
        raise PowerError(
            f"power needs a study with right answers: this one shows the standard alone, {file.study.task.standard}"
        )


def _judged(file: StudyFile) -> list[dict[str, str]]:
    """Return the conditions whose answers can be right: the standard beside itself has no colder and no odd one."""
    task = file.study.task
    alone = task.kind in ("colder", "odd")
    return [one for one in file.conditions() if not alone or one[task.factor] != task.standard]


def _touched(file: StudyFile) -> list[dict[str, str]]:
    """Return all that is touched in the conditions: each of them, and the standard beside it."""
    task, found = file.study.task, file.conditions()
    beside = [] if task.kind == "identify" else [{**one, task.factor: task.standard} for one in found]
    return list({repr(one): one for one in [*found, *beside]}.values())


def _shares(
    file: StudyFile, felt: Sequence[Mapping[str, Sequence[Felt]]], model: str, count: int, rng: np.random.Generator
) -> list[float]:  # fmt: skip
    """Return one person's proportion right in each condition that has a right answer."""
    task = file.study.task
    levels = next((factor.names for factor in file.study.factors if factor.name == task.factor), ())
    person = Person.drawn(rng, biased=model == "naive", answers=levels)
    nearest = int(np.argmin([abs(person.finger_temperature - 273.15 - each) for each in FINGERS]))
    observer, known = observer_of(model)(person), felt[nearest]
    return [
        sum(_answer(file, observer, known, condition, rng) for _ in range(count)) / count for condition in _judged(file)
    ]


def _answer(
    file: StudyFile, observer: Observer, felt: Mapping[str, Sequence[Felt]], condition: dict[str, str],
    rng: np.random.Generator,
) -> int:  # fmt: skip
    """Run one trial of a condition; return 1 if it was answered rightly, else 0."""
    task = file.study.task

    def one(shown: dict[str, str]) -> Felt:
        each = felt[repr(shown)]
        return each[int(rng.integers(len(each)))]

    if task.kind == "identify":
        levels = next(factor.names for factor in file.study.factors if factor.name == task.factor)
        known = {level: felt[key][0] for level in levels if (key := repr({**condition, task.factor: level})) in felt}
        return int(observer.identify(one(condition), known, rng) == condition[task.factor])
    target = int(rng.integers(task.intervals))
    standard = {**condition, task.factor: task.standard}
    shown = tuple(condition if index == target else standard for index in range(task.intervals))
    touches = [one(each) for each in shown]
    trial = Trial(0, "main", condition, shown, target)
    answers = {"colder": observer.colder, "odd": observer.odd, "same": observer.same}[task.kind](touches, rng)
    written = ("same" if answers else "different") if task.kind == "same" else str(answers)
    return is_right(task, trial, written, [each.mean_flux() for each in touches]) or 0


def _panel(
    file: StudyFile, shares: NDArray[np.float64], size: int, count: int, studies: int, rng: np.random.Generator
) -> Power:  # fmt: skip
    """Draw panels from the pool's proportions right, shape (people, conditions), and return what they would find."""
    picks = rng.integers(0, len(shares), (studies, size))
    means = shares.mean(axis=1)[picks]  # (studies, size)
    error = means.std(axis=1, ddof=1) / math.sqrt(size) if size > 1 else np.full(studies, math.nan)
    reach = float(_student(size - 1)) if size > 1 else math.nan
    equal = {name: float(np.mean([_equivalent(pairs[pick]) for pick in picks])) for name, pairs in _pairs(file, shares)}
    return Power(size, count, float(shares.mean()), float(np.mean(error) * reach), equal)


def _student(freedom: int) -> Any:
    from scipy.stats import t

    return t.ppf(0.975, freedom)


def _equivalent(pairs: NDArray[np.float64]) -> bool:
    return len(pairs) > 1 and bool(stats.clustered_tost(pairs[:, 0], pairs[:, 1], margin=0.1).p < 0.05)


def _pairs(file: StudyFile, shares: NDArray[np.float64]) -> list[tuple[str, NDArray[np.float64]]]:
    """Return pairs of levels of factors that are not asked for, with people's proportions right, shape (people, 2)."""
    conditions, found = _judged(file), []
    for factor in file.study.factors:
        if factor.name == file.study.task.factor:
            continue
        for i, first in enumerate(factor.names):
            for second in factor.names[i + 1 :]:
                places = [
                    [k for k, each in enumerate(conditions) if each[factor.name] == level] for level in (first, second)
                ]
                if not all(places):
                    continue  # a level that is excluded, or is shown with the standard alone
                columns = [shares[:, place].mean(axis=1) for place in places]
                found.append((f"{factor.name}: {first}, {second}", np.column_stack(columns)))
    return found
