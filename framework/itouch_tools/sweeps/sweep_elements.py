"""The language of sweeps, with the same declarations, messages and units as that of scenes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.schema.fields import child, children, choice, integer, name, quantity, text
from itouch.schema.quantities import LONGEST
from itouch.schema.terminal import number_of
from itouch_tools.study.study_elements import split_levels, split_values

#: Version of the sweep language that this program reads.
VERSION = "1.0"
#: How the values of a field of State over time become one number.
REDUCTIONS = ("last", "mean", "min", "max", "rms", "integral", "above")
#: Most levels of one grid, and most draws.
MOST_LEVELS, MOST_DRAWS = 100_000, 100_000_000


@dataclass(frozen=True, slots=True)
class Grid:
    """A parameter with levels; all combinations of all grids and lists are run."""

    TAG: ClassVar[str] = "grid"
    EXCLUSIVE: ClassVar[tuple[tuple[str, ...], ...]] = (("values", "low"), ("values", "high"), ("values", "steps"))
    TOGETHER: ClassVar[tuple[tuple[str, ...], ...]] = (("low", "high", "steps"),)
    ONE_OF: ClassVar[tuple[tuple[str, ...], ...]] = (("values", "low"),)
    name: str = name(doc="name of the parameter and of its column")
    set_: str = text(doc="attributes that take the level: NAME.attribute or NAME/child.attribute, separated by spaces")
    values: str = text(default="", doc="the levels, separated by spaces or by ;")
    low: float | None = quantity("", default=None, doc="first of evenly spaced levels")
    high: float | None = quantity("", default=None, doc="last of evenly spaced levels")
    steps: int | None = integer(low=2, high=MOST_LEVELS, default=None, doc="how many evenly spaced levels")
    scale: str = choice("linear", "log", default="linear", doc="how low to high is divided")
    unit: str = text(default="", doc="unit that is written after each level")

    def __post_init__(self) -> None:
        if self.values and len(set(split_levels(self.values))) != len(split_levels(self.values)):
            raise ValueError(f"the levels of '{self.name}' must differ")
        _check_span(self.name, self.low, self.high, self.scale)


@dataclass(frozen=True, slots=True)
class Set:
    """The values that one or several attributes take at the levels of the list."""

    TAG: ClassVar[str] = "set"
    path: str = text(doc="NAME.attribute or NAME/child.attribute; several separated by spaces")
    values: str = text(doc="one per level, separated by spaces or by ;")


@dataclass(frozen=True, slots=True)
class Note:
    """A number that belongs to each level and sets nothing, such as a price: a column of its own."""

    TAG: ClassVar[str] = "note"
    name: str = name(doc="name of its column")
    values: str = text(doc="one per level, separated by spaces or by ;")


@dataclass(frozen=True, slots=True)
class Listed:
    """Attributes that change together, such as all figures of one module."""

    TAG: ClassVar[str] = "list"
    name: str = name(doc="name of the parameter and of its column")
    levels: str = text(doc="names of the levels, separated by spaces or by ;")
    sets: tuple[Set, ...] = children(Set)
    notes: tuple[Note, ...] = children(Note)

    def __post_init__(self) -> None:
        count = len(split_levels(self.levels))
        if not count or len(set(split_levels(self.levels))) != count:
            raise ValueError(f"the levels of '{self.name}' must be one or more different words")
        for one in self.sets:
            if (values := len(split_values(one.values, count))) != count:
                many = f"{number_of(count, 'level')}, and {number_of(values, 'value')}"
                raise ValueError(f"'{self.name}' has {many} of '{one.path}'; separate values that have blanks by ;")
        for note in self.notes:
            if len(split_levels(note.values)) != count:
                many = f"{number_of(count, 'level')}, and {number_of(len(split_levels(note.values)), 'value')}"
                raise ValueError(f"'{self.name}' has {many} of '{note.name}'")
            for word in split_levels(note.values):
                float(word)


@dataclass(frozen=True, slots=True)
class Over:
    """A parameter that is drawn: from low to high, around a mean, or one of some values."""

    TAG: ClassVar[str] = "over"
    EXCLUSIVE: ClassVar[tuple[tuple[str, ...], ...]] = (("values", "low"), ("values", "high"), ("values", "mean"))
    TOGETHER: ClassVar[tuple[tuple[str, ...], ...]] = (("low", "high"), ("mean", "deviation"))
    name: str = name(doc="name of the parameter and of its column")
    set_: str = text(doc="attributes that take the value: NAME.attribute or NAME/child.attribute, separated by spaces")
    low: float | None = quantity("", default=None, doc="smallest value")
    high: float | None = quantity("", default=None, doc="largest value")
    mean: float | None = quantity("", default=None, doc="mean of a normal distribution, which low and high truncate")
    deviation: float | None = quantity("", positive=True, default=None, doc="standard deviation of that distribution")
    scale: str = choice("linear", "log", default="linear", doc="what is spread evenly: the value or its logarithm")
    values: str = text(default="", doc="equally probable words, separated by spaces or by ;")
    unit: str = text(default="", doc="unit that is written after the value")

    def __post_init__(self) -> None:
        if not self.values and self.low is None and self.mean is None:
            raise ValueError(f"'{self.name}' needs low and high, mean and deviation, or values")
        if self.mean is not None and self.scale == "log":
            raise ValueError(f"'{self.name}': a normal distribution has no log scale")
        _check_span(self.name, self.low, self.high, self.scale)


@dataclass(frozen=True, slots=True)
class Draws:
    """Points that are drawn; each is run with all combinations of grids and lists."""

    TAG: ClassVar[str] = "draws"
    kind: str = choice("random", "latin", "sobol", doc="independent, Latin hypercube, or scrambled Sobol sequence")
    count: int = integer(
        low=1, high=MOST_DRAWS, doc="number of points; more can be drawn later, and those that exist stay"
    )
    block: int | None = integer(
        low=1,
        high=MOST_LEVELS,
        default=None,
        doc="points of one Latin hypercube; default: all. Further points are then added as whole hypercubes",
    )
    over: tuple[Over, ...] = children(Over)

    def __post_init__(self) -> None:
        if not self.over:
            raise ValueError("there is nothing to draw: write <over .../> inside")
        if self.block is not None and self.kind != "latin":
            raise ValueError(f"block is that of Latin hypercubes, not of '{self.kind}'")
        if self.kind == "latin" and self.block is None and self.count > MOST_LEVELS:
            raise ValueError(f"a Latin hypercube of more than {MOST_LEVELS} points needs a block")


@dataclass(frozen=True, slots=True)
class Seeds:
    """How often each point is run, each time with another seed of the session's noise."""

    TAG: ClassVar[str] = "seeds"
    count: int = integer(low=1, high=MOST_DRAWS, default=1, doc="number of seeds")
    first: int = integer(low=0, high=2**31, default=0, doc="the first; the others follow it")


