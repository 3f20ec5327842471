"""The twins of a session, served behind their emulators, in real time or step by step."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from itouch.exchange import ServedEmulator, TruthWriter
from itouch.loop import DeviceFaultError
from itouch.loop.release import in_turn
from itouch.loop.run_statistics import Histogram
from itouch.loop.touchoff import TouchOffPhase, lasts
from itouch.plugin import DeviceError, Emulator, Role
from itouch.safety import Trip
from itouch.scene.elements import PluginPart
from itouch.schema import ItouchError
from itouch.schema.plugin_errors import error_text, failing
from itouch.schema.terminal import note
from itouch.twin.hand import first_rest

if TYPE_CHECKING:
    from itouch.loop.device_runner import Runner
    from itouch.plugin.discovery import Catalog
    from itouch.scene import Scene
    from itouch.session import Session
    from itouch.world import DeviceModel

#: A simulation that is later than this [s] gives up catching up; and the width [s] of the bins of its lateness.
BEHIND, _BIN = 0.1, 1e-5
#: What a person is told at the end of a motion, as a second session on the same rig would touch nothing.
_OVER = "the scene's motion has ended, and the operator rests where it ends: start virtual-rig again to repeat it"


class VirtualRig:
    """The twins of a session behind their emulators, whose timers run ``speed`` times as fast as the host's.

    ``places`` are the parameters, by name, of devices that are at another address than the scene says; ``wires`` are
    the emulators of devices that have another than their own.  ``truth`` is told the true states of the twins, in real
    time.
    """

    def __init__(
        self,
        session: Session,
        *,
        speed: float = 1.0,
        places: Mapping[str, Any] | None = None,
        wires: Mapping[str, Emulator] | None = None,
        truth: TruthWriter | None = None,
    ) -> None:
        self._session = session
        self._period = session.model.period
        self._lines: list[tuple[Runner, Emulator]] = []
        #: The emulators that are open; the last one perhaps by half, if that has failed.
        self._opened: list[Emulator] = []
        for runner in session.runners:
            emulator = (wires or {}).get(runner.model.name) or _emulator(runner, places or {})
            emulator.speed = speed
            self._lines.append((runner, emulator))
        #: Whether a host drives a device; only then the operator's motion advances.
        self.driven = False
        commands = [channel.role for runner, _ in self._lines for channel in runner.model.commands]
        self._only_arms = all(role is Role.FORCE_ON_OPERATOR for role in commands)
        self._truth = truth
        for words in _hurried(session):
            note(words)
        #: How late [s] the periods of a simulation in real time began, and the time [s] that it gave up in all.
        self.lateness, self.behind = Histogram(_BIN), 0.0

    def open(self) -> list[tuple[str, str]]:
        """Begin to listen; return each device's name and address.

        Raises
        ------
        DeviceError
            If a device's emulator cannot listen, as where its address is taken; all are closed again.
        SceneError
            If it fails in another way; likewise.
        """
        self.step()
        places = []
        try:
            for runner, emulator in self._lines:
                self._opened.append(emulator)
                places.append((runner.model.name, _open(runner, emulator)))
        except BaseException:
            with contextlib.suppress(Exception):  # of one that was not opened, or by half
                self._opened.pop().close()
            self.close()
            raise
        return places

    def close(self) -> None:
        """Close the connections of all that are open."""
        opened, self._opened = self._opened, []
        in_turn(*(emulator.close for emulator in opened))

    def run(self, stop: Callable[[], bool]) -> None:
        """Simulate in real time until ``stop`` returns true, with a thread for each device to answer its host."""
        served = [(runner, ServedEmulator(emulator, runner.reading, runner.sent)) for runner, emulator in self._lines]
        due = time.monotonic()
        told = self._truth is not None  # the session is one with this rig, and neither goes on
        try:
            while not stop():
                if not told and self._session.done:
                    told = True
                    note(_OVER)
                if self.driven:  # lateness does not matter while nobody drives a device
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
        """Simulate one period with the hosts' latest commands, and show them the new readings."""
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
        """Let the motion begin when a host commands a rig of arms alone: in the air it gives them no force."""
        if self._only_arms and not self.driven:
            self.driven = any(emulator.command_received for _, emulator in self._lines)

    def step(self) -> None:
        """Simulate one period, and take the twins' readings."""
        self._session.step_twins(self.driven)
        for runner, _ in self._lines:
            if runner.gate.twin is not None:
                try:
                    runner.gate.twin.read(runner.gate.twin_state, runner.reading)
                except Exception as error:
                    cause = f"failed in the reading of its twin: {error_text(error)}"
                    raise DeviceFaultError(runner.model.name, self._session.ticks, Trip.DEVICE_ERROR, cause) from error

    def look(self) -> None:
        """Let every emulator answer once."""
        now = self._session.seconds
        for runner, emulator in self._lines:
            self.driven |= emulator.serve(now, runner.reading, runner.sent)
        self._go_on()

    def keep_up(self) -> None:
        """Let emulators that act without being asked serve the last period, too."""
        now = self._session.seconds
        for runner, emulator in self._lines:
            if emulator.free_running:
                self.driven |= emulator.serve(now, runner.reading, runner.sent)

    def file_descriptors(self) -> list[int]:
        """Return the file descriptors on which a host's next request arrives."""
        return [handle for _, emulator in self._lines for handle in emulator.file_descriptors()]


