"""The twins of a session served behind their emulators, in real time or step by step."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from itouch.exchange import ServedEmulator
from itouch.plugin import Emulator
from itouch.schema import ItouchError
from itouch.schema.terminal import note

if TYPE_CHECKING:
    from itouch.loop import Engine
    from itouch.loop.runner import Runner

#: A simulation this far behind goes on from now [s].
BEHIND = 0.1


class VirtualRig:
    """The twins of a session behind their emulators, whose timers run ``speed`` times as fast as the host's.

    ``places`` are the parameters of those devices, by name, that are somewhere else than their scene says; ``wires``
    are the emulators of those that have another than their own.
    """

    def __init__(
        self,
        session: Engine,
        *,
        speed: float = 1.0,
        places: Mapping[str, Any] | None = None,
        wires: Mapping[str, Emulator] | None = None,
    ) -> None:
        self._session = session
        self._period = session.model.period
        self._lines: list[tuple[Runner, Emulator]] = []
        for runner in session.runners:
            emulator = (wires or {}).get(runner.model.name) or _emulator(runner, places or {})
            emulator.speed = speed
            self._lines.append((runner, emulator))
        #: Whether a host drives a device: then the operator's motion goes on.
        self.driven = False

    def open(self) -> list[tuple[str, str]]:
        """Begin to listen; return each device's name and where it is.

        Raises
        ------
        DeviceError
            If a device's place is taken.
        """
        self.step()
        return [(runner.model.name, emulator.open()) for runner, emulator in self._lines]

    def close(self) -> None:
        """Hang up."""
        for _, emulator in self._lines:
            emulator.close()

    def run(self, stop: Callable[[], bool]) -> None:
        """Simulate in real time, and answer each host in a thread of its own, until ``stop`` says so."""
        served = [(runner, ServedEmulator(emulator, runner.reading, runner.sent)) for runner, emulator in self._lines]
        due = time.monotonic()
        late = 0.0
        try:
            while not stop():
                due += self._period
                self._simulate(served)
                rest = due - time.monotonic()
                if rest > 0.0:
                    time.sleep(rest)
                elif -rest > BEHIND:
                    late -= rest
                    due -= rest
        finally:
            for _, wire in served:
                wire.close()
        if late:
            note(f"the simulation was {late:.1f} s too slow in all")

    def _simulate(self, served: list[tuple[Runner, ServedEmulator]]) -> None:
        """Do what the hosts have asked for last, for one period, and show them how it went."""
        for runner, wire in served:
            self.driven |= wire.take(runner.sent)
        self.step()
        now = self._session.seconds
        for runner, wire in served:
            wire.show(now, runner.reading)

    def step(self) -> None:
        """Simulate one period, and let the twins measure."""
        self._session.step_twins(self.driven)
        for runner, _ in self._lines:
            if runner.twin is not None:
                runner.twin.read(runner.twin_state, runner.reading)

    def look(self) -> None:
        """Let every emulator answer once."""
        now = self._session.seconds
        for runner, emulator in self._lines:
            self.driven |= emulator.serve(now, runner.reading, runner.sent)

    def keep_up(self) -> None:
        """Let those emulators live through the last period that have a course of their own."""
        now = self._session.seconds
        for runner, emulator in self._lines:
            if emulator.lives:
                self.driven |= emulator.serve(now, runner.reading, runner.sent)

    def handles(self) -> list[int]:
        """Return the file descriptors on which a host's next request comes."""
        return [handle for _, emulator in self._lines for handle in emulator.handles()]


def _emulator(runner: Runner, places: Mapping[str, Any]) -> Emulator:
    """Return the emulator of a device.

    Raises
    ------
    ItouchError
        If its plugin has none.
    """
    cls = runner.model.cls.Emulator
    if cls is None:
        raise ItouchError(f"device '{runner.model.name}': plugin '{runner.model.plugin}' has no emulator")
    found: Emulator = cls(places.get(runner.model.name, runner.model.params))
    return found
