"""The line protocol for rigs of one's own: a command line, an answer line, each with a check sum.

``I <amps>*CC`` sets the current; ``R <plate> <sink> <flux> <skin> <amps>*CC`` answers with degrees Celsius, W/m2 and
amperes (``nan`` where there is no sensor); ``?*CC`` asks for ``N itouch-line 1 <name>*CC``; ``E <words>*CC`` refuses.
CC is the exclusive or of the bytes before ``*``, two hexadecimal digits.  Without an ``I`` for 0.2 s the rig takes its
current to zero by itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from itouch.plugin import DeviceError, Trace
from itouch_thermal.drivers.params import LinePort
from itouch_thermal.drivers.serialport import SerialLine

GREETING = "itouch-line 1"
#: How long [s] an answer may take, how often a line is sent, and the rig's own watchdog [s].
PATIENCE, TRIES, WATCHDOG = 0.06, 3, 0.2
KELVIN = 273.15


class LineReading(NamedTuple):
    """What a rig measures: temperatures [K], flux [W/m2] and current [A]; NaN where it has no sensor."""

    plate: float
    sink: float
    flux: float
    skin: float
    current: float


def seal(text: str) -> bytes:
    """Return a line with its check sum and end."""
    check = 0
    for byte in text.encode():
        check ^= byte
    return f"{text}*{check:02X}\n".encode()


def unseal(line: bytes) -> str | None:
    """Return a line's text, or None if its check sum is wrong."""
    body, star, check = line.rstrip(b"\r\n").decode("ascii", "replace").rpartition("*")
    if not star or len(check) != 2 or not body.isascii():
        return None
    return body if seal(body)[-3:-1].decode() == check.upper() else None


class LineDriver:
    """An open rig.

    Raises
    ------
    DeviceError
        If it does not answer or does not speak the protocol.
    """

    def __init__(self, params: LinePort, trace: Trace | None = None, *, patience: float = 1.0) -> None:
        self._patience = PATIENCE * patience
        self._line = SerialLine(params.port, params.baud, end=b"\n", trace=trace)
        try:
            self.identity = self._ask("?", "N")
            if not self.identity.startswith(GREETING):
                raise DeviceError(f"on {params.port} answers '{self.identity}', not '{GREETING}'")
        except BaseException:
            self._line.close()
            raise

    def _ask(self, text: str, wanted: str) -> str:
        for _ in range(TRIES):
            self._line.clear()
            self._line.send(seal(text))
            answer = self._line.receive(self._patience)
            body = unseal(answer) if answer is not None else None
            if body is None:
                continue
            if body.startswith("E"):
                raise DeviceError(f"the rig on {self._line.port} refuses '{text}': {body[1:].strip()}")
            if body.startswith(wanted):
                return body[1:].strip()
        raise DeviceError(f"the rig on {self._line.port} did not answer '{text}' {TRIES} times")

    def exchange(self, current: float) -> LineReading:
        """Set the current [A], and measure.

        Raises
        ------
        DeviceError
            If it does not answer, refuses, or answers nonsense.
        """
        answer = self._ask(f"I {current:.5f}", "R")
        try:
            plate, sink, flux, skin, actual = (float(word) for word in answer.split())
        except ValueError:
            raise DeviceError(f"the rig on {self._line.port} answered '{answer}', not five numbers") from None
        if not (math.isfinite(plate) and math.isfinite(sink) and math.isfinite(actual)):
            raise DeviceError(f"the rig on {self._line.port} has lost its plate's or sink's sensor")
        return LineReading(plate + KELVIN, sink + KELVIN, flux, skin + KELVIN, actual)

    def close(self) -> None:
        """Set the current to zero, then let go of the line."""
        try:
            self._ask("I 0", "R")
        finally:
            self._line.close()