@dataclass(frozen=True, slots=True)
class Until:
    """A field of State that ends a run."""

    TAG: ClassVar[str] = "until"
    ONE_OF: ClassVar[tuple[tuple[str, ...], ...]] = (("above", "below"),)
    field: str = text(doc="a field of State, such as NAME.command.current")
    index: int = integer(low=0, high=10**6, default=0, doc="which number of the field, if it has several")
    above: float | None = quantity("", default=None, doc="ends when it is more than this, in SI")
    below: float | None = quantity("", default=None, doc="ends when it is less than this, in SI")


@dataclass(frozen=True, slots=True)
class RunRule:
    """When a run ends; the default is the end of the scripted motion."""

    TAG: ClassVar[str] = "run"
    for_: float | None = quantity("s", positive=True, high=LONGEST, default=None, doc="simulated time")
    patience: float = quantity(
        "s", low=1.0, high=1e6, default=600.0, doc="runs that take longer on the clock are ended"
    )
    until: tuple[Until, ...] = children(Until)


@dataclass(frozen=True, slots=True)
class FromReport:
    """A key of the session's report."""

    TAG: ClassVar[str] = "report"
    name: str = name(doc="name of its column")
    key: str = text(doc="such as contacts[0].flux_error_rms, contacts[object=wood].skin_drop_K or contacts[*].plate_s")
    reduce: str = choice("mean", "min", "max", "sum", "count", default="mean", doc="for [*]: how the values become one")
    type_: str = choice("number", "text", default="number", doc="type of the value")


