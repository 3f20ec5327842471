"""What an emulator must hold to: the driver, unmodified, sees through it what the twin does."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from itouch.plugin import DeviceError, Emulator, Field, Record
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.drivers import Opened
from itouch.testing.subject import PERIOD, DeviceSubject, TwinBench

#: Where the finger leads a device that tracks it, about a place that it can take [m], and time to go there [s].
_ABOUT = tuple(np.array(away) for away in ((0.0, 0.0, 0.0), (0.008, -0.005, 0.004), (-0.006, 0.007, -0.009)))
_SETTLE = 0.1


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


class Served:
    """An emulator that answers in a thread, with the twin behind it."""

    def __init__(self, subject: DeviceSubject) -> None:
        kind = subject.cls.Emulator
        if kind is None:
            raise NotApplicableError("the device class names no Emulator")
        self.subject = replace(subject, params=kind.somewhere(subject.require_params()), hardware=True)
        params = self.subject.params
        self.bench = TwinBench(self.subject, seed=1)
        self.emulator: Emulator = kind(params)
        reads, commands = subject.cls.channels(params)
        #: Whether it follows the finger; it is held then where the real device can be.
        self.tracks = any(c.name == "pose" for c in reads) and not any(c.name == "pose_target" for c in commands)
        if self.tracks:
            self.hold(kind.reachable(params))
        self.asked = Record.of(Field(c.name, "f8", c.size) for c in self.bench.commands)
        self.driven = False
        self.error: Exception | None = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Served:
        self.emulator.open()
        self._thread = threading.Thread(target=self._serve, name="emulator", daemon=True)
        self._thread.start()
        return self

    def _serve(self) -> None:
        try:
            while not self._stop.is_set():
                self.driven = self.emulator.serve(self.bench.tick * PERIOD, self.bench.reading, self.asked)
                if self.driven:
                    self.bench.command.raw[:] = self.asked.raw
                self.bench.step(driven=False)
                time.sleep(5e-4)
        except Exception as error:  # told by whoever waits
            self.error = error

    def hold(self, place: Sequence[float]) -> None:
        """Put the finger that holds the device at a place [m] in its frame."""
        self.bench.touch.finger_attached = True
        self.bench.touch.finger_pose[:3] = place

    def hang_up(self) -> None:
        """Take the device away."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(5.0)
            self._thread = None
            self.emulator.close()

    def __exit__(self, *_: object) -> None:
        self.hang_up()
        if self.error is not None:
            raise self.error


@contextlib.contextmanager
def served(subject: DeviceSubject) -> Iterator[tuple[Served, DeviceSubject]]:
    """Serve the emulator; yield it with a subject whose hardware can be opened."""
    with Served(subject) as emulator:
        yield emulator, emulator.subject


@check("twin-and-driver-agree", "the driver reads through the wire what the twin is")
def agree(subject: DeviceSubject) -> str:
    """Compare readings of the driver with those of the twin behind the wire; a finger leads what tracks it about."""
    with served(subject) as (emulator, open_subject), Opened(open_subject) as opened:
        opened.fresh(5.0)
        if not emulator.tracks:
            return f"within {100 * _agreed(emulator, opened):.0f} % of the tolerance"
        middle, worst = emulator.bench.touch.finger_pose[:3].copy(), 0.0
        for away in _ABOUT:
            emulator.hold(middle + away)
            time.sleep(_SETTLE)
            worst = max(worst, _agreed(emulator, opened))
        return f"within {100 * worst:.0f} % of the tolerance at {len(_ABOUT)} places"


def _agreed(emulator: Served, opened: Opened) -> float:
    """Wait until driver and twin agree; return how much of the tolerance is left between them."""
    deadline = time.perf_counter() + 5.0
    worst, where = 0.0, ""
    while time.perf_counter() < deadline:
        opened.device.read(opened.reading)
        worst, where = 0.0, ""
        for channel in emulator.bench.reads:
            theirs = emulator.bench.reading[channel.name]
            scale = max(1e-3, 0.02 * float(np.abs(theirs).max(initial=0.0)))
            difference = float(np.abs(opened.reading[channel.name] - theirs).max()) / scale
            if difference > worst:
                worst, where = difference, channel.name
        if worst <= 1.0:
            return worst
        time.sleep(0.01)
    raise _fail(
        f"'{where}' reads {opened.reading[where]} through the wire, the twin has {emulator.bench.reading[where]}",
        "another scale, frame or unit in driver or emulator",
        "convert at the wire: SI on our side",
    )


@check("disabled-is-still", "nothing is driven before the first command")
def still(subject: DeviceSubject) -> None:
    """Open and read; the emulator must not be driven to anything but its safe command."""
    with served(subject) as (emulator, open_subject), Opened(open_subject) as opened:
        for _ in range(20):
            with contextlib.suppress(CheckError):
                opened.fresh(0.2)
        for channel in emulator.bench.commands:
            if not isinstance(channel.safe, tuple) or not emulator.driven:
                continue
            asked = emulator.asked[channel.name]
            if np.abs(asked - np.array(channel.safe)).max() > 1e-6:
                raise _fail(
                    f"after open it drives '{channel.name}' to {asked}",
                    "open or read moves the device",
                    "only write may move it",
                )


@check("unplug", "a device that is unplugged is a DeviceError, soon, and close still works")
def unplug(subject: DeviceSubject) -> str:
    """Hang up while the driver reads."""
    with served(subject) as (emulator, open_subject):
        opened = Opened(open_subject)
        try:
            opened.fresh(5.0)
            emulator.hang_up()
            begin = time.perf_counter()
            while time.perf_counter() - begin < 3.0:
                try:
                    if opened.device.read(opened.reading) is False:
                        continue
                except DeviceError:
                    return f"told after {1e3 * (time.perf_counter() - begin):.0f} ms"
                if time.perf_counter() - begin > 1.0:
                    break
        finally:
            opened.device.close()
    if time.perf_counter() - begin >= 3.0:
        return "told as silence: the watchdog stops it"
    raise _fail(
        "it goes on reading from a device that is gone",
        "errors of the wire are swallowed",
        "raise DeviceError from read; or return False when nothing came",
    )
