"""Problems of a sweep: columns, paths, fields and functions that do not exist, and levels that no scene accepts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from itouch.plugin.discovery import Catalog
from itouch.schema.diagnostics import Problem, did_you_mean
from itouch.world import Model, make_state, survey
from itouch_tools.sweeps import report_paths
from itouch_tools.sweeps.functions import FunctionError, check_function
from itouch_tools.sweeps.run_plan import Setting, written
from itouch_tools.sweeps.sampling import value_of
from itouch_tools.sweeps.sweep_elements import FromCall, FromField, FromReport, Listed, Until

if TYPE_CHECKING:
    from itouch.plugin import Record
    from itouch_tools.sweeps.sweepfile import SweepFile

#: Columns that every row has.
OWN = ("seed", "status", "reason", "simulated_s", "digest", "state", "cpu", "sets", "part")
#: Most runs of one sweep.
MOST_RUNS = 10**10


def columns(result: FromReport | FromField | FromCall) -> tuple[str, ...]:
    """Return the columns of one result."""
    return result.columns if isinstance(result, FromCall) else (result.name,)


def contradictions(file: SweepFile) -> Iterator[Problem]:
    """Yield the problems that can be found without the scene."""
    sweep, places = file.sweep, file.places
    drawn = () if sweep.draws is None else sweep.draws.over
    owners: list[tuple[Any, tuple[str, ...]]] = [(each, (each.name,)) for each in (*sweep.axes, *drawn)]
    owners += [(note, (note.name,)) for axis in sweep.axes if isinstance(axis, Listed) for note in axis.notes]
    owners += [(each, columns(each)) for each in sweep.collect.results]
    seen: dict[str, Any] = dict.fromkeys(() if file.study is None else (f.name for f in file.study.study.factors))
    for owner, names in owners:
        for name in names:
            if name in OWN:
                advice = f"every row has {', '.join(OWN)}: choose another name"
                yield Problem("duplicate-name", f"'{name}' is a column of every row", places.of(owner, "name"), advice)
            elif name in seen:
                first = places.of(seen[name], "name") if seen[name] is not None else None
                related = ((first, "first here"),) if first else ()
                yield Problem("duplicate-name", f"'{name}' is defined twice", places.of(owner, "name"), "rename one",
                              related)  # fmt: skip
            seen[name] = owner
    for result in sweep.collect.results:
        if isinstance(result, FromReport):
            try:
                report_paths.split(result.key)
            except ValueError as error:
                yield Problem("bad-value", str(error), places.of(result, "key"))
        elif isinstance(result, FromField):
            yield from _never_counted(result, file)
    numbers = [name for each in sweep.collect.results if getattr(each, "type_", "number") == "number"
               for name in columns(each)]  # fmt: skip
    for one in sweep.stop.enough:
        if one.result not in numbers:
            advice = did_you_mean(one.result, numbers, "numbers are")
            yield Problem("unknown-name", f"there is no number named '{one.result}'", places.of(one, "result"), advice)
    if sweep.draws is None and not sweep.axes and sweep.seeds.count < 2 and file.study is None:
        place, advice = places.of(sweep), "write <grid>, <list>, <draws> or <seeds>"
        yield Problem("missing-element", "<sweep> varies nothing", place, advice)
    elif len(file.plan()) > MOST_RUNS:
        yield Problem("out-of-range", f"these are more than {MOST_RUNS:.0e} runs", places.of(sweep), "leave some out")


def _never_counted(result: FromField, file: SweepFile) -> Iterator[Problem]:
    """Yield a warning if a field is reduced over a time that no run has: its column would be empty."""
    over, places = file.sweep.run.for_, file.places
    if result.end is not None and result.end <= result.begin:
        sentence = f"'{result.name}' counts to {result.end:g} s, and only from {result.begin:g} s on: it would be empty"
        yield Problem("bad-value", sentence, places.of(result, "end"), "end later, or begin earlier", (), "warning")
    elif over is not None and result.begin >= over:
        sentence = f"'{result.name}' counts from {result.begin:g} s on, and runs end at {over:g} s: it would be empty"
        yield Problem("bad-value", sentence, places.of(result, "begin"), "begin earlier, or run longer", (), "warning")


def scenes(file: SweepFile, catalog: Catalog) -> Iterator[Problem]:
    """Yield the problems of the scene, of each level in it, and of what is collected from it."""
    told: set[str] = set()
    base: Model | None = None
    for sets, shown in _each_level_once(file):
        scene, found = file.scene(sets, catalog)
        compiled = survey(scene, catalog, found)
        model = compiled.model
        for problem in (*found, *compiled.problems):
            if problem.severity == "error" and problem.sentence not in told:
                told.add(problem.sentence)
                yield replace(problem, sentence=f"{problem.sentence} (with {shown})") if shown else problem
        base = base or model
    if base is not None and not told:
        yield from _collected(file, base)


def _each_level_once(file: SweepFile) -> Iterator[tuple[list[Setting], str]]:
    """Yield settings that together contain every level and both ends of what is drawn, each with a description."""
    axes, plan = file.plan().axes, file.plan()
    ends = [_drawn(file, u) for u in ((0.0, 1.0 - 2.0**-20) if plan.over else (0.5,))]
    count = max([len(axis.levels) for axis in axes] + [len(ends)] + [_words(file)])
    for index in range(count):
        levels = [axis.levels[index % len(axis.levels)] for axis in axes]
        drawn = ends[index % len(ends)] if index < len(ends) or not plan.over else _drawn(file, index / count)
        names = [f"{name}={value}" for axis, level in zip(axes, levels, strict=True)
                 for name, value in zip(axis.names, level.values, strict=True)]  # fmt: skip
        shown = ", ".join(names + [f"{path}={value}" for path, value in drawn])
        yield [pair for level in levels for pair in level.sets] + drawn, shown


def _words(file: SweepFile) -> int:
    from itouch_tools.study.study_elements import split_levels

    drawn = () if file.sweep.draws is None else file.sweep.draws.over
    return max([len(split_levels(one.values)) for one in drawn if one.values], default=1)


def _drawn(file: SweepFile, u: float) -> list[Setting]:
    drawn = () if file.sweep.draws is None else file.sweep.draws.over
    return [(path, written(value_of(one, u), one.unit)) for one in drawn for path in one.set_.split()]


def _collected(file: SweepFile, model: Model) -> Iterator[Problem]:
    """Yield the problems of what ends a run and of what is collected: missing fields of State, missing functions."""
    sweep, places, state = file.sweep, file.places, make_state(model)
    if sweep.run.for_ is None and not sweep.run.until and not any(
        probe.operator is not None or probe.recorded is not None for probe in model.probes
    ):  # fmt: skip
        advice = 'write <run for="8 s"/>'
        yield Problem("missing-element", "the scene has no scripted motion whose end would end a run",
                      places.of(sweep), advice)  # fmt: skip
    for until in sweep.run.until:
        yield from _field(until.field, until.index, state, file, until, "field")
    for result in sweep.collect.results:
        if isinstance(result, FromField):
            yield from _field(result.of, result.index, state, file, result, "of")
        elif isinstance(result, FromCall):
            try:
                check_function(result.function, file.path)
            except FunctionError as error:
                yield Problem("unknown-name", str(error), places.of(result, "function"), error.advice)


def _field(
    name: str, index: int, state: Record, file: SweepFile, owner: FromField | Until, attribute: str
) -> Iterator[Problem]:
    place = file.places.of(owner, attribute)
    if name not in state:
        names: Sequence[str] = state.dtype.names or ()
        advice = did_you_mean(name, names, "its fields are")
        yield Problem("unknown-name", f"State has no field '{name}'", place, advice)
        return
    values = state[name]
    if values.dtype.names is not None or values.dtype.kind not in "fiub":
        yield Problem("bad-value", f"the field '{name}' holds no plain numbers", place)
    elif index >= values.size:
        yield Problem("out-of-range", f"'{name}' has {values.size} numbers: 0 to {values.size - 1}",
                      file.places.of(owner, "index") or place)  # fmt: skip
