"""A sweep as it was read, and the plan of its runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from itouch.plugin.discovery import Catalog
from itouch.scene import Scene
from itouch.scene.edits import Edit
from itouch.scene.loader import read_scene
from itouch.scene.places import Places
from itouch.scene.source import Attribute
from itouch.schema.diagnostics import Place, Problem
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.study_elements import split_levels, split_values
from itouch_tools.sweeps.run_plan import Axis, Level, Plan, Setting, Value, written
from itouch_tools.sweeps.sampling import Points, spaced
from itouch_tools.sweeps.sweep_elements import Grid, Listed, Sweep


@dataclass(frozen=True, slots=True)
class SweepFile:
    """A sweep as it was read: its file, the scene's path, the place of each element, and the study if there is one."""

    sweep: Sweep
    path: str
    scene_path: str
    places: Places
    study: StudyFile | None = None

    @property
    def name(self) -> str:
        """Name of the sweep."""
        return self.sweep.name or Path(self.path).stem

    def plan(self, base: str = "") -> Plan:
        """Return the plan of all runs; ``base`` is the digest of what they have in common."""
        sweep, draws = self.sweep, self.sweep.draws
        axes = [] if self.study is None else [_conditions(self.study)]
        axes += [_grid(axis) if isinstance(axis, Grid) else _listed(axis) for axis in sweep.axes]
        points = None if draws is None else Points(draws, sweep.seed)
        return Plan(
            axes, () if draws is None else draws.over, points, sweep.seeds.count, sweep.seeds.first, base
        )  # fmt: skip

    def scene(self, sets: Sequence[Setting], catalog: Catalog) -> tuple[Scene, list[Problem]]:
        """Return the scene with attributes set, and its problems, each at the place of the parameter that causes it."""
        edits = [Edit(p, Attribute(v, self._place(p))) for p, v in sets]
        return read_scene(self.scene_path, catalog, edits=edits, place=self.places.of(self.sweep, "scene"))

    def _place(self, path: str) -> Place:
        draws = () if self.sweep.draws is None else self.sweep.draws.over
        inner = [one for axis in self.sweep.axes if isinstance(axis, Listed) for one in axis.sets]
        for element in (*self.sweep.axes, *draws):
            if path in getattr(element, "set_", "").split():
                return self.places.of(element, "set_") or Place(self.path, 1, 1)
        for one in inner:
            if path in one.path.split():
                return self.places.of(one, "path") or Place(self.path, 1, 1)
        return Place(self.path, 1, 1)


def _grid(grid: Grid) -> Axis:
    return Axis((grid.name,), tuple(
        Level((value,), tuple((path, written(value, grid.unit)) for path in grid.set_.split()))
        for value in _levels(grid)
    ))  # fmt: skip


def _levels(grid: Grid) -> Sequence[Value]:
    """Return the levels: numbers if all of them are numbers, else words."""
    if grid.low is not None and grid.high is not None and grid.steps is not None:
        return spaced(grid.low, grid.high, grid.steps, grid.scale)
    words = split_levels(grid.values)
    try:
        return [float(word) for word in words]
    except ValueError:
        return words


def _listed(one: Listed) -> Axis:
    found = []
    names = split_levels(one.levels)
    for index, level in enumerate(names):
        sets = [(path, split_values(each.values, len(names))[index]) for each in one.sets for path in each.path.split()]
        notes = [float(split_levels(note.values)[index]) for note in one.notes]
        found.append(Level((level, *notes), tuple(sets)))
    return Axis((one.name, *(note.name for note in one.notes)), tuple(found))


def _conditions(study: StudyFile) -> Axis:
    names = tuple(factor.name for factor in study.study.factors)
    found = []
    for condition in study.conditions():
        sets = tuple((edit.path, edit.value.value) for edit in study.edits(condition))
        found.append(Level(tuple(condition[name] for name in names), sets))
    return Axis(names, tuple(found))
