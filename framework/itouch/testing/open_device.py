"""An open device: on its hardware or a loop-back, or on its emulator, which answers in a thread."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass, replace
from typing import Any

from itouch.plugin import Channel, DeviceError, Emulator, Field, Record, Role
from itouch.testing.checks import CheckError, NotApplicableError
from itouch.testing.harness import PERIOD, DeviceHarness, TwinBench, follows

#: Names of parameters that say where a device is.
PLACES = ("port", "path", "device", "serial_port", "tty", "address", "host", "url", "bus", "tmcl")
#: Factor on timeouts of answers for an emulated device, as the machine has other work too.
_PATIENCE = 5.0
#: Greatest number of ticks that a delayed twin makes up at once.
_MOST = 20


class Served:
    """An emulator that answers in a thread, with the twin behind it."""

    def __init__(self, harness: DeviceHarness) -> None:
        kind = harness.cls.Emulator
        if kind is None:
            raise NotApplicableError("the device class names no Emulator")
        given = harness.require_params()
        params = kind.with_default_address(given)
        self.harness = replace(harness, params=_here(params) if params is given else params, emulated=False)
        params = self.harness.params
        self.bench = TwinBench(self.harness, seed=1)
        self.emulator: Emulator = kind(params)
        reads, commands = harness.cls.channels(params)
        #: Whether it follows the finger, which then holds it where the real device can be.
        self.tracks = follows(reads, commands)
        if self.tracks:
            self.hold(kind.reachable_position(params))
        self.asked = Record.of(Field.of(c) for c in self.bench.commands)
        self.driven = False
        self._begun = 0.0
        self.error: Exception | None = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Served:
        self.emulator.open()
        self._begun = time.perf_counter()
        self._thread = threading.Thread(target=self._serve, name="emulator", daemon=True)
        self._thread.start()
        return self

    def _serve(self) -> None:
        try:
            while not self._stop.is_set():
                self.driven = self.emulator.serve(self.bench.tick * PERIOD, self.bench.reading, self.asked)
                if self.driven:
                    self.bench.command.raw[:] = self.asked.raw
                self.bench.step(self._due(), driven=False)
                time.sleep(5e-4)
        except Exception as error:  # raised again on leaving
            self.error = error

    def _due(self) -> int:
        """Return how many ticks the twin has to make to catch up with the clock; a long delay is left out."""
        behind = round((time.perf_counter() - self._begun) / PERIOD) - self.bench.tick
        if behind > _MOST:
            self._begun += (behind - _MOST) * PERIOD
        return min(max(behind, 0), _MOST)

    def hold(self, place: Sequence[float]) -> None:
        """Put the finger that holds the device at a position [m] in its frame."""
        self.bench.touch.finger_attached = True
        self.bench.touch.finger_pose[:3] = place

    def hang_up(self) -> None:
        """Disconnect the device."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(5.0)
            self._thread = None
            self.emulator.close()

    def __exit__(self, *_: object) -> None:
        self.hang_up()
        if self.error is not None:
            raise self.error


def _here(params: Any) -> Any:
    """Return the parameters with a free port or path of this machine, if one of the usual ones names such a place."""
    if not is_dataclass(params) or isinstance(params, type):
        return params
    for name, value in _places(params):
        if re.search(r":\d+$", value) and "://" not in value:
            with socket.create_server(("127.0.0.1", 0)) as free:
                return replace(params, **{name: f"127.0.0.1:{free.getsockname()[1]}"})
        if value.startswith("/dev/") or not value:
            return replace(params, **{name: f"{tempfile.gettempdir()}/itouch-{os.getpid()}-port"})
    return params


@contextlib.contextmanager
def served(harness: DeviceHarness) -> Iterator[tuple[Served, DeviceHarness]]:
    """Serve the emulator; yield it with a harness whose hardware can be opened."""
    with Served(harness) as emulator:
        yield emulator, replace(emulator.harness, hardware=True)


