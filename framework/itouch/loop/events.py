"""Contact events: delivered to logs and modalities within the tick, in declared order, and remembered in State."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from itouch.joining import is_newest, runner
from itouch.loop import interpreter
from itouch.loop.fault_attribution import foreign_write, modality_fault, with_replaced
from itouch.loop.happening import BEGIN, END, MOVE, silent
from itouch.loop.rig import ProbeRig
from itouch.loop.write_access import Fence
from itouch.plugin import Contact, ContactEvent, Record
from itouch.world import ModalityModel, Model
from itouch.world.plugin_errors import failing

#: What a modality's compiled call has left to Python, and that it has written what is not its own, as a runner says it.
_LEFT, _WRITTEN = 1, 2


class _Listener:
    """A modality that hears of contacts: by a compiled call between those of its fence, or in Python."""

    def __init__(self, model: Model, one: ModalityModel, view: Record, state: Record) -> None:
        self.one, self.view, self.fence = one, view, Fence([one], state)
        self.kinds = frozenset(int(kind) for kind in one.instance.hears)
        self.call: Callable[[], int] | None = None


class Events:
    """Takes each event of a tick to all who hear it."""

    def __init__(self, model: Model, state: Record, rigs: Sequence[ProbeRig], views: Mapping[str, Record]) -> None:
        self._model = model
        #: The numbers of the event that is told.
        self._event = silent()
        self._listeners = [_Listener(model, one, views[one.name], state) for one in model.modalities]
        for listener in self._listeners:
            listener.call = self._compiled(listener)
        #: Whether any modality wants an event a tick while a contact lasts.
        self.moves = any(Contact.MOVE in one.instance.hears for one in model.modalities)
        self._rigs = [
            (rig, runner((rig.toucher.happens(self.moves, self._event),)), runner((rig.log.begins(self._event),)))
            for rig in rigs
        ]

    def _compiled(self, listener: _Listener) -> Callable[[], int] | None:
        """Return what tells a modality of an event as one compiled call; None: it is Python."""
        one = listener.one
        if not listener.kinds or not is_newest(type(one.instance), "bound_contact", "on_contact"):
            return None
        with failing(f"modality '{one.name}'", "bound_contact", self._model.place_of(one.name)):
            bound = one.instance.bound_contact(one.model, listener.view, self._event)
        return None if bound is None else runner((listener.fence.keep, bound, listener.fence.look))

    def update(self, tick: int, ready: bool) -> None:
        """Deliver what has happened at every probe in this tick."""
        for rig, happens, begins in self._rigs:
            while (kind := happens() - 1) >= 0:
                self._deliver(rig, kind, tick, begins)
                if kind == MOVE:
                    break

    def _deliver(self, rig: ProbeRig, kind: int, tick: int, begins: Callable[[], int]) -> None:
        """Deliver an event; a log hears a contact begin before the modalities, and end after them."""
        event: ContactEvent | None = None
        if kind == BEGIN:
            begins()
        for listener in self._listeners:
            if kind not in listener.kinds:
                continue
            found = 0 if listener.call is None or "on_contact" in getattr(listener.one.instance, "__dict__", ()) else listener.call()
            if found < 0:
                continue
            if found >> 32 == _WRITTEN:
                raise foreign_write(self._model, [listener.one], listener.fence.mend(), tick)
            event = event or rig.toucher.event(self._event)
            self._tell(event, listener)
        if kind == END:
            rig.log.end(tick)
            rig.toucher.current[...] = -1

    def left_out(self, seconds: float, tick: int) -> None:
        """Let modalities know that so many seconds [s] were left out before a tick.

        Raises
        ------
        DeviceFaultError
            If one fails, or writes what is not its own.
        """
        for listener in self._listeners:
            one = listener.one
            call = partial(one.instance.left_out, one.model, listener.view, seconds)
            self._call(one, listener.fence, "left_out", tick, call)

    def _tell(self, event: ContactEvent, listener: _Listener) -> None:
        one = listener.one
        call = partial(one.instance.on_contact, event, one.model, listener.view)
        self._call(one, listener.fence, "on_contact", event.tick, call)

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
