"""Log of each contact from BEGIN to END, for the report's table; the figures of an open contact are in State."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.loop import contact_report, render
from itouch.loop.contact_report import ContactFigures
from itouch.loop.device_runner import Runner
from itouch.loop.event_detection import BEGIN
from itouch.loop.run_statistics import RunStatistics
from itouch.loop.surface.surface_memory import MISSED, RENDERS, SETTLED, WITHDRAWN
from itouch.loop.touch import ContactStep
from itouch.plugin import Bound, ContactArrays, Modality, Record
from itouch.plugin.write_protection import WriteProtectedRecord
from itouch.twin.finger_coupling import Coupling
from itouch.world import Model


class _Entry(NamedTuple):
    """State fields of the open contact from which its entry is made, of one number each.

    The object, and the tick in which the contact began; whether the plate was there, for how many ticks, and whether it
    was missed; how far its top was below the surface [m], NaN: unknown; greatest force [N], depth [m] and area [m2],
    the speed of the impact [m/s], and the tick in which the plate was touched first.
    """

    object: Any
    begin: Any
    plate: Any
    plate_ticks: Any
    plate_missed: Any
    plate_gap: Any
    peak_force: Any
    peak_penetration: Any
    peak_area: Any
    impact_speed: Any
    physical_begin: Any

    @classmethod
    def of(cls, state: Record, probe: str) -> _Entry:
        """Return the views of State."""
        return cls(*(state[f"{probe}.contact.{field}"] for field in cls._fields))


class _OpenContact(NamedTuple):
    """What is seen of the open contact in a tick, of shape (1,) but ``figures`` and ``memory``.

    The object, -1: none; the force on the finger [N]; the tick in which the plate was touched first, negative: not yet;
    height of the plate's top [m], whether what touches the finger is the plate, and its true force [N], 0 if none is
    known.  ``figures`` (FIGURES,), see `render`; ``memory`` (MEMORY,): that of the carried surface.
    """

    object: Any
    total: Any
    touched: Any
    top: Any
    plate: Any
    push: Any
    figures: Any
    memory: Any


@kernel
def _note(now: _OpenContact, entry: _Entry, worst: Any) -> int:
    """Update the figures of the open contact by one tick; return 0.

    ``worst`` (1,): the greatest error of the plate's height so far [m]; written.
    """
    if now.object[0] < 0:
        return 0
    figures, memory = now.figures, now.memory
    if now.total[0] > entry.peak_force[0]:  # false if it is not a number
        entry.peak_force[0] = now.total[0]
    if figures[render.PENETRATION] > entry.peak_penetration[0]:
        entry.peak_penetration[0] = figures[render.PENETRATION]
    if figures[render.AREA] > entry.peak_area[0]:
        entry.peak_area[0] = figures[render.AREA]
    if entry.physical_begin[0] < 0 and now.touched[0] >= 0:
        entry.physical_begin[0] = now.touched[0]
    if now.plate[0] != 0 or now.push[0] > 0.0:
        entry.plate[0] = 1
        entry.plate_ticks[0] += 1
    if memory[MISSED] == WITHDRAWN:
        entry.plate_missed[0] |= 2
    elif memory[MISSED] > 0.0:
        entry.plate_missed[0] |= 1
    if now.plate[0] != 0 and memory[RENDERS] > 0.0 and memory[SETTLED] > 0.0:
        error = abs(figures[render.SURFACE_HEIGHT] - now.top[0])
        if error > worst[0]:
            worst[0] = error
    return 0


class EntryInputs(NamedTuple):
    """What an entry is made of: the contact's fields of State, and all of State, from which modalities measure.

    ``numbers`` is those fields as one structured array: they are read in one go, because code that has not run for
    seconds is slow by what it touches.
    """

    entry: _Entry
    numbers: NDArray[Any]
    seen: Record


@kernel
def _begin(entry: Any, plate: Any, touched: Any, figures: Any, known: Any, event: Any) -> int:
    """Begin an entry if the event is BEGIN; return 0.

    ``plate`` and ``touched`` (1,): whether the plate is there, and the tick in which it was touched first; ``known``
    (1,): height of its top [m], or (0,): there is no plate; ``event`` is the `ContactArrays`.
    """
    if event.kind[0] != BEGIN:
        return 0
    entry.plate[0] = plate[0]
    entry.plate_ticks[0] = entry.plate_missed[0] = 0
    entry.plate_gap[0] = np.nan
    if known.shape[0] > 0 and math.isfinite(figures[render.SURFACE_HEIGHT]):
        entry.plate_gap[0] = (figures[render.SURFACE_HEIGHT] - known[0]) * event.normal[2]
    entry.peak_force[0] = entry.peak_penetration[0] = entry.peak_area[0] = 0.0
    entry.impact_speed[0] = event.speed[0]
    entry.physical_begin[0] = touched[0]
    return 0


class ContactLog:
    """Writes the report's entry of each contact of one probe."""

    def __init__(
        self,
        model: Model,
        contact_step: ContactStep,
        table: Runner | None,
        coupling: Coupling,
        state: Record,
        statistics: RunStatistics,
    ) -> None:
        self._model, self._contact_step, self._table = model, contact_step, table
        self._coupling, self._statistics = coupling, statistics
        name = contact_step.probe.name
        self._now = self.kept(state, WriteProtectedRecord(state, ()))
        entry = self._now.entry
        figures = contact_step.figures
        known = coupling.true_top if table is not None and table.model.twin else figures[render.PLATE_TOP :][:1]
        #: Follows the open contact; called at the end of each tick.
        now = _OpenContact(
            contact_step.current, coupling.total, coupling.touched, known, contact_step.plate,
            state[f"{name}.plate_force"], figures, contact_step.surface,
        )  # fmt: skip
        self.note = Bound(_note, now, entry, statistics.worst_height)
        self.note.warm_up()
        self._top = known if table is not None else np.zeros(0)
        #: The keys of an entry beside the framework's own with null, as where nothing measures them; of each object its
        #: name and its material's; the modalities that measure anything.
        declared = (one.key for modality in model.modalities for one in modality.instance.measured)
        self._blank = dict.fromkeys(key for key in (*_ALWAYS, *declared) if key not in ContactFigures.__annotations__)
        self._touched = [(element.name, element.material) for element in model.scene.objects]
        self._measuring = [one for one in model.modalities if _measured(one.instance)]

    def begins(self, event: ContactArrays) -> Bound:
        """Return the call that begins an entry if ``event``, whose numbers are written later, is a BEGIN."""
        contact_step, touched = self._contact_step, self._coupling.touched
        return Bound(_begin, self._now.entry, contact_step.plate, touched, contact_step.figures, self._top, event)

    def end(self, tick: int) -> None:
        """End the entry of the open contact."""
        self._statistics.contacts.append(self.entry(tick))

    def making(self, tick: int, then: EntryInputs) -> Iterator[bool]:
        """Add the entry of a contact that has ended at a tick, from State as it was then, part by part.

        Yield True while parts are to come: after the framework's own, and after each modality's but the last one.
        """
        entry = self._own(tick, then)
        for modality in self._measuring:
            yield True
            contact_report.enter(entry, modality, then.seen, entry["probe"], then.entry.object.item())
        self._statistics.closed.append(entry)

    def kept(self, state: Record, seen: Record) -> EntryInputs:
        """Return what an entry is made of, from a record like State; ``seen`` is its write-protected view."""
        name = self._contact_step.probe.name
        numbers = np.asarray(state)[[f"{name}.contact.{field}" for field in _Entry._fields]]
        return EntryInputs(_Entry.of(state, name), numbers, seen)

    def _slid(self, met: float) -> bool:
        """Tell whether the finger met the plate, at ``met`` [s], before this contact: it slid from object to object."""
        name = self._contact_step.probe.name
        for before in reversed(self._statistics.closed):
            if before["probe"] == name:
                return before["end_s"] is not None and bool(met < before["end_s"] - 0.5 * self._model.period)
        return False

    @property
    def open(self) -> bool:
        """Whether a contact is open."""
        return int(self._contact_step.current) >= 0

    def entry(self, end: int | None) -> dict[str, Any]:
        """Return the report's entry of the open contact, which ends at a tick or, if that is None, is still open."""
        entry = self._own(end, self._now)
        for modality in self._measuring:
            contact_report.enter(entry, modality, self._now.seen, entry["probe"], self._now.entry.object.item())
        return entry

    def _own(self, end: int | None, kept: EntryInputs) -> dict[str, Any]:
        """Return the framework's part of an entry; what modalities measure is null."""
        name, period = self._contact_step.probe.name, self._model.period
        index, begin, plate, ticks, missed, gap, force, depth, area, speed, physical = kept.numbers.item()
        carried = self._table is not None
        led = physical >= 0 and plate and not self._slid(physical * period)
        own: ContactFigures = {
            "probe": name,
            "object": self._touched[index][0],
            "material": self._touched[index][1],
            "begin_s": begin * period,
            "end_s": None if end is None else end * period,
            "plate": bool(plate),
            "plate_s": ticks * period if carried else None,
            "plate_missed": bool(missed & 1) if carried else None,
            "plate_withdrawn": bool(missed & 2) if carried else None,
            "peak_force_N": force,
            "peak_penetration_mm": depth * 1e3,
            "peak_area_mm2": area * 1e6,
            "impact_speed_m_s": speed,
            "plate_gap_mm": gap * 1e3 if math.isfinite(gap * 1e3) else None,
            "plate_lead_ms": (begin - physical) * period * 1e3 if led else None,
        }
        return {**own, **self._blank}


#: Keys that every entry has had since the first version of the report, null where nothing measures them.  Programs that
#: read reports rely on them; to take them from the plugin that declares them, it would have to be loaded even where no
#: scene uses it.  What is shown, and how, is never taken from here.
_ALWAYS = ("flux_source", "mean_flux_W_m2", "peak_flux_W_m2", "skin_drop_K", "flux_error_rms")


def _measured(instance: Modality) -> bool:
    """Tell whether a modality measures anything: it, or its class, overrides ``measures``."""
    return getattr(instance.measures, "__func__", None) is not Modality.measures
