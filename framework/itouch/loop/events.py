"""Contact events: delivered to logs and modalities within the tick, in declared order, and remembered in State."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from itouch.loop.blame import modality_fault
from itouch.loop.rig import ProbeRig
from itouch.plugin import Contact, ContactEvent, Modality, Record
from itouch.world import Model
from itouch.world.state import EVENTS


class Events:
    """Takes each event of a tick to all who hear it."""

    def __init__(
        self, model: Model, state: Record, rigs: Sequence[ProbeRig], modalities: Sequence[tuple[Modality, Any, int]]
    ) -> None:
        self._model, self._state, self._rigs = model, state, rigs
        self._modalities = modalities
        self._table, self._count = state["events.table"], state["events.count"]
        self._probe_index = {probe.name: probe.index for probe in model.probes}
        #: Whether any modality wants an event a tick while a contact lasts.
        self.moves = any(Contact.MOVE in instance.hears for instance, _, _ in modalities)

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
        for instance, model, _ in self._modalities:
            if event.kind in instance.hears:
                try:
                    instance.on_contact(event, model, self._state)
                except Exception as error:
                    raise modality_fault(self._model, instance, "on_contact", event.tick, error) from error
        if event.kind is Contact.END:
            self._log(event)

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
