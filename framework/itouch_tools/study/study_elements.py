"""The elements of a study's file: factors, tasks, orders, practice, catch trials, breaks, blinding."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

from itouch.schema.fields import child, children, choice, flag, integer, name, quantity, text
from itouch.schema.terminal import number_of
from itouch_tools.study.adaptive import Staircase
from itouch_tools.study.plugin_tasks import task_of

#: Version of the study language that this program reads.
VERSION = "1.0"
TASKS = ("identify", "colder", "odd", "same", "rate")
#: Intervals of a trial, by task.
INTERVALS = {"identify": 1, "colder": 2, "odd": 3, "same": 2, "rate": 1}


def split_levels(written: str) -> tuple[str, ...]:
    """Return levels that are separated by ``;`` or, where there is none, by blanks."""
    parts = written.split(";") if ";" in written else written.split()
    return tuple(part.strip() for part in parts if part.strip())


def split_values(written: str, count: int) -> tuple[str, ...]:
    """Return the values of ``count`` levels, as `split_levels` does; a single one may have blanks: ``22 degC``."""
    one = count == 1 and ";" not in written and written.strip()
    return (written.strip(),) if one else split_levels(written)


#: A blank before the next factor's name: a level may have blanks itself.
_BETWEEN_PAIRS = re.compile(r"\s+(?=[A-Za-z][A-Za-z0-9_-]*=)")


def split_pairs(where: str) -> dict[str, str]:
    """Return factor -> level of ``FACTOR=LEVEL`` pairs that are separated by blanks.

    Raises
    ------
    ValueError
        If it is something else, or if a factor has two levels.
    """
    pairs = [pair.split("=", 1) for pair in _BETWEEN_PAIRS.split(where.strip())]
    if any(len(pair) != 2 or not pair[0] or not pair[1] for pair in pairs):
        raise ValueError("where must hold FACTOR=LEVEL pairs, such as 'material=wood source=real'")
    found = {pair[0]: pair[1] for pair in pairs}
    if len(found) < len(pairs):
        raise ValueError("where has two levels of one factor, which are never shown together")
    return found


#: Names of the blocks of trials that do not count: those before the others, and those among them.
PRACTICE, CATCH = "practice", "catch"
UNCOUNTED = frozenset((PRACTICE, CATCH))


@dataclass(frozen=True, slots=True)
class Factor:
    """What is varied: one attribute of the scene, or several together."""

    TAG: ClassVar[str] = "factor"
    name: str = name(doc="name of the factor in the data")
    levels: str = text(doc="its levels, separated by spaces or by ;")
    set_: str = text(doc="attributes of the scene that take the level: NAME.attribute, separated by spaces")
    values: str = text(default="", doc="what the attributes take at each level, separated by ;; default: the levels")

    def __post_init__(self) -> None:
        found = self.names
        if not found or len(set(found)) != len(found):
            raise ValueError(f"the levels of '{self.name}' must be one or more different words")
        if self.values and len(self.taken) != len(found):
            levels, values = number_of(len(found), "level"), number_of(len(self.taken), "value")
            raise ValueError(f"'{self.name}' has {levels} and {values}; separate values that have blanks by ;")

    @property
    def names(self) -> tuple[str, ...]:
        """The levels."""
        return split_levels(self.levels)

    @property
    def taken(self) -> tuple[str, ...]:
        """The values of the attributes at each level."""
        return split_values(self.values, len(self.names)) if self.values else self.names


@dataclass(frozen=True, slots=True)
class Exclude:
    """A combination that is not shown."""

    TAG: ClassVar[str] = "exclude"
    where: str = text(doc="FACTOR=LEVEL pairs separated by spaces; all of them together are left out")

    @property
    def pairs(self) -> dict[str, str]:
        """Factor -> level."""
        return split_pairs(self.where)

    def __post_init__(self) -> None:
        split_pairs(self.where)


@dataclass(frozen=True, slots=True)
class Task:
    """What is asked."""

    TAG: ClassVar[str] = "task"
    kind: str = text(doc="identify (one of n), colder, odd, same (or different), rate, or the name of a plugin's task")
    factor: str = text(doc="the factor whose levels are told apart")
    standard: str = text(default="", doc="the level that the others are compared with; for colder, odd and same")
    question: str = text(default="", doc="what the participant reads")

    @property
    def intervals(self) -> int:
        """How many touches a trial has."""
        return INTERVALS[self.kind] if self.kind in INTERVALS else task_of(self.kind).intervals

    def __post_init__(self) -> None:
        if self.kind in ("colder", "odd", "same") and not self.standard:
            raise ValueError(f"'{self.kind}' compares with a standard: say which level of '{self.factor}' that is")


@dataclass(frozen=True, slots=True)
class Order:
    """In which order the conditions come."""

    TAG: ClassVar[str] = "order"
    kind: str = choice(
        "random", "latin", "williams", "blocked", "fixed", default="random", doc="how the conditions are ordered"
    )
    repetitions: int = integer(low=1, high=10_000, default=10, doc="how often each condition comes")
    most_equal: int = integer(
        low=1, high=100, default=2, doc="for random: at most so many equal levels of the task's factor in a row"
    )
    by: str = text(default="", doc="for blocked: the factor whose levels make the blocks")

    def __post_init__(self) -> None:
        if (self.kind == "blocked") != bool(self.by):
            raise ValueError("blocked needs by=, the factor whose levels make the blocks; no other kind takes by=")


@dataclass(frozen=True, slots=True)
class Practice:
    """Trials before the first that counts."""

    TAG: ClassVar[str] = "practice"
    trials: int = integer(low=1, high=1000, doc="how many")
    feedback: bool = flag(default=True, doc="say after each trial whether the answer was right")


@dataclass(frozen=True, slots=True)
class CatchTrials:
    """Trials among the others whose answer is plain, to see that somebody attends; they do not count."""

    TAG: ClassVar[str] = "catch"
    trials: int = integer(low=1, high=1000, doc="how many, at random places")
    where: str = text(doc="FACTOR=LEVEL pairs separated by spaces, one of each factor: what is shown")

    @property
    def condition(self) -> dict[str, str]:
        """Factor -> level."""
        return split_pairs(self.where)

    def __post_init__(self) -> None:
        split_pairs(self.where)


@dataclass(frozen=True, slots=True)
class Breaks:
    """Rest."""

    TAG: ClassVar[str] = "breaks"
    every: int = integer(low=1, high=10_000, doc="trials between two breaks")
    duration: float = quantity("s", low=0.0, high=3600.0, default=60.0, doc="shortest duration of a break")


@dataclass(frozen=True, slots=True)
class Touching:
    """Rules of a touch; a trial that breaks one is void and repeated."""

    TAG: ClassVar[str] = "contact"
    object_: str = text(doc="the object that is touched")
    duration: float = quantity("s", low=0.1, high=60.0, default=3.0, doc="shortest touch")
    force: float | None = quantity("N", low=0.05, high=10.0, default=None, doc="desired greatest force; default: any")
    tolerance: float = quantity(
        "N", low=0.01, high=10.0, default=0.3, doc="how far the force may be from the desired one"
    )
    flux_error: float = quantity("1", low=0.01, high=10.0, default=0.2, doc="largest rms error of the display")
    repeats: int = integer(low=0, high=100, default=3, doc="how often a void trial is repeated at most")
    skin_return: float = quantity("K", low=0.05, high=10.0, default=0.5, doc="how near the baseline the skin must be")
    skin_wait: float = quantity("s", low=0.0, high=3600.0, default=120.0, doc="longest wait for the skin")
    ready_wait: float = quantity("s", low=0.1, high=600.0, default=30.0, doc="longest wait for the plate")
    reach: float = quantity("s", low=0.1, high=600.0, default=15.0, doc="longest time from the signal to the touch")
    pause: float = quantity("s", low=0.0, high=3600.0, default=20.0, doc="time from the answer to the next trial")


@dataclass(frozen=True, slots=True)
class Instructions:
    """What the participant reads before the first trial."""

    TAG: ClassVar[str] = "instructions"
    file: str = text(doc="Markdown in any language, relative to this file: headings, paragraphs, lists")


@dataclass(frozen=True, slots=True)
class Blind:
    """What keeps the condition from participant and operator."""

    TAG: ClassVar[str] = "blind"
    equalise: bool = flag(default=True, doc="the signal comes after the same time for every condition")
    approach: float = quantity("s", low=0.1, high=120.0, default=8.0, doc="that time: longer than any plate needs")
    noise: bool = flag(default=False, doc="masking noise is played from the first trial to the last")


@dataclass(frozen=True, slots=True)
class Adaptive:
    """A staircase on a number that takes the place of a factor: <task kind="colder"> against the standard."""

    TAG: ClassVar[str] = "staircase"
    name: str = name(doc="name of the staircase in the data")
    procedure: str = choice("up-down", "quest", "psi", doc="weighted up-down, QUEST, or psi-marginal")
    set_: str = text(doc="attribute of the scene that takes the level: NAME.attribute")
    unit: str = text(default="", doc="unit that is written after the level")
    low: float = quantity("", doc="lowest level")
    high: float = quantity("", doc="highest level")
    start: float = quantity("", doc="first level, or middle of the prior")
    standard: float = quantity("", doc="level of the standard interval")
    step: float = quantity("", low=0.0, default=0.0, doc="step of the up-down procedure; spacing of QUEST's levels")
    target: float = quantity(
        "", low=0.5, high=0.99, default=0.75, doc="proportion of right answers at which the up-down procedure settles"
    )
    trials: int = integer(low=1, high=10_000, default=40, doc="greatest number of trials")
    reversals: int = integer(
        low=1, high=1000, default=12, doc="number of reversals after which the up-down procedure ends"
    )
    slope: float = quantity("", low=1e-6, default=3.0, doc="slope of QUEST's logistic function")
    prior: float = quantity("", low=1e-6, default=1.0, doc="standard deviation of the threshold's prior")

    def __post_init__(self) -> None:
        self.rule()

    def rule(self) -> Staircase:
        """Return the parameters of the procedure."""
        return Staircase(
            self.procedure, self.low, self.high, self.start, step=self.step, target=self.target,  # type: ignore[arg-type]
            slope=self.slope, prior=self.prior, trials=self.trials, reversals=self.reversals,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Study:
    """A psychophysical study: what is varied, what is asked, in which order, and what counts."""

    TAG: ClassVar[str] = "study"
    version: str = text(doc="version of the study language")
    scene: str = text(doc="the scene, relative to this file")
    seed: int = integer(low=0, high=2**53, doc="seed of all orders")
    task: Task = child(Task, default=None)  # the reader refuses a study without
    contact: Touching = child(Touching, default=None)
    name: str = text(default="", doc="name of the study; default: that of the file")
    order: Order = child(Order, default=Order())
    practice: Practice | None = child(Practice, default=None)
    catch: CatchTrials | None = child(CatchTrials, default=None)
    breaks: Breaks | None = child(Breaks, default=None)
    blind: Blind | None = child(Blind, default=None)
    instructions: Instructions | None = child(Instructions, default=None)
    factors: tuple[Factor, ...] = children(Factor)
    excluded: tuple[Exclude, ...] = children(Exclude)
    staircases: tuple[Adaptive, ...] = children(Adaptive)
