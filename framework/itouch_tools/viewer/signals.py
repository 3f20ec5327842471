"""Which numbers of State are plotted over the last seconds, and the ring buffer that remembers them.

A chart has the curves of one title and one unit.  What is plotted, and where, follows from the declarations of State's
fields: see ``show`` of `itouch.plugin.Quantity`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Field, Record, Role
from itouch.world import Model, declared
from itouch_tools.viewer.colours import CURVES, Colour
from itouch_tools.viewer.scales import ORDER, Scale, scale_of

#: Seconds that a chart shows.
WINDOW = 10.0
#: Spans of time shorter than this [s] are not marked in a chart.
GLANCE = 0.2
#: A channel with more numbers than this is plotted only if its quantity asks for it.
_MOST = 8
#: Roles that are drawn in the scene, or that only say yes or no: plotted only if their quantity asks for it.
_SILENT = frozenset({
    Role.TRACKED_POSE, Role.TRACKED_TWIST, Role.CONTACT_FORCE, Role.FORCE_ON_OPERATOR, Role.SURFACE_POSE, Role.DEADMAN,
    Role.SKIN_VALID, Role.OUTPUT_SWITCH, Role.HEAT_SINK_TEMPERATURE,
})  # fmt: skip


@dataclass(frozen=True, slots=True)
class Signal:
    """One curve: its label, how it is read in the chart's unit, and its meaning in a sentence (``doc``)."""

    label: str
    colour: Colour
    read: Callable[[Record], float]
    #: Whether it is a desired value, not a measured one.
    dashed: bool = False
    doc: str = ""
    #: For a reading that is measured only at times: whether this curve shows the value held in between; else None.
    held: bool | None = None


@dataclass(frozen=True, slots=True)
class Chart:
    """Curves that share a unit and an axis."""

    title: str
    unit: str
    signals: tuple[Signal, ...]
    #: Least height of the axis, so that noise is not magnified.
    least: float
    #: Format of its values.
    digits: str


class Curves(Protocol):
    """What remembers the signals of charts, for a running session or a recording."""

    charts: tuple[Chart, ...]

    def add(self, state: Record) -> None:
        """Add the values of a State."""

    def curves(self, chart: Chart) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the times [s], shape (n,), and the values, shape (signals, n), of the last seconds, oldest first."""

    def preparing(self) -> list[tuple[float, float]]:
        """Return the spans [s], in the last seconds, in which the rig was not ready: it found its heights by touch."""


@dataclass(frozen=True, slots=True)
class _Drawn:
    """A field of State that is plotted: its owner, its chart's title, and whether it is a desired value (a wish)."""

    owner: str
    field: Field
    title: str
    wish: bool
    #: The label of its curve; empty: made from the field's name.
    called: str = ""
    #: The flag of State that says whether it is being measured, or held; empty: there is none.
    valid: str = ""


def charts(model: Model, *, page: bool = False) -> tuple[Chart, ...]:
    """Return the charts of a model, one for each title and unit; with ``page`` also what only the page shows."""
    scales: dict[tuple[str, str], tuple[Scale, list[_Drawn]]] = {}
    for drawn in _drawn(model, page):
        scale = scale_of(drawn.field.unit)
        title = drawn.title or scale.title
        scales.setdefault((title, scale.unit), (scale, []))[1].append(drawn)
    made = []
    for (title, unit), (scale, found) in sorted(scales.items(), key=lambda item: _order(item[1][1][0])):
        signals = tuple(_signals(title, scale, _own(model, found)))
        made.append(Chart(title, unit, signals, scale.least, scale.digits))
    return tuple(made)


def _drawn(model: Model, page: bool) -> Iterator[_Drawn]:
    """Yield what is plotted: first of the probes, then of modalities, then of devices."""
    owners = [*(probe.name for probe in model.probes), *(m.name for m in model.modalities), *model.devices]
    plugins = {f"{device}.twin." for device in model.devices} | {f"{m.name}." for m in model.modalities}
    read = {f"{d.name}.{c.name}" for d in model.devices.values() for c in d.reads}
    sent = {f"{d.name}.sent.{c.name}" for d in model.devices.values() for c in d.commands}
    everything = declared(model)
    valid = {d.name: d.field(Role.SKIN_VALID) for d in model.devices.values()}
    for owner in owners:
        for name, field in everything.items():
            if not name.startswith(f"{owner}.") or field.show == "no" or np.dtype(field.dtype).kind not in "fiu":
                continue
            shown, _, called = (part.strip() for part in field.show.partition("|"))
            word, colon, title = shown.partition(":")
            if colon and word == "page" and not page:
                continue
            channel = name in read or name in sent
            asked = bool(field.show) or (channel and field.role not in _SILENT and _count(field) <= _MOST)
            alone = any(name.startswith(prefix) for prefix in plugins) and _count(field) == 1 and bool(field.shown_unit)
            if (asked or alone) and field.unit:
                flag = valid.get(owner, "") if field.role is Role.SKIN_TEMPERATURE and channel else ""
                shown = title.strip() if colon else shown
                yield _Drawn(owner, field, shown, word == "wish" and bool(colon), called, flag)


def _order(first: _Drawn) -> tuple[bool, int]:
    """Return the key that sorts charts: by unit, units not in the table last; after them those of the page only."""
    unit = first.field.unit
    return first.field.show.startswith("page"), ORDER.index(unit) if unit in ORDER else len(ORDER)


def _count(field: Field) -> int:
    return int(np.prod(field.size, dtype=int)) if field.size else 1


