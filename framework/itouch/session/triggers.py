"""Event codes: each mark that has one is put on a wire when it is set, for an amplifier that records lines."""

from __future__ import annotations

import time
from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final

from itouch.session.wires import Wire

if TYPE_CHECKING:
    from itouch.session.engine import Session

#: How long a code is shown [s] before the lines are 0 again: amplifiers that sample at 250 Hz see it twice.
PULSE: Final = 0.010
#: The mark that says that codes are not shown any more.
LOST: Final = "trigger lost"


class Triggers:
    """Puts codes on a wire while the context lasts; also what was put, and when on the monotonic clock [ns].

    A mark's code is the number ``code`` of its payload, else that of its name; a mark without one is not shown.  Two
    marks within one pulse: the second shows at once.  A wire that fails is told by a mark, and the session goes on.
    """

    def __init__(self, session: Session, wire: Wire, codes: Mapping[str, int] | None = None) -> None:
        self._session, self._wire, self._codes = session, wire, dict(codes or {})
        self._until = 0
        self._works = True
        self.put: list[tuple[int, int]] = []

    def __enter__(self) -> Triggers:
        self._show(0)
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

    def _hear(self, name: str, payload: Any) -> None:
        code = self.code(name, payload)
        if code and self._works:
            self._until = time.monotonic_ns() + round(PULSE * 1e9)
            self._show(code)

    def _tap(self, tick: int) -> None:
        if self._until and time.monotonic_ns() >= self._until:
            self._until = 0
            self._show(0)

    def _show(self, code: int) -> None:
        try:
            self._wire.put(code)
        except OSError as error:
            self._works, self._until = False, 0
            self._session.post_mark(LOST, {"port": self._wire.port, "cause": str(error.strerror or error)})
            return
        self.put.append((time.monotonic_ns(), code))
