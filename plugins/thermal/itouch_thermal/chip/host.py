"""A host of the simulated display without a clock: sends commands, waits in simulated time, counts missing answers."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from itouch_thermal.chip.display import SimulatedDisplay
from itouch_thermal.drivers.lineport import seal, seal_2, unseal_2

#: How long [ms] to wait for an answer.
PATIENCE = 20


class Answer(NamedTuple):
    """A reading: temperatures [degC], flux [W/m2], current [A], and the state as a word."""

    plate: float
    sink: float
    flux: float
    skin: float
    current: float
    state: str


class SimulatedHost:
    """Talks to a display; simulated time advances only while it does.

    Parameters
    ----------
    display
        The display.
    noise
        Distorts the bytes sent to it; None: no noise.
    """

    def __init__(self, display: SimulatedDisplay, noise: Callable[[bytes], bytes] | None = None) -> None:
        self.display, self._noise = display, noise or (lambda line: line)
        self._number, self._waiting = 0, b""
        self.silent = 0

    def ask(self, text: str, patience: int = PATIENCE) -> str | None:
        """Send a line and wait; return the answer's text, or None if no complete answer came."""
        self._waiting = b""
        heard = self._noise(seal(text) if text == "?" else seal_2(text))
        for _ in range(patience):
            self._waiting += self.display.step(heard)
            heard = b""
            if b"\n" in self._waiting:
                line, _, self._waiting = self._waiting.partition(b"\n")
                return unseal_2(line)
        self.silent += 1
        return None

    def order(self, amps: float, period: int = 20) -> Answer | None:
        """Send a current and run for ``period`` milliseconds in all; return the reading, if there was one."""
        end = self.display.milliseconds + period
        self._number = (self._number + 1) % 256
        answer = self.ask(f"I {self._number} {amps:.5f}", period)
        self.wait(end - self.display.milliseconds)
        if answer is None or not answer.startswith(f"R {self._number} "):
            return None
        words = answer.split()[2:]
        plate, sink, flux, skin, current = (float(word) for word in words[:5])
        return Answer(plate, sink, flux, skin, current, words[5])

    def hold(self, amps: float, seconds: float, period: int = 20) -> list[Answer]:
        """Send the same current for a time [s]; return the readings."""
        found = (self.order(amps, period) for _ in range(round(seconds * 1e3 / period)))
        return [answer for answer in found if answer is not None]

    def wait(self, milliseconds: int) -> None:
        """Run for a time [ms] without sending."""
        for _ in range(milliseconds):
            self.display.step()

    def begin(self) -> str:
        """Wait until the display has started, send the greeting, and return the answer.

        Raises
        ------
        TimeoutError
            If it does not answer.
        """
        self.wait(100)
        for _ in range(5):
            answer = self.ask("?")
            if answer is not None:
                return answer
        raise TimeoutError("the simulated display does not answer")
