"""The simulated chip behind a serial line of a virtual rig, whose twin gives temperatures and receives the current."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from itouch_thermal.chip.pins import at_pins
from itouch_thermal.chip.program import built, config
from itouch_thermal.chip.simulated import Chip

if TYPE_CHECKING:
    from itouch_thermal.drivers.virtual import Plate

#: How long [ms] the chip starts before the host can talk to it, runs ahead at most to answer, and waits for a line's
#: end.
START, AHEAD, PIECE = 100, 30, 10


class SimulatedLine:
    """A chip that runs in a virtual rig's time.

    A whole line from the host is answered at once: the chip runs ahead until it has answered, and its currents
    meanwhile are applied as the rig's time catches up.  So in step, where the rig's time stands while the host waits,
    the result is the same on any machine.

    Parameters
    ----------
    params
        The display's parameters; module and mismatch define the circuit.
    plate
        The values of the display's sensors, which the owner updates.
    """

    def __init__(self, params: Any, plate: Plate) -> None:
        self._params, self._plate, self._numbers = params, plate, config()
        self._chip: Chip | None = None
        self._time: int | None = None
        self._ahead: deque[float] = deque()
        self._current, self._heard, self._since = 0.0, b"", 0

    def open(self) -> None:
        """Compile if necessary, and switch the chip on.

        Raises
        ------
        DeviceError
            If a tool for compiling is missing.
        """
        self._chip = Chip(built(), baud=float(self._params.line.baud))
        self._time, self._current, self._heard = None, 0.0, b""
        self._ahead.clear()

    def close(self) -> None:
        """Discard the chip."""
        if self._chip is not None:
            self._chip.close()
        self._chip = None

    def take(self, data: bytes, now: float) -> tuple[bytes, float]:
        """Advance to a time [s] with bytes from the host; return the chip's bytes and the present current [A]."""
        time = round(now * 1e3)
        said = b""
        if self._time is None:
            self._time = time
            for _ in range(START):
                self._run(b"")
            self._ahead.clear()
        while self._time < time:
            self._time += 1
            if not self._ahead:
                said += self._run(b"")
            self._current = self._ahead.popleft()
            self._since += 1
        self._heard += data
        end = self._heard.rfind(b"\n") + 1 if self._since <= PIECE else len(self._heard)
        if data:
            self._since = 0
        if end:
            line, self._heard = self._heard[:end], self._heard[end:]
            said += self._answered(line)
        return said, self._current

    def _answered(self, line: bytes) -> bytes:
        said = self._run(line)
        for _ in range(AHEAD):
            if said.endswith(b"\n"):
                break
            said += self._run(b"")
        while (
            len(self._ahead) > AHEAD
        ):  # the rig's time stands, as while a host opens: meanwhile the chip runs by itself
            self._current = self._ahead.popleft()
        return said

    def _run(self, heard: bytes) -> bytes:
        """Run for a millisecond."""
        plate, params = self._plate, self._params
        off = params.mismatch
        assert self._chip is not None  # noqa: S101 - it is served only while it is open
        run = self._chip.run(
            at_pins(
                self._numbers, plate=plate.plate, sink=plate.sink, guard=plate.plate, flux=plate.flux,
                seebeck=params.seebeck * (1.0 + off.seebeck), resistance=params.resistance * (1.0 + off.resistance),
            ),
            heard,
        )  # fmt: skip
        self._ahead.append(run.current)
        return run.said
