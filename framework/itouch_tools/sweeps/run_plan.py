"""The runs of a sweep: for each number the parameters, what they set in the scene, and the digest of the run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from itouch_tools.sweeps.sampling import DIGITS, Points
from itouch_tools.sweeps.sweep_elements import Over

#: An attribute of the scene and its value: (path, text).
Setting = tuple[str, str]
Value = float | str


@dataclass(frozen=True, slots=True)
class Level:
    """One level of an axis: the values of its columns, and what it sets."""

    values: tuple[Value, ...]
    sets: tuple[Setting, ...]


@dataclass(frozen=True, slots=True)
class Axis:
    """Parameters that change together, level by level; ``names`` are their columns."""

    names: tuple[str, ...]
    levels: tuple[Level, ...]


@dataclass(frozen=True, slots=True)
class Run:
    """One run: its parameters by column, what is set in the scene, the session's seed, and its digest."""

    values: Mapping[str, Value]
    sets: tuple[Setting, ...]
    seed: int
    digest: str


@dataclass(frozen=True, slots=True)
class Plan:
    """All runs: draws outermost, then the axes in the order of the file, then seeds."""

    axes: Sequence[Axis]
    over: Sequence[Over]
    points: Points | None
    seeds: int
    first_seed: int
    base: str = ""

    def __len__(self) -> int:
        return self.structures * self.seeds

    @property
    def structures(self) -> int:
        """How many different scenes there are."""
        count = 1 if self.points is None else len(self.points)
        for axis in self.axes:
            count *= len(axis.levels)
        return count

    def run(self, number: int) -> Run:
        """Return the run with this number."""
        rest, seed = divmod(number, self.seeds)
        chosen: list[Level] = []
        for axis in reversed(self.axes):
            rest, index = divmod(rest, len(axis.levels))
            chosen.append(axis.levels[index])
        values: dict[str, Value] = {}
        sets: list[Setting] = []
        for axis, level in zip(self.axes, reversed(chosen), strict=True):
            values.update(zip(axis.names, level.values, strict=True))
            sets += level.sets
        if self.points is not None:
            for one, value in zip(self.over, self.points.point(rest), strict=True):
                values[one.name] = value
                sets += [(path, written(value, one.unit)) for path in one.set_.split()]
        which = self.first_seed + seed
        return Run(values, tuple(sets), which, digest_of(self.base, sets, which))

    @property
    def columns(self) -> list[str]:
        """Names of the parameters."""
        return [name for axis in self.axes for name in axis.names] + [one.name for one in self.over]


def written(value: Value, unit: str) -> str:
    """Return a value as it is written in a scene."""
    text = value if isinstance(value, str) else f"{value:.{DIGITS}g}"
    return f"{text} {unit}".strip()


def digest_of(base: str, sets: Sequence[Setting], seed: int) -> str:
    """Return the digest of a run: of everything that determines its results."""
    told = json.dumps([base, sorted(sets), seed], separators=(",", ":"))
    return hashlib.sha256(told.encode()).hexdigest()
