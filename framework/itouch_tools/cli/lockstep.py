"""A scene on its devices' real protocols in one process, with host and simulated devices in lockstep.

Nothing runs in real time: a tick waits until the wires have answered, then the simulated world advances by one period.
So every byte is as on hardware, while the result does not depend on how busy the machine is.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import select
import shutil
import sys
import tempfile
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TextIO

from itouch.exchange import DirectEmulator, DirectHost, EveryNth, ThreadedDevice
from itouch.loop import DeviceFaultError
from itouch.plugin import Device, Trace
from itouch.schema import ItouchError
from itouch.schema.wait_notices import waiting
from itouch_tools.cli.served_twins import VirtualRig, require_switch

if TYPE_CHECKING:
    from itouch.loop.device_runner import Runner

#: By what factor the emulators' timers run faster than the host's, and the time between two looks at the wires [s].
SPEED, LOOK = 20.0, 1e-4
#: An unsteady wire: shortest and longest time between exchanges [s], the share of exchanges that is lost, and the delay
#: [s] after which a lost one is repeated.
UNSTEADY, LOST, AGAIN = (0.010, 0.030), 0.05, 0.020
#: Simulated seconds after which a scene whose motion does not end is stopped.
LONGEST = 600.0


class Lockstep:
    """A host's session and the virtual rig on which it runs, at addresses of their own: others may run beside it.

    ``only`` are the devices that are on their wires; none named: all.  Where an exchange takes longer than a tick,
    those after the first begin ``phase`` [s] later than they would or, if ``unsteady``, at times as with a busy host
    and a bad line.
    """

    def __init__(
        self,
        scene: str,
        *,
        rig: str | None = None,
        seed: int = 0,
        trace: TextIO | None = None,
        only: Sequence[str] = (),
        phase: float = 0.0,
        unsteady: bool = False,
    ) -> None:
        from itouch.servo.prepare import prepare

        self.world = prepare(scene, seed=seed, twin="all", rig=rig)
        self.host = prepare(scene, seed=seed, twin="none", rig=rig)
        self.host.guarded = True  # its devices are simulated in this process, and end with it
        self._folder = tempfile.mkdtemp(prefix="itouch-")
        self._tidy = weakref.finalize(self, shutil.rmtree, self._folder, True)
        places = {runner.model.name: self._place(runner) for runner in self.world.runners}
        period = self.host.model.period
        self._course = partial(_unsteady, period, seed) if unsteady else partial(_later, period, phase)
        straight = self._straight(only)
        wires = {name: DirectEmulator(device) for name, device in straight.items()}
        self.rig = VirtualRig(self.world, speed=SPEED, places=places, wires=wires)
        self._lock = threading.Lock()
        self._truth = {runner.model.name: runner.gate.twin_state for runner in self.world.runners}
        for runner in self.host.runners:
            if runner.model.name in straight:
                runner.gate.device = self._paced(runner, straight[runner.model.name])
            else:
                self._take_in(runner, places[runner.model.name], trace)
        self.host.taps.append(self._tick)

    def _straight(self, only: Sequence[str]) -> dict[str, DirectHost]:
        """Return the stand-ins for the devices that are on no wire, by name.

        Raises
        ------
        ItouchError
            If ``only`` names a device that the scene does not have.
        """
        names = [runner.model.name for runner in self.world.runners]
        for name in only:
            if name not in names:
                raise ItouchError(f"there is no device '{name}': the scene has {', '.join(names)}")
        return {
            runner.model.name: DirectHost(runner.model.params, runner.reading, runner.sent)
            for runner in self.world.runners
            if only and runner.model.name not in only
        }

    def _paced(self, runner: Runner, device: DirectHost) -> Device:
        """Return a device without a wire, but with its wire's period of exchanges, on which its controller relies."""
        cls, period = runner.model.cls, self.host.model.period
        every = max(1, round(cls.exchange_time_for(device.params) / period)) if cls.blocking else 1
        return (
            device
            if every == 1
            else EveryNth(device, every, round(cls.command_wait / period), period, cls=cls, course=self._course())
        )

    def _place(self, runner: Runner) -> Any:
        """Return a device's parameters, with an address that no other virtual rig uses."""
        emulator, folder = runner.model.cls.Emulator, f"{self._folder}/{runner.model.name}"
        os.mkdir(folder)
        return runner.model.params if emulator is None else emulator.with_private_address(runner.model.params, folder)

    def _take_in(self, runner: Runner, params: Any, trace: TextIO | None) -> None:
        """Tell a device its emulator's address; one that would have a thread for its exchanges has them in the tick."""
        device = runner.gate.device
        if device is not None:
            (device.device if isinstance(device, ThreadedDevice) else device).params = params
        if isinstance(device, ThreadedDevice):
            inner, period = device.device, self.host.model.period
            every, waits = (
                max(1, round(inner.exchange_time_for(inner.params) / period)),
                round(type(inner).command_wait / period),
            )
            course = self._course() if every > 1 else _as_it_is
            device = runner.gate.device = EveryNth(inner, every, waits, period, course=course)
        if device is not None and trace is not None:
            device.trace = Trace(trace, runner.model.name)

    def _tick(self, tick: int) -> None:
        with self._lock:
            for modality in self.host.model.modalities:
                modality.instance.on_ground_truth(modality.model, self.host.state, self._truth)
            self.rig.look()  # what was sent in this tick takes effect in it, however late the thread of the wires is
            self.rig.step()
            self.rig.keep_up()

    @contextlib.contextmanager
    def serving(self) -> Iterator[None]:
        """Serve the wires in a thread."""
        stop = threading.Event()

        def work() -> None:
            while not stop.is_set():
                with self._lock:
                    self.rig.look()
                    waiting = self.rig.file_descriptors()
                select.select(waiting, [], [], LOOK)

        self.rig.open()
        thread = threading.Thread(target=work, name="itouch-virtual-rig", daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()
            self.rig.close()

    def run(self, seconds: float | None = None) -> dict[str, Any]:
        """Run for a time [s], or until the simulated operator's motion has ended; return the report.

        Raises
        ------
        DeviceError
            If a device cannot be opened.
        ItouchError
            If nobody could hold the dead-man's switch.
        """
        if not self.host.held:
            require_switch(self.host.model.devices.values())
        with self.serving():
            try:
                self.host.enable()
                self.host.run(seconds or LONGEST, until=None if seconds else lambda: self.world.done)
            except DeviceFaultError as fault:
                print(f"fault: {fault}", file=sys.stderr)
            finally:
                self.host.close()
                self.world.close()
                self._tidy()
        return self.host.report()


def _as_it_is() -> None:
    return None


def _later(period: float, phase: float) -> Callable[[], int | None]:
    """Return a function that makes the second exchange begin later by a phase [s], and leaves the others alone."""
    first = iter([round((AGAIN + phase) / period)] if phase else [])
    return lambda: next(first, None)


def _unsteady(period: float, seed: int) -> Callable[[], int | None]:
    """Return a function that says after how many ticks the next exchange begins, with a busy host and a bad line."""
    chance, (low, high) = random.Random(seed), (round(time / period) for time in UNSTEADY)
    return lambda: chance.randint(low, high) + (round(AGAIN / period) if chance.random() < LOST else 0)


def main(options: argparse.Namespace) -> int:
    """Run a scene in lockstep, then show and write the report; return the exit code."""
    from itouch_tools.cli.shutdown import write_report
    from itouch_tools.report.screen import Screen

    with contextlib.ExitStack() as stack:
        trace = stack.enter_context(open(options.trace, "w", encoding="utf-8")) if options.trace else None
        both = Lockstep(options.scene, rig=options.rig, seed=options.seed, trace=trace, only=options.only,
                        phase=options.phase, unsteady=options.unsteady)  # fmt: skip
        with waiting(f"running {options.scene} on its wires") as wait:
            both.host.taps.append(lambda tick: wait.part(None, f"{tick * both.host.model.period:.1f} s simulated"))
            report = both.run(options.duration)
    Screen(both.host, sys.stdout).finish(report)
    write_report(options.report, lambda: report)
    return 1 if both.host.fault is not None else 0


__all__ = ["EveryNth", "Lockstep", "main"]
