"""A twin that Python steps and reads tick after tick (`BoundTwin`), by compiled calls that are bound once."""

from __future__ import annotations

from itouch.plugin.bound import Bound, bound_by
from itouch.plugin.device import Twin, TwinInputs
from itouch.plugin.record import Record


class BoundTwin:
    """Steps and reads a twin from Python, by its compiled calls where it offers them.

    Binding a call takes longer than running it, so a call stays bound for as long as the same records, inputs, period
    and room come with it.  The twin's ``set_environment`` must not be called after the first step.
    """

    __slots__ = ("_binds_read", "_binds_step", "_read_for", "_reading", "_step_for", "_stepping", "twin")

    def __init__(self, twin: Twin) -> None:
        from itouch.joining import is_newest  # the compiler is only loaded where a twin runs

        self.twin = twin
        self._binds_step = is_newest(type(twin), "bound_step", "step")
        self._binds_read = is_newest(type(twin), "bound_read", "read")
        self._stepping: Bound | None = None
        self._reading: Bound | None = None
        self._step_for: tuple[Record, Record, TwinInputs, tuple[float, float, bool]] | None = None
        self._read_for: tuple[Record, Record] | None = None

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Do what the twin's ``step`` does."""
        known, numbers = self._step_for, (period, touch.ambient, touch.finger_attached)
        if (
            known is None
            or known[0] is not state
            or known[1] is not command
            or known[2] is not touch
            or known[3] != numbers
        ):
            given = (state, command, touch, period)
            bound = bound_by(self.twin.bound_step, *given, joins=False) if self._binds_step else ()
            self._stepping = bound[0] if bound else None
            self._step_for = (state, command, touch, numbers) if bound else None  # it may offer a call in another tick
        if self._stepping is None or self._stepping() != 0:
            self.twin.step(state, command, touch, period)

    def read(self, state: Record, reading: Record) -> bool | None:
        """Do what the twin's ``read`` does."""
        known = self._read_for
        if known is None or known[0] is not state or known[1] is not reading:
            bound = bound_by(self.twin.bound_read, state, reading, joins=False) if self._binds_read else ()
            self._reading = bound[0] if bound else None
            self._read_for = (state, reading) if bound else None
        if self._reading is None or self._reading() != 0:
            return self.twin.read(state, reading)
        return True
