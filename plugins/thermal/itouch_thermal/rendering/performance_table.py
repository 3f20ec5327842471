"""The display's promised performance, measured row by row; ``itouch-py bench display --table`` prints it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from contact_heat.layers import ROOM
from contact_heat.resistance import DEFAULT_RESISTANCE
from itouch_thermal.display.params import DisplayParams, Mismatch
from itouch_thermal.flux.limits import BAND, RATE, RATE_OVER
from itouch_thermal.heat import ThermalMaterial
from itouch_thermal.rendering.bound import bound
from itouch_thermal.rendering.closedloop import (
    PERIOD,
    Case,
    Course,
    Run,
    desired_course,
    simulate,
    start_for,
)
from itouch_thermal.rendering.materials import FOAM, material
from itouch_thermal.rendering.plants import SEEDS, corners
from itouch_thermal.rendering.score import summary
from itouch_thermal.rendering.switch_times import least_time_of_plant, switching_time

#: Contact resistances [K m2/W], time constant of pressing [s]; object temperatures [K] besides that of the room.
USUAL, LITTLE, PRESS = DEFAULT_RESISTANCE, 1e-4, 0.05
COLD, HOT = 289.15, 311.15
#: Object temperatures [K] that the plate cannot render.
OUTSIDE = (278.15, 318.15)

Material = tuple[str, ThermalMaterial]


class Line(NamedTuple):
    """A measured figure: the case, the figure's name, value and limit, and the material or plant that is worst."""

    case: str
    figure: str
    value: float
    limit: float | None
    worst: str

    @property
    def holds(self) -> bool | None:
        """Whether the limit is kept; None if there is none."""
        return None if self.limit is None else self.value <= self.limit


@dataclass(slots=True)
class Extremes:
    """Extremes of plate temperature, current, pumped flux and plate rate over all runs."""

    low: float = np.inf
    high: float = -np.inf
    current: float = 0.0
    flux: float = 0.0
    rate: float = 0.0

    def take(self, run: Run) -> None:
        """Include a run."""
        over = round(RATE_OVER / PERIOD)
        self.low, self.high = min(self.low, float(run.plate.min())), max(self.high, float(run.plate.max()))
        self.current = max(self.current, float(np.abs(run.current).max()))
        self.flux = max(self.flux, float(np.abs(run.pump).max()))
        if len(run.plate) > over:
            moved = float(np.abs(run.plate[over:] - run.plate[:-over]).max())
            self.rate = max(self.rate, moved / RATE_OVER)