@dataclass(frozen=True, slots=True)
class FromField:
    """A field of State, reduced over time."""

    TAG: ClassVar[str] = "field"
    name: str = name(doc="name of its column")
    of: str = text(doc="the field's name, such as NAME.command.current")
    reduce: str = choice(*REDUCTIONS, default="mean", doc="`above`: seconds above `level`; `integral`: over time")
    index: int = integer(low=0, high=10**6, default=0, doc="which number of the field, if it has several")
    level: float = quantity("", default=0.0, doc="for `above`, in SI")
    begin: float = quantity("s", low=0.0, high=LONGEST, default=0.0, doc="simulated time from which it counts")
    end: float | None = quantity(
        "s", positive=True, high=LONGEST, default=None, doc="simulated time to which it counts"
    )


@dataclass(frozen=True, slots=True)
class FromCall:
    """What a function returns: of a plugin, or in a Python file beside the sweep, which travels with it."""

    TAG: ClassVar[str] = "call"
    name: str = name(doc="name of its column, or prefix of the columns of its results")
    function: str = text(doc="package.module:function, or file.py:function")
    when: str = choice(
        "end", "begin", default="end", doc="end: called with the session that has ended; begin: called with it before "
        "its first tick, and what it returns is called at the end",
    )  # fmt: skip
    results: str = text(default="", doc="names in the mapping that it returns, separated by spaces; default: one value")
    type_: str = choice("number", "text", default="number", doc="what it returns")

    def __post_init__(self) -> None:
        if self.function.count(":") != 1 or not all(self.function.split(":")):
            raise ValueError("function is package.module:function, or file.py:function")

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns."""
        return tuple(f"{self.name}_{result}" for result in self.results.split()) or (self.name,)


@dataclass(frozen=True, slots=True)
class Collect:
    """What is kept of a run, besides its parameters, seed, end and digests."""

    TAG: ClassVar[str] = "collect"
    results: tuple[FromReport | FromField | FromCall, ...] = children((FromReport, FromField, FromCall))


@dataclass(frozen=True, slots=True)
class StopCriterion:
    """A stop criterion: the sweep ends when the mean of a result is known well enough: its 95 % interval is short."""

    TAG: ClassVar[str] = "enough"
    result: str = text(doc="the column of the result")
    half_width: float = quantity("", positive=True, doc="half of the width of the interval")
    at_least: int = integer(low=2, high=MOST_DRAWS, default=30, doc="number of runs before it may end")


@dataclass(frozen=True, slots=True)
class Stop:
    """When the sweep ends before all runs are done; it can go on from there."""

    TAG: ClassVar[str] = "stop"
    after: float | None = quantity("s", positive=True, default=None, doc="time on the clock")
    failures: int | None = integer(low=1, high=MOST_DRAWS, default=None, doc="runs that were not `done`")
    enough: tuple[StopCriterion, ...] = children(StopCriterion)


@dataclass(frozen=True, slots=True)
class Sweep:
    """Very many runs: of which scene or study, with which parameters and seeds, and what is kept of each."""

    TAG: ClassVar[str] = "sweep"
    ONE_OF: ClassVar[tuple[tuple[str, ...], ...]] = (("scene", "study"),)
    version: str = text(doc="version of the sweep language")
    scene: str = text(default="", doc="the scene, relative to this file")
    study: str = text(default="", doc="a study, whose conditions are levels; relative to this file")
    seed: int = integer(low=0, high=2**53, default=0, doc="seed of what is drawn")
    name: str = text(default="", doc="name of the sweep; default: that of the file")
    seeds: Seeds = child(Seeds, default=Seeds())
    run: RunRule = child(RunRule, default=RunRule())
    draws: Draws | None = child(Draws, default=None)
    collect: Collect = child(Collect, default=None)  # the reader refuses a sweep without
    stop: Stop = child(Stop, default=Stop())
    axes: tuple[Grid | Listed, ...] = children((Grid, Listed))


def _check_span(name: str, low: float | None, high: float | None, scale: str) -> None:
    if low is None or high is None:
        return
    if low >= high:
        raise ValueError(f"'{name}': low must be less than high")
    if scale == "log" and low <= 0.0:
        raise ValueError(f"'{name}': a log scale begins above 0")