def _hurried(session: Session) -> Iterable[str]:
    """Tell of each operator who, by its motion, may move before the surface below its finger has done its touch-off.

    The host does that, and no device's protocol tells when it is done.
    """
    for probe in session.model.probes:
        table, operator = session.model.devices.get(probe.scene.surface_to), probe.operator
        if table is None or not table.touch_off or operator is None or probe.recorded is not None:
            continue
        rest, needed = first_rest(operator), lasts(table.touch_off)
        if session.state[f"{table.name}.touch_off.stage"] != TouchOffPhase.DONE and rest < needed:
            yield (
                f"the operator of '{probe.name}' rests for {rest:g} s, then moves, and does not wait for the touch-off "
                f"of '{table.name}', which may last {needed:.0f} s: begin the motion with a longer hold"
            )


def placed(scene: Scene, catalog: Catalog, folder: str) -> Scene:
    """Return a scene whose devices have addresses that nobody else uses: files in ``folder``, or free ports."""
    devices = []
    for element in scene.devices:
        cls = catalog.device(element.plugin)
        if cls is None or cls.Emulator is None:
            devices.append(element)
            continue
        os.mkdir(f"{folder}/{element.name}")
        own = next((part for part in element.parts if part.plugin == element.plugin), None)
        params = cls.Params() if own is None else own.params
        there = cls.Emulator.with_private_address(params, f"{folder}/{element.name}")
        part = PluginPart(element.plugin, "hardware", there) if own is None else replace(own, params=there)
        moved = replace(element, parts=(*(one for one in element.parts if one is not own), part))
        scene.places.succeed(moved, element)
        devices.append(moved)
    return replace(scene, devices=tuple(devices))


def _open(runner: Runner, emulator: Emulator) -> str:
    """Open an emulator; return where it listens.  That it cannot is no mistake of plugin or scene: a line says it."""
    name, place = runner.model.name, runner.model.place
    with failing(f"device '{name}'", "opening its emulator", place):
        try:
            return emulator.open()
        except DeviceError as error:
            cause = f"{place}: device '{name}': {error}" if place is not None else f"device '{name}': {error}"
    raise DeviceError(cause)


def require_switch(devices: Iterable[DeviceModel]) -> None:
    """Refuse to run a scene on a virtual rig if nobody could hold its dead-man's switch.

    It is not held for the scene: of what a plugin names as its emulator's address nobody knows that nothing else is
    there.

    Raises
    ------
    ItouchError
        If no device reads a switch of its own.
    """
    if any(channel.role is Role.DEADMAN for device in devices for channel in device.reads):
        return
    raise ItouchError(
        "nobody could hold the dead-man's switch: --run opens no window, and no device of this scene reads a switch\n"
        "  = help: start `itouch-py virtual-rig SCENE` without --run, and in another terminal `itouch-py SCENE`: "
        "Space in its window holds the switch"
    )


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