def _own(model: Model, found: list[_Drawn]) -> list[_Drawn]:
    """Leave out the wishes of a modality that is named in a parameter of another, which passes them on as its own."""
    given: set[object] = set()
    for part in model.scene.modalities:
        given |= {getattr(part.params, field.name) for field in fields(part.params)}
    left = [drawn for drawn in found if not (drawn.wish and drawn.owner in given)]
    return left if any(drawn.wish for drawn in left) else found


def _signals(title: str, scale: Scale, found: list[_Drawn]) -> Iterator[Signal]:
    labels = [_label(title, drawn) for drawn in found]
    index = 0
    for drawn, label in zip(found, labels, strict=True):
        if not label or labels.count(label) > 1:
            label = f"{drawn.owner} {label}".strip()
        for part, read in _readers(drawn.field, scale):
            colour, words = CURVES[index % len(CURVES)], f"{label} {part}".strip()
            if drawn.valid:
                yield Signal(words, colour, _while(drawn.valid, True, read), drawn.wish, drawn.field.doc, held=False)
                held = f"{drawn.field.doc}: the last value that was measured, as it can't be measured now"
                yield Signal(
                    f"{words}, held", colour, _while(drawn.valid, False, read), dashed=True, doc=held, held=True
                )
            else:
                yield Signal(words, colour, read, drawn.wish, drawn.field.doc)
            index += 1


def _while(valid: str, holds: bool, read: Callable[[Record], float]) -> Callable[[Record], float]:
    """Return a reader that reads only while a flag of State is ``holds``, and else gives NaN."""
    return lambda state: read(state) if bool(np.ravel(state[valid])[0]) is holds else math.nan


def _label(title: str, drawn: _Drawn) -> str:
    """Return the label of a field's curve: the one that it declares, else the words of its name not in the title."""
    if drawn.called:
        return drawn.called
    short = drawn.field.name.removeprefix(f"{drawn.owner}.").removeprefix("sent.").removeprefix("twin.")
    words = short.replace(".", "_").split("_")
    return " ".join(word for word in words if word not in title.split())


def _readers(field: Field, scale: Scale) -> Iterator[tuple[str, Callable[[Record], float]]]:
    """Yield labels and readers of a field's numbers: of a vector of three its length, else each number."""
    name, count = field.name, _count(field)
    if count == 3:
        yield "", lambda state: scale.shown(float(np.linalg.norm(state[name])))
        return
    for index in range(count):
        part = str(index) if count > 1 else ""
        yield part, lambda state, index=index: scale.shown(float(np.ravel(state[name])[index]))  # type: ignore[misc]


def rows_of(charts_: tuple[Chart, ...], chart: Chart) -> slice:
    """Return the rows of a chart's signals among those of all charts."""
    first = 0
    for other in charts_:
        if other is chart:
            break
        first += len(other.signals)
    return slice(first, first + len(chart.signals))


class Ring:
    """Remembers the signals of the last ``WINDOW`` seconds at ``rate`` Hz."""

    def __init__(self, model: Model, *, rate: float = 100.0) -> None:
        self.charts = charts(model)
        self._period, self._step = model.period, max(1, round(1.0 / (rate * model.period)))
        size = round(WINDOW / (self._step * model.period)) + 1
        self._signals = [signal for chart in self.charts for signal in chart.signals]
        self._values = np.full((len(self._signals), size), np.nan)
        self._ready = np.ones(size, bool)
        self._ticks = np.full(size, -1, np.int64)
        self._count, self._next = 0, 0

    def add(self, state: Record) -> None:
        """Take a sample, if one is due; a tick earlier than the last sample's starts the ring anew."""
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
        self._ready[at] = bool(state["ready"])
        self._count += 1

    def curves(self, chart: Chart) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the times [s], shape (n,), and the values, shape (signals, n), oldest first."""
        order = self._order()
        times = np.asarray(self._ticks[order] * self._period, np.float64)
        return recent(times, self._values[rows_of(self.charts, chart)][:, order])

    def preparing(self) -> list[tuple[float, float]]:
        """Return from when to when [s] the rig was not ready."""
        order = self._order()
        return spans(np.asarray(self._ticks[order] * self._period, np.float64), self._ready[order])

    def _order(self) -> NDArray[np.int64]:
        """Return the places of the samples in the ring, oldest first."""
        size = len(self._ticks)
        kept = min(self._count, size)
        return (self._count - kept + np.arange(kept)) % size


def spans(times: NDArray[np.float64], ready: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return the spans [s] in the last ``WINDOW`` in which something was not ready, without those up to ``GLANCE``.

    ``times`` (n,) [s], ``ready`` (n,).
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[1], ready.astype(np.int8), [1]])))
    found = []
    for first, end in edges.reshape(-1, 2):
        begin, last = float(times[first]), float(times[min(end, len(times) - 1)])
        begin = max(begin, float(times[-1]) - WINDOW)
        if last - begin > GLANCE:
            found.append((begin, last))
    return found


def recent(times: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the samples of the last ``WINDOW`` seconds; at its beginning they are interpolated.

    Parameters
    ----------
    times, values
        As ``Curves.curves`` returns them: (n,) [s] and (signals, n), each signal in its unit.
    """
    if not len(times) or times[0] >= times[-1] - WINDOW:
        return times, values
    edge = times[-1] - WINDOW
    first = int(np.searchsorted(times, edge))
    part = (edge - times[first - 1]) / (times[first] - times[first - 1])
    cut = values[:, first - 1] + part * (values[:, first] - values[:, first - 1])
    return np.append(edge, times[first:]), np.column_stack([cut, values[:, first:]])