class Opened:
    """An open device with records of its channels; leaving the context closes it, and its emulator too."""

    def __init__(self, harness: DeviceHarness, served_by: Served | None = None) -> None:
        harness.require_hardware()
        self._end = contextlib.ExitStack()
        self.served: Served | None = served_by
        if harness.emulated:
            self.served, harness = self._end.enter_context(served(harness))
        self.device = harness.cls(harness.require_params())
        if harness.cls.Emulator is not None:
            self.device.timeout_factor = _PATIENCE
        reads, commands = harness.cls.channels(harness.params)
        self.reading = Record.of(Field.of(c) for c in reads)
        self.command = Record.of(Field.of(c) for c in commands)
        self.reads: Sequence[Channel] = reads
        self.commands: Sequence[Channel] = commands
        self._seen = False
        self.be_safe()
        try:
            self.device.open()
        except BaseException:
            self._end.close()
            raise

    def be_safe(self) -> None:
        """Set the commands to their safe values."""
        for channel in self.commands:
            if isinstance(channel.safe, tuple):
                self.command[channel.name] = channel.safe

    def stay(self) -> None:
        """Set a pose target to the present pose of the device."""
        goal = next((c.name for c in self.commands if c.role is Role.SURFACE_POSE), "")
        pose = next((c.name for c in self.reads if c.role is Role.TRACKED_POSE), "")
        if goal and pose:
            self.command[goal] = self.reading[pose]

    def __enter__(self) -> Opened:
        return self

    def __exit__(self, *_: object) -> None:
        with self._end:
            self.device.close()

    def fresh(self, patience: float = 1.0, *, silent: bool = False) -> None:
        """Read until there is a new reading, for at most ``patience`` [s], sending the safe command unless ``silent``.

        It is sent only to a device with a watchdog, and after the first reading, as the framework does.

        Raises
        ------
        CheckError
            If no new reading comes in time.
        """
        deadline = time.perf_counter() + patience
        speaks = not silent and self.device.watchdog is not None and self._seen
        while self.device.read(self.reading) is False:
            if speaks:
                self.send()
            if time.perf_counter() > deadline:
                raise CheckError(
                    f"no new reading within {patience:g} s",
                    cause="the device does not answer, or read always returns False",
                    advice="return True when the reading is new",
                )
            time.sleep(1e-4)  # let the other side answer
        self._seen = True
        if speaks:
            self.send()

    def exchange(self) -> None:
        """Read, and send the safe command."""
        self.device.read(self.reading)
        self.send()

    def send(self) -> None:
        """Send the safe command."""
        self.stay()
        if self.command:
            self.device.write(self.command)


class Shared:
    """A device that several checks use in turn, because opening it takes long; it is opened when it is first lent.

    While no check uses it, it is still read and sent the safe command, as in a session.
    """

    def __init__(self) -> None:
        self._opened: Opened | None = None
        self._idle = threading.Event()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    @contextlib.contextmanager
    def lent(self, harness: DeviceHarness) -> Iterator[Opened]:
        """Lend the open device."""
        if self._opened is None:
            self._opened = Opened(harness)
        self._idle.clear()
        with self._lock:
            self._opened.be_safe()
            yield self._opened
        self._idle.set()
        if self._thread is None:
            self._thread = threading.Thread(target=self._keep, name="keeping", daemon=True)
            self._thread.start()

    def _keep(self) -> None:
        while self._opened is not None:
            if self._idle.wait(0.1):
                with self._lock, contextlib.suppress(DeviceError):
                    if self._opened is not None and self._idle.is_set():
                        self._opened.exchange()
            time.sleep(5e-3)

    def end(self) -> None:
        """Close the device, if it was ever opened."""
        self._idle.clear()
        with self._lock:
            lent, self._opened = self._opened, None
        if self._thread is not None:
            self._thread.join(1.0)
            self._thread = None
        if lent is not None:
            with contextlib.suppress(DeviceError):
                lent.__exit__()


@contextlib.contextmanager
def emulated(harness: DeviceHarness) -> Iterator[tuple[Served, Opened]]:
    """Yield an emulator and the driver that is open on it: the shared pair, or a new one."""
    if harness.shared is not None:
        with harness.shared.lent(harness) as lent:
            yield lent.served, lent
        return
    with served(harness) as (emulator, there), Opened(there, emulator) as own:
        yield emulator, own


def elsewhere(params: Any) -> Any:
    """Return the parameters with a port or address where there is no device; None if they name no such place."""
    for name, value in _places(params):
        places = ("/dev/itouch-nowhere", "127.0.0.1:1")
        for nowhere in places if ":" not in value or "://" in value else reversed(places):
            with contextlib.suppress(ValueError):  # parameters may check the form of an address
                return replace(params, **{name: nowhere})
    return None


def _places(params: Any) -> list[tuple[str, str]]:
    """Return names and values of the parameters that say where a device is, those that are not empty first."""
    found = [(name, getattr(params, name, None)) for name in PLACES]
    return sorted(((name, value) for name, value in found if isinstance(value, str)), key=lambda one: not one[1])
