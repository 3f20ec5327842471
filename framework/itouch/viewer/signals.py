"""The curves of the last seconds: which numbers of State are plotted, and a ring that remembers them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.viewer.colours import CURVES, Colour
from itouch.world import Model

#: Seconds that a chart shows.
WINDOW = 10.0
_KELVIN = 273.15


@dataclass(frozen=True, slots=True)
class Signal:
    """One curve: what it is called and how it is read, in the chart's unit."""

    label: str
    colour: Colour
    read: Callable[[Record], float]
    #: A wish, not a measurement.
    dashed: bool = False


@dataclass(frozen=True, slots=True)
class Chart:
    """Curves that share a unit and an axis."""

    title: str
    unit: str
    signals: tuple[Signal, ...]
    #: Least height of the axis, so that noise is not blown up.
    least: float
    #: How its values are written.
    digits: str


class Curves(Protocol):
    """What remembers the signals of charts, of a session that runs or of a recording."""

    charts: tuple[Chart, ...]

    def add(self, state: Record) -> None:
        """Take note of a State."""

    def curves(self, chart: Chart) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the times [s], shape (n,), and the values, shape (signals, n), of the last seconds, oldest first."""


def charts(model: Model) -> tuple[Chart, ...]:
    """Return the charts of a model: force, heat flux, current and temperature, as far as it has them."""
    made = (
        Chart("force", "N", _paint(_forces(model)), 1.0, ".2f"),
        Chart("heat flux out of the finger", "W/m2", _paint(_fluxes(model)), 200.0, ".0f"),
        Chart("current", "A", _paint(_currents(model)), 0.5, ".2f"),
        Chart("temperature", "degC", _paint(_temperatures(model)), 2.0, ".1f"),
    )
    return tuple(chart for chart in made if chart.signals)


_Named = tuple[str, Callable[[Record], float]]


def _paint(found: Iterator[_Named]) -> tuple[Signal, ...]:
    return tuple(Signal(label, CURVES[i % len(CURVES)], read, label.startswith("desired"))
                 for i, (label, read) in enumerate(found))  # fmt: skip


def rows_of(charts_: tuple[Chart, ...], chart: Chart) -> slice:
    """Return where the signals of a chart stand among those of all charts."""
    first = 0
    for other in charts_:
        if other is chart:
            break
        first += len(other.signals)
    return slice(first, first + len(chart.signals))


def _forces(model: Model) -> Iterator[_Named]:
    for probe in model.probes:
        whose = f"{probe.name} " if len(model.probes) > 1 else ""
        key = f"{probe.name}.force"
        yield f"{whose}rendered", _length(key)
        if probe.scene.surface_to:
            plate = f"{probe.name}.plate_force"
            yield f"{whose}on plate", _number(plate)


def _fluxes(model: Model) -> Iterator[_Named]:
    names = _desiring(model)
    for name in names:
        yield "desired" if len(names) == 1 else f"desired ({name})", _number(f"{name}.desired")
    for device in model.devices.values():
        for channel in device.reads:
            if channel.unit == "W/m^2":
                key = f"{device.name}.{channel.name}"
                yield "obtained", _number(key)


def _desiring(model: Model) -> list[str]:
    """Return the modalities whose desired flux is shown; one that another takes its own from is left out."""
    names = [m.name for m in model.modalities if any(f.name == "desired" for f in m.instance.fields(m.model))]
    given = set()
    for part in model.scene.modalities:
        values = [getattr(part.params, field.name) for field in fields(part.params)]
        given |= {value for value in values if isinstance(value, str)}
    return [name for name in names if name not in given] or names


def _currents(model: Model) -> Iterator[_Named]:
    for device in model.devices.values():
        for channel in device.commands:
            if channel.unit == "A":
                key = f"{device.name}.sent.{channel.name}"
                yield f"{device.name}", _number(key)


def _temperatures(model: Model) -> Iterator[_Named]:
    for modality in model.modalities:
        if any(field.name == "skin_temperature" for field in modality.instance.fields(modality.model)):
            key = f"{modality.name}.skin_temperature"
            yield "skin (model)", _celsius(key)
    for device in model.devices.values():
        for channel in device.reads:
            if channel.unit == "K" and channel.size == 1 and "sink" not in channel.name:
                key = f"{device.name}.{channel.name}"
                yield channel.name.removesuffix("_temperature"), _celsius(key)


def _number(key: str) -> Callable[[Record], float]:
    return lambda state: float(np.ravel(state[key])[0])


def _length(key: str) -> Callable[[Record], float]:
    return lambda state: float(np.linalg.norm(state[key]))


def _celsius(key: str) -> Callable[[Record], float]:
    def read(state: Record) -> float:
        kelvin = float(np.ravel(state[key])[0])
        return kelvin - _KELVIN if 200.0 < kelvin < 1000.0 else float("nan")

    return read


class Ring:
    """Remembers the signals of the last ``WINDOW`` seconds at ``rate`` Hz."""

    def __init__(self, model: Model, *, rate: float = 100.0) -> None:
        self.charts = charts(model)
        self._period, self._step = model.period, max(1, round(1.0 / (rate * model.period)))
        size = round(WINDOW / (self._step * model.period)) + 1
        self._signals = [signal for chart in self.charts for signal in chart.signals]
        self._values = np.full((len(self._signals), size), np.nan)
        self._ticks = np.full(size, -1, np.int64)
        self._count, self._next = 0, 0

    def add(self, state: Record) -> None:
        """Take a sample, if one is due; a State of an earlier tick than the last starts anew."""
        tick = int(state["tick"])
        if self._count and tick < self._ticks[(self._count - 1) % len(self._ticks)]:
            self._count, self._next = 0, 0
            self._ticks[:] = -1
        if tick < self._next:
            return
        self._next = tick + self._step
        at = self._count % len(self._ticks)
        self._ticks[at] = tick
        for row, signal in enumerate(self._signals):
            self._values[row, at] = signal.read(state)
        self._count += 1

    def curves(self, chart: Chart) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the times [s], shape (n,), and the values, shape (signals, n), oldest first."""
        size = len(self._ticks)
        kept = min(self._count, size)
        order = (self._count - kept + np.arange(kept)) % size
        times = np.asarray(self._ticks[order] * self._period, np.float64)
        return times, self._values[rows_of(self.charts, chart)][:, order]