@dataclass(frozen=True, slots=True)
class Table:
    """The rows over materials; ``quick`` takes four corners, one seed and one object temperature."""

    materials: Sequence[Material]
    quick: bool = False
    seconds: float = 10.0
    display: DisplayParams = field(default_factory=DisplayParams)
    extremes: Extremes = field(default_factory=Extremes)
    _courses: dict[Case, tuple[Course, float]] = field(default_factory=dict)

    def lines(self) -> Iterator[Line]:
        """Measure all rows, in the order of the promises."""
        temperatures = (ROOM,) if self.quick else (COLD, ROOM, HOT)
        yield from self._rendering("worst", self.worst(), temperatures, USUAL, (0.8, 3.0), (1.5, 0.8, 6.0, 2.5))
        yield from self._nominal(temperatures)
        yield from self._gain()
        yield from self._rendering("R 1e-4, worst", self.worst(), (ROOM,), LITTLE, (0.5, None), (1.5, None, None, None))
        yield from self._press()
        for stream, dense, foam in ((1, 1.0, 1.6), (20, 1.2, 2.5)):
            name = f"50 Hz, flux at {1000 // stream} Hz, worst"
            limits = (dense, None), (foam, None, None, None)
            yield from self._rendering(name, self.worst(), (ROOM,), USUAL, *limits, hold=20, stream=stream)
        yield from self._skin()
        yield from self._switch()
        yield from self._limits()
        yield from self._paper()

    def worst(self, *, exact_finger: bool = False) -> list[tuple[DisplayParams, int]]:
        """Return the corners with their seeds."""
        listed = corners(exact_finger=exact_finger)
        listed, seeds = (listed[1::4], SEEDS[:1]) if self.quick else (listed, SEEDS)
        return [(replace(self.display, mismatch=off), seed) for off in listed for seed in seeds]

    def nominal(self, off: Mismatch | None = None) -> list[tuple[DisplayParams, int]]:
        """Return the plant of the data sheets, or one with a mismatch, with its seeds."""
        plant = replace(self.display, mismatch=off or Mismatch())
        return [(plant, seed) for seed in (SEEDS[:1] if self.quick else SEEDS)]

    def runs(
        self, case: Case, plants: Sequence[tuple[DisplayParams, int]], controller: str = "model", *, hold: int = 1,
        stream: int = 1,
    ) -> list[Run]:  # fmt: skip
        """Run a case on several plants."""
        key = replace(case, press_off=1.0)
        if key not in self._courses:
            course = desired_course(case)
            self._courses[key] = course, start_for(case, course, self.display)
        course, start = self._courses[key]
        found = [
            simulate(
                case, course, plant, controller, believed=self.display, seed=seed, hold=hold, stream=stream,
                start=start if controller == "model" else None,
            )
            for plant, seed in plants
        ]  # fmt: skip
        for run in found:
            self.extremes.take(run)
        return found

    def _case(self, what: ThermalMaterial, temperature: float = ROOM, resistance: float = USUAL) -> Case:
        return Case(what, temperature, resistance=resistance, seconds=self.seconds)

    def _within(self, case: Case, plants: Sequence[tuple[DisplayParams, int]]) -> bool:
        """Tell whether the plate's band and rate allow the case to be rendered on the plants."""
        course = desired_course(case)
        return bound(case, course, self.display, [plant.mismatch for plant, _ in plants]).limited is None

    def _rendering(
        self, name: str, plants: Sequence[tuple[DisplayParams, int]], temperatures: Sequence[float], resistance: float,
        dense: tuple[float | None, ...], foam: tuple[float | None, ...], *, hold: int = 1, stream: int = 1,
    ) -> Iterator[Line]:  # fmt: skip
        """Measure dense materials (rms, >0.3 s) and foams (rms, median, >0.3 s, >1 s)."""
        keys = "rms_pct", "rms_pct_median", "max_after_300ms_pct", "max_after_1s_pct"
        for group, wanted, limits in (("dense", (0, 2), dense), ("foam", (0, 1, 2, 3), foam)):
            rows = []
            for label, what in self.materials:
                if (what.effusivity >= FOAM) != (group == "dense"):
                    continue
                for temperature in temperatures:
                    case = self._case(what, temperature, resistance)
                    if self._within(case, plants):
                        row = summary(self.runs(case, plants, hold=hold, stream=stream))
                        rows.append((f"{label}, {temperature - 273.15:.0f} degC", row))
            for which, limit in zip(wanted, limits, strict=True):
                if rows:
                    place, row = max(rows, key=lambda item: item[1][keys[which]])
                    yield Line(f"{group}, {name}", keys[which], row[keys[which]], limit, place)

    def _nominal(self, temperatures: Sequence[float]) -> Iterator[Line]:
        worst = (-np.inf, "")
        for label, what in self.materials:
            for temperature in temperatures:
                case = self._case(what, temperature)
                best = bound(case, desired_course(case), self.display)
                if best.limited is None:
                    over = summary(self.runs(case, self.nominal()))["rms_pct"] - best.rms_pct
                    worst = max(worst, (over, f"{label}, {temperature - 273.15:.0f} degC"))
        yield Line("nominal, noise on", "rms_pct over the bound", worst[0], 0.3, worst[1])

    def _gain(self) -> Iterator[Line]:
        dense = [m for m in self.materials if m[1].effusivity >= FOAM]
        rows = [
            (summary(self.runs(self._case(what), self.nominal(Mismatch(flux_gain=off))))["rms_pct"], label)
            for label, what in dense
            for off in (-0.01, 0.01)
        ]
        yield Line("flux sensor gain +-1 %, dense", "rms_pct", *self._greatest(rows, 1.5))
        rows = [
            (summary(self.runs(self._case(what), self.nominal(Mismatch(contact_area=off))))["rms_pct"], label)
            for label, what in dense
            for off in (-0.2, 0.2)
        ]
        yield Line("contact area +-20 %, dense", "rms_pct", *self._greatest(rows, None))

    @staticmethod
    def _greatest(rows: Sequence[tuple[float, str]], limit: float | None) -> tuple[float, float | None, str]:
        value, label = max(rows)
        return value, limit, label

    def _press(self) -> Iterator[Line]:
        for off in (0.8, 1.2):
            rows = [(self._pressed(what, off, "model"), label) for label, what in self.materials]
            yield Line(f"press ramp, time constant x {off:g}", "rms_pct", *self._greatest(rows, 3.0))
        for off in (0.5, 2.0):
            name = f"press ramp, time constant x {off:g}"
            ours, theirs = (
                [(self._pressed(what, off, controller), label) for label, what in self.materials]
                for controller in ("model", "paper")
            )
            yield Line(name, "rms_pct; limit: that of paper", *self._greatest(ours, max(theirs)[0]))
            each = [(a / b, label) for (a, label), (b, _) in zip(ours, theirs, strict=True)]
            yield Line(name, "rms over that of paper, each material", *self._greatest(each, None))

    def _pressed(self, what: ThermalMaterial, off: float, controller: str) -> float:
        case = replace(self._case(what), press=PRESS, press_off=off)
        return summary(self.runs(case, self.nominal(), controller))["rms_pct"]

    def _skin(self) -> Iterator[Line]:
        keys = "skin_error_max_K", "skin_error_max_after_300ms_K", "skin_error_max_after_1s_K"
        exact = self.worst(exact_finger=True)
        for name, plants, limits in (
            ("skin, nominal", self.nominal(), (0.12, 0.02, None)),
            ("skin, worst with the finger exact", exact, (0.22, 0.1, 0.05)),
        ):
            rows = [(label, summary(self.runs(self._case(m), plants))) for label, m in self.materials]
            for key, limit in zip(keys, limits, strict=True):
                yield Line(name, key, *self._greatest([(row[key], label) for label, row in rows], limit))

    def _switch(self) -> Iterator[Line]:
        """Measure switches between aluminium and polystyrene, both ways."""
        (one, first), (other, second) = material("aluminium"), material("polystyrene")
        ends = [start_for(case, desired_course(case), self.display) for case in map(self._case, (first, second))]
        for name, plants, share in (("nominal", self.nominal(), 1.1), ("worst", self.worst(), 1.25)):
            for (begin, end), label in (((ends[0], ends[1]), f"{one} to {other}"), ((ends[1], ends[0]), "back")):
                least = {plant.mismatch: least_time_of_plant(plant, begin, end) for plant, _ in plants}
                rows = [
                    ((switching_time(plant, begin, end, seed=seed) - 0.02) / least[plant.mismatch], label)
                    for plant, seed in plants
                ]
                times = f"{label}; least {min(least.values()):.3f} to {max(least.values()):.3f} s"
                yield Line(
                    f"switch, {name}", "(time - 20 ms) over the physical minimum",
                    max(value for value, _ in rows), share, times,
                )  # fmt: skip

    def _limits(self) -> Iterator[Line]:
        """Measure the extremes of all runs, including objects out of range."""
        metal = material("aluminium")[1]
        for temperature in OUTSIDE:
            for controller in ("model", "paper", "hold"):
                self.runs(self._case(metal, temperature), self.nominal()[:1], controller)
        found, where = self.extremes, "any run"
        yield Line("limits", "plate below 15 degC [K]", max(0.0, BAND[0] - found.low), 0.0, where)
        yield Line("limits", "plate above 40 degC [K]", max(0.0, found.high - BAND[1]), 0.0, where)
        yield Line("limits", "greatest current [A]", found.current, self.display.max_current, where)
        yield Line("limits", "greatest flux asked [W/m2]", found.flux, self.display.flux_limit, where)
        yield Line("limits", "greatest plate rate, 0.5 s [K/s]", found.rate, RATE, where)

    def _paper(self) -> Iterator[Line]:
        for resistance in (USUAL, LITTLE):
            rows = [
                (summary(self.runs(self._case(m, resistance=resistance), self.nominal(), "paper"))["rms_pct"], label)
                for label, m in self.materials
            ]
            yield Line(f"paper, nominal, R {resistance:g}", "rms_pct", *self._greatest(rows, None))
