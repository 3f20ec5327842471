"""Contact events: delivered to logs and modalities within the tick, in declared order, and remembered in State.

They are found and delivered in compiled code as far as listeners have compiled calls; Python delivers the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import NoReturn

import numpy as np

from itouch.joining import Chain, can_join, is_newest, runner
from itouch.loop import builtins_guard, event_detection, probe_steps
from itouch.loop.fault_attribution import foreign_write, modality_fault, with_replaced
from itouch.loop.probe_rig import ProbeRig
from itouch.loop.run_statistics import RunStatistics
from itouch.loop.write_access import WriteGuard
from itouch.plugin import Bound, Contact, ContactArrays, Record
from itouch.plugin.bound import bound_by
from itouch.plugin.write_protection import WriteProtectedRecord
from itouch.schema.plugin_errors import failing
from itouch.world import ModalityModel, Model

#: Calls per listener and event: its fence's copy of State, its own call, and the fence's comparison with the copy.
_CALLS = 3
#: After one of these nothing more happens at a probe in a tick: the first MOVE comes in the tick after BEGIN.
_LAST = frozenset({event_detection.BEGIN, event_detection.MOVE})


class _Listener:
    """A modality that hears of contacts: by a compiled call between those of its fence, or in Python."""

    def __init__(self, model: Model, one: ModalityModel, view: Record, state: Record, event: ContactArrays) -> None:
        self.one, self.view, self.fence = one, view, WriteGuard([one], state)
        self.kinds = frozenset(int(kind) for kind in one.instance.subscribes_to)
        bound: tuple[Bound, ...] = ()
        if self.kinds and self._joins():
            with failing(f"modality '{one.name}'", "bound_contact", model.place_of(one.name)):
                bound = bound_by(one.instance.bound_contact, one.model, view, event)
        asks = Bound(event_detection.asks, event, sum(1 << kind for kind in self.kinds))
        #: Its calls in a chain; the second stops the chain if Python is needed, the third if it wrote what is not its.
        self.calls = (self.fence.keep, *(bound or (asks,)), self.fence.look)
        self.call = runner(self.calls) if bound else None

    def _joins(self) -> bool:
        """Tell whether a compiled call may replace ``on_contact``: no subclass, nor instance, overrides it alone.

        Nor may one override ``subscribes_to`` alone, because compiled code itself leaves out what it does not hear.
        """
        instance = self.one.instance
        own = {"on_contact", "subscribes_to"} & set(getattr(instance, "__dict__", ()))
        return not own and all(
            is_newest(type(instance), "bound_contact", alone) for alone in ("on_contact", "subscribes_to")
        )


class _Probe:
    """A probe with the calls that find and deliver its contact events."""

    def __init__(self, rig: ProbeRig, moves: bool, event: ContactArrays, ended: event_detection.Ended) -> None:
        self.rig, arguments = rig, rig.contact_step.happens(moves, event)
        self.next = Bound(event_detection.next_told, *arguments, ended)
        self.begins, self.ends = (
            rig.log.begins(event),
            Bound(event_detection.close, event, rig.contact_step.current, ended),
        )
        #: What finds the next event, and what begins an entry of the log, as called from Python.
        self.find, self.begin = runner((Bound(event_detection.happens, *arguments),)), runner((self.begins,))
        #: Where the chain that delivers an event has stopped, shape (1,).
        self.left = np.zeros(1, np.int64)
        self.chain: Chain | None = None


def _ended(state: Record, kept: Record) -> event_detection.Ended:
    """Return the memory in which State is kept for the log entry of a contact that ends."""
    kind = np.uint8 if state.nbytes % 8 else np.int64
    return event_detection.Ended(state.raw.view(kind), kept.raw.view(kind), *(np.zeros(1, np.int64) for _ in range(3)))


class Events:
    """Delivers each contact event of a tick to all who hear it."""

    def __init__(
        self, model: Model, state: Record, rigs: Sequence[ProbeRig], views: Mapping[str, Record],
        statistics: RunStatistics,
    ) -> None:  # fmt: skip
        self._model = model
        #: The numbers of the event that is being delivered.
        self._event = event_detection.silent()
        self._listeners = [_Listener(model, one, views[one.name], state, self._event) for one in model.modalities]
        #: Whether any modality hears MOVE, an event in each tick of a contact.
        self._moves = any(Contact.MOVE in one.instance.subscribes_to for one in model.modalities)
        kept = state.copy()
        seen = WriteProtectedRecord(kept, ())
        self._ended = _ended(state, kept)
        self._probes = [_Probe(rig, self._moves, self._event, self._ended) for rig in rigs]
        #: Per probe, what a contact's entry is made of, from State as it was when the contact ended.
        self._then = [rig.log.kept(kept, seen) for rig in rigs]
        #: Makes the entry of the contact that ended last, a part at a time; None: it is not begun, or is complete.
        self.making: Iterator[bool] | None = None
        statistics.settle = self.settle
        self._around: WriteGuard | None = None
        self._carriers: list[ModalityModel] = []
        #: One call per probe; the first one at which something is left to Python stops the tick with its number.
        self.bounds: tuple[Bound, ...] = ()

    def join(self, around: WriteGuard | None, carriers: list[ModalityModel]) -> None:
        """Put together the calls that a tick runs.

        ``around``: a fence within which events are delivered; of the modalities inside, only the ``carriers`` have run.
        """
        self._around, self._carriers = around, carriers
        self.bounds = tuple(self._bound(probe, number) for number, probe in enumerate(self._probes, 1))

    def _bound(self, probe: _Probe, number: int) -> Bound:
        event_views = probe.rig.contact_step.event_views
        if not can_join():
            return Bound(probe_steps.quiet, *event_views, self._moves)
        own = [call for listener in self._listeners for call in (listener.calls if listener.kinds else ())]
        fence = ((self._around.look,), (self._around.keep,)) if self._around is not None else ((), ())
        probe.chain = Chain([*fence[0], probe.next, probe.begins, *own, probe.ends, *fence[1]])
        probe.chain.warm_up()
        return Bound(
            event_detection.tell, *event_views, self._moves, self._event, probe.chain.place, probe.left, number
        )

    def settle(self) -> None:
        """Make the entry of the contact that ended last, as far as it is still to be made."""
        while self._ended.open.item():
            self.begin_entry(math.inf)
            self.go_on_with_entry()

    def begin_entry(self, tick: float) -> None:
        """Begin the entry of the contact that ended last, if that was before a tick and it is still to be made.

        It is made in parts, one for the framework and one for each modality that measures, for which the caller finds
        a tick each: what has not run for seconds is in no cache of the processor, so that the whole takes as long as
        ten ticks.
        """
        ended = self._ended
        if self.making is None and ended.open.item() and ended.tick.item() < tick:
            number = ended.probe.item()
            self.making = self._probes[number].rig.log.making(ended.tick.item(), self._then[number])

    def go_on_with_entry(self) -> None:
        """Make the next part of the entry that is begun, if one is."""
        making, self.making = self.making, None
        if making is None:
            return
        try:
            self._ended.open[0] = 0  # for a modality that asks for the contacts while it is asked
            if next(making, False):
                self._ended.open[0], self.making = 1, making
        except KeyboardInterrupt:  # the report that follows still has it, made anew
            self._ended.open[0], self.making = 1, None
            raise

    def answer(self, code: int, tick: int) -> None:
        """Deliver in Python what a probe's call has left, and the events of the probes after it.

        ``code`` is what the call has returned: the number of the probe, from 1 on.
        """
        first = code - 1 if self._probes[0].chain is not None else -1
        if first >= 0:
            self._go_on(self._probes[first], int(self._probes[first].left[0]), tick)
        else:
            self._look(tick)
        for probe in self._probes[first + 1 :]:
            self._update(probe, tick)
        if self._around is not None:
            self._around.take()

    def fail(self, error: Exception, which: int, tick: int) -> None:
        """Raise the fault for an error in the compiled call of a modality, at the probe ``which``.

        Raises
        ------
        DeviceFaultError
            Put down to the modality.
        """
        hears, chain = [listener for listener in self._listeners if listener.kinds], self._probes[which].chain
        number, call = divmod(chain.called - 2 - (self._around is not None), _CALLS) if chain is not None else (-1, 0)
        if call == 1 and 0 <= number < len(hears):
            self._fail(hears[number].one, hears[number].fence, "on_contact", tick, error)
        raise error

    def _fail(self, one: ModalityModel, fence: WriteGuard, method: str, tick: int, error: BaseException) -> NoReturn:
        replaced = builtins_guard.put_back()  # first: all else needs Python's functions
        fence.mend()
        raise with_replaced(modality_fault(self._model, one.instance, method, tick, error), replaced) from error

    def _look(self, tick: int) -> None:
        """Check whether a modality that has run has written where it may not, before anything else writes there."""
        if self._around is not None and (changed := self._around.mend()):
            raise foreign_write(self._model, self._carriers, changed, tick)

    def _go_on(self, probe: _Probe, found: int, tick: int) -> None:
        """Go on where the chain of a probe has stopped; ``found`` is what ``run_chain`` has returned."""
        call = (found >> 32) - (self._around is not None)
        hears, kind = [listener for listener in self._listeners if listener.kinds], int(self._event.kind[0])
        if call < 0:
            self._look(tick)
        elif call == 0:
            self._deliver(probe, kind, tick, hears)
        else:
            number, which = divmod(call - 2, _CALLS)
            if which == _CALLS - 1:
                self._written(hears[number], tick)
            if kind in hears[number].kinds:
                self._tell(probe, hears[number])
            self._deliver_to(probe, kind, tick, hears[number + 1 :])
            self._close(probe, kind, tick)
        if kind not in _LAST:
            self._update(probe, tick)

    def _update(self, probe: _Probe, tick: int) -> None:
        """Deliver what has happened at a probe in this tick."""
        hears = [listener for listener in self._listeners if listener.kinds]
        while (code := probe.find()) >= 0:
            self._deliver(probe, code - 1, tick, hears)
            if code - 1 in _LAST:
                return

    def _deliver(self, probe: _Probe, kind: int, tick: int, hears: Sequence[_Listener]) -> None:
        """Deliver an event; the log hears of BEGIN before the modalities, and of END after them."""
        if kind == event_detection.BEGIN:
            probe.begin()
        self._deliver_to(probe, kind, tick, hears)
        self._close(probe, kind, tick)

    def _close(self, probe: _Probe, kind: int, tick: int) -> None:
        """At END, end the entry of the log."""
        if kind == event_detection.END:
            probe.rig.log.end(tick)
            probe.rig.contact_step.current[...] = -1

    def _deliver_to(self, probe: _Probe, kind: int, tick: int, hears: Sequence[_Listener]) -> None:
        for listener in hears:
            if kind in listener.kinds:
                try:
                    found = 1 << 32 if listener.call is None else listener.call()
                except Exception as error:
                    self._fail(listener.one, listener.fence, "on_contact", tick, error)
                if found >> 32 == _CALLS - 1:
                    self._written(listener, tick)
                if found >= 0:
                    self._tell(probe, listener)

    def _written(self, listener: _Listener, tick: int) -> None:
        raise foreign_write(self._model, [listener.one], listener.fence.mend(), tick)

    def left_out(self, seconds: float, tick: int) -> None:
        """Tell modalities that ``seconds`` [s] were left out before a tick.

        Raises
        ------
        DeviceFaultError
            If one fails, or writes what is not its own.
        """
        for listener in self._listeners:
            one = listener.one
            call = partial(one.instance.on_skipped_time, one.model, listener.view, seconds)
            self._call(one, listener.fence, "on_skipped_time", tick, call)

    def _tell(self, probe: _Probe, listener: _Listener) -> None:
        """Tell a modality of the event in Python."""
        event, one = probe.rig.contact_step.event(self._event), listener.one
        call = partial(one.instance.on_contact, event, one.model, listener.view)
        self._call(one, listener.fence, "on_contact", event.tick, call)

    def _call(self, one: ModalityModel, fence: WriteGuard, method: str, tick: int, call: Callable[[], None]) -> None:
        """Call a method of a modality; what it raises, or writes elsewhere, is a fault."""
        fence.take()
        try:
            call()
        except KeyboardInterrupt as interrupted:  # Ctrl-C, or a plugin that raises it: the note says where
            interrupted.add_note(f"in {method} of modality '{one.name}'")
            raise
        except BaseException as error:  # a plugin that exits does not end the program
            self._fail(one, fence, method, tick, error)
        finally:
            changed = fence.mend()
        if changed:
            raise foreign_write(self._model, [one], changed, tick)
