"""The twins of a session served behind their emulators, in real time or step by step."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from itouch.exchange import ServedEmulator, TruthWriter
from itouch.loop.run_statistics import Histogram
from itouch.plugin import Emulator, Role
from itouch.scene.elements import PluginPart
from itouch.schema import ItouchError
from itouch.schema.terminal import note

if TYPE_CHECKING:
    from itouch.loop import Engine
    from itouch.loop.runner import Runner
    from itouch.plugin.discovery import Catalog
    from itouch.scene import Scene

#: A simulation this far behind goes on from now [s]; width of the bins of its lateness [s].
BEHIND, _BIN = 0.1, 1e-5


class VirtualRig:
    """The twins of a session behind their emulators, whose timers run ``speed`` times as fast as the host's.

    ``places`` are the parameters of those devices, by name, that are somewhere else than their scene says; ``wires``
    are the emulators of those that have another than their own.  ``truth`` is told in real time what the twins know.
    """

    def __init__(
        self,
        session: Engine,
        *,
        speed: float = 1.0,
        places: Mapping[str, Any] | None = None,
        wires: Mapping[str, Emulator] | None = None,
        truth: TruthWriter | None = None,
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
        commands = [channel.role for runner, _ in self._lines for channel in runner.model.commands]
        self._only_arms = all(role is Role.FORCE_ON_OPERATOR for role in commands)
        self._truth = truth
        #: How late [s] the periods of a simulation in real time began, and how far it has fallen behind in all [s].
        self.lateness, self.behind = Histogram(_BIN), 0.0

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
        try:
            while not stop():
                if self.driven:  # what is late while nobody drives a device delays nobody
                    self.lateness.add(max(0.0, time.monotonic() - due))
                due += self._period
                self._simulate(served)
                rest = due - time.monotonic()
                if rest > 0.0:
                    time.sleep(rest)
                elif -rest > BEHIND:
                    self.behind -= rest
                    due -= rest
        finally:
            for _, wire in served:
                wire.close()
        if self.behind:
            note(f"the simulation was {self.behind:.1f} s too slow in all")

    def _simulate(self, served: list[tuple[Runner, ServedEmulator]]) -> None:
        """Do what the hosts have asked for last, for one period, and show them how it went."""
        for runner, wire in served:
            self.driven |= wire.take(runner.sent)
        self._go_on()
        self.step()
        now = self._session.seconds
        for runner, wire in served:
            wire.show(now, runner.reading)
        if self._truth is not None:
            self._truth.write(now)

    def _go_on(self) -> None:
        """Let the motion begin where a host exchanges with arms alone: in the air it gives them no force."""
        if self._only_arms and not self.driven:
            self.driven = any(emulator.commanded for _, emulator in self._lines)

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
        self._go_on()

    def keep_up(self) -> None:
        """Let those emulators live through the last period that have a course of their own."""
        now = self._session.seconds
        for runner, emulator in self._lines:
            if emulator.lives:
                self.driven |= emulator.serve(now, runner.reading, runner.sent)

    def handles(self) -> list[int]:
        """Return the file descriptors on which a host's next request comes."""
        return [handle for _, emulator in self._lines for handle in emulator.handles()]


def placed(scene: Scene, catalog: Catalog, folder: str) -> Scene:
    """Return a scene whose devices are where nobody else's are: files in ``folder``, or free ports of this machine."""
    devices = []
    for element in scene.devices:
        cls = catalog.device(element.plugin)
        if cls is None or cls.Emulator is None:
            devices.append(element)
            continue
        os.mkdir(f"{folder}/{element.name}")
        own = next((part for part in element.parts if part.plugin == element.plugin), None)
        params = cls.Params() if own is None else own.params
        there = cls.Emulator.elsewhere(params, f"{folder}/{element.name}")
        part = PluginPart(element.plugin, "hardware", there) if own is None else replace(own, params=there)
        moved = replace(element, parts=(*(one for one in element.parts if one is not own), part))
        scene.places.succeed(moved, element)
        devices.append(moved)
    return replace(scene, devices=tuple(devices))


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
