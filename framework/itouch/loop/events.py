"""Contact events: delivered to logs and modalities within the tick, in declared order, and remembered in State."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from itouch.loop import interpreter
from itouch.loop.fault_attribution import foreign_write, modality_fault, with_replaced
from itouch.loop.rig import ProbeRig
from itouch.loop.write_access import Fence
from itouch.plugin import Contact, ContactEvent, Record
from itouch.world import ModalityModel, Model
from itouch.world.state import EVENTS


class Events:
    """Takes each event of a tick to all who hear it."""

    def __init__(self, model: Model, state: Record, rigs: Sequence[ProbeRig], views: Mapping[str, Record]) -> None:
        self._model, self._rigs = model, rigs
        self._modalities = [(one, views[one.name], Fence([one], state)) for one in model.modalities]
        self._table, self._count = state["events.table"], state["events.count"]
        self._probe_index = {probe.name: probe.index for probe in model.probes}
        #: Whether any modality wants an event a tick while a contact lasts.
        self.moves = any(Contact.MOVE in one.instance.hears for one in model.modalities)

    def update(self, tick: int, ready: bool) -> None:
        """Deliver what has happened at every probe in this tick."""
        for rig in self._rigs:
            rig.toucher.events(tick, self.tell, self.moves)

    def tell(self, event: ContactEvent) -> None:
        """Deliver an event; a log hears a contact begin before the modalities, and end after them."""
        if event.kind is not Contact.MOVE:
            self._remember(event)
            if event.kind is Contact.BEGIN:
                self._log(event)
        for one, view, fence in self._modalities:
            if event.kind in one.instance.hears:
                self._tell(event, one, view, fence)
        if event.kind is Contact.END:
            self._log(event)

    def left_out(self, seconds: float, tick: int) -> None:
        """Let modalities know that so many seconds [s] were left out before a tick.

        Raises
        ------
        DeviceFaultError
            If one fails, or writes what is not its own.
        """
        for one, view, fence in self._modalities:
            self._call(one, fence, "left_out", tick, partial(one.instance.left_out, one.model, view, seconds))

    def _tell(self, event: ContactEvent, one: ModalityModel, view: Record, fence: Fence) -> None:
        self._call(one, fence, "on_contact", event.tick, partial(one.instance.on_contact, event, one.model, view))

    def _call(self, one: ModalityModel, fence: Fence, method: str, tick: int, call: Callable[[], None]) -> None:
        """Call a method of a modality; what it raises, or writes elsewhere, is a fault."""
        fence.take()
        try:
            call()
        except KeyboardInterrupt as interrupted:  # Ctrl-C; whoever it was, it is told where it came
            interrupted.add_note(f"in {method} of modality '{one.name}'")
            raise
        except BaseException as error:  # a plugin that exits does not end the program
            replaced = interpreter.put_back()  # first: all else needs it
            fault = modality_fault(self._model, one.instance, method, tick, error)
            raise with_replaced(fault, replaced) from error
        finally:
            changed = fence.mend()
        if changed:
            raise foreign_write(self._model, [one], changed, tick)

    def _remember(self, event: ContactEvent) -> None:
        count = int(self._count)
        self._table[count % EVENTS] = (
            event.kind, event.tick, self._probe_index[event.probe], event.object_index, *event[5:],
        )  # fmt: skip
        self._count[...] = count + 1

    def _log(self, event: ContactEvent) -> None:
        for rig in self._rigs:
            if rig.probe.name == event.probe:
                rig.log.hear(event)
