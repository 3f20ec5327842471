"""Event codes of marks and contacts, put on a wire for an amplifier that records trigger lines."""

from __future__ import annotations

import time
from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final

from itouch.plugin import Contact
from itouch.session.trigger_ports import Wire
from itouch.world.state import EVENTS

if TYPE_CHECKING:
    from itouch.session.session import Session

#: How long a code is shown [s] before the lines are 0 again: amplifiers that sample at 250 Hz see it twice.
PULSE: Final = 0.010
#: Name of the mark that codes are no longer shown, and of the mark that tells which code a contact got.
LOST: Final = "trigger lost"
CONTACT: Final = "contact code"
#: Events of a contact that can have a code, and what separates them from the name of an object.
KINDS: Final[Mapping[int, str]] = {Contact.BEGIN: "begin", Contact.END: "end"}
OF: Final = ":"


class Triggers:
    """Puts codes on a wire while the context lasts; ``put`` lists the times, on the monotonic clock [ns], and codes.

    A mark's code is the number ``code`` of its payload, else that of its name; a mark without one is not shown.  The
    beginning and the end of a contact have the code of ``begin:OBJECT`` (``end:OBJECT``), else of ``begin`` (``end``);
    it is on the wire before their tick has ended, and a mark `contact code` tells code, kind, object, probe and that
    tick.  If two codes fall within one pulse, the second shows at once.  If the wire fails, a mark tells it, and the
    session goes on.
    """

    def __init__(self, session: Session, wire: Wire, codes: Mapping[str, int] | None = None,
                 contacts: Mapping[str, int] | None = None) -> None:  # fmt: skip
        self._session, self._wire, self._codes = session, wire, dict(codes or {})
        self._contacts, self._seen = dict(contacts or {}), 0
        self._until = 0
        self._works = True
        self.put: list[tuple[int, int]] = []

    def __enter__(self) -> Triggers:
        self._show(0)
        self._seen = int(self._session.state["events.count"])
        self._session.mark_hooks.append(self._hear)
        self._session.taps.append(self._tap)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.mark_hooks.remove(self._hear)
        self._session.taps.remove(self._tap)
        if self._works:
            self._show(0)
        self._wire.close()

    def code(self, name: str, payload: Any) -> int:
        """Return the code of a mark, or 0."""
        own = payload.get("code") if isinstance(payload, Mapping) else None
        if isinstance(own, int) and not isinstance(own, bool) and 1 <= own <= 255:
            return own
        return self._codes.get(name, 0)

    def of_contact(self, kind: str, name: str) -> int:
        """Return the code of the beginning or end of a contact with an object, or 0."""
        return self._contacts.get(f"{kind}{OF}{name}", self._contacts.get(kind, 0))

    def _hear(self, name: str, payload: Any) -> None:
        code = 0 if name == CONTACT else self.code(name, payload)
        if code and self._works:
            self._pulse(code)

    def _tap(self, tick: int) -> None:
        if self._contacts:
            self._look()
        if self._until and time.monotonic_ns() >= self._until:
            self._until = 0
            self._show(0)

    def _look(self) -> None:
        """Show the codes of contacts that have begun or ended in this tick."""
        state, model = self._session.state, self._session.model
        count = int(state["events.count"])
        for number in range(max(self._seen, count - EVENTS), count):
            event = state["events.table"][number % EVENTS]
            kind, touched = KINDS.get(int(event["kind"]), ""), model.objects[int(event["object"])]
            code = self.of_contact(kind, touched) if kind else 0
            if code and self._works:
                self._pulse(code)
                probe = next(one.name for one in model.probes if one.index == int(event["probe"]))
                self._session.post_mark(CONTACT, {"code": code, "event": kind, "object": touched, "probe": probe,
                                                  "tick": int(event["tick"])})  # fmt: skip
        self._seen = count

    def _pulse(self, code: int) -> None:
        self._until = time.monotonic_ns() + round(PULSE * 1e9)
        self._show(code)

    def _show(self, code: int) -> None:
        try:
            self._wire.put(code)
        except OSError as error:
            self._works, self._until = False, 0
            self._session.post_mark(LOST, {"port": self._wire.port, "cause": str(error.strerror or error)})
            return
        self.put.append((time.monotonic_ns(), code))
