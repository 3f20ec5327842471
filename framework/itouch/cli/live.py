"""``run`` in real time: the loop runs in a servo process of its own, and this process only shows what it publishes."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from functools import cached_property
from typing import TYPE_CHECKING, Any

from itouch.schema import ItouchError

if TYPE_CHECKING:
    from itouch.loop.timing import Timing
    from itouch.plugin import Record
    from itouch.servo import Handle
    from itouch.session import Session
    from itouch.world import Model

#: How often [s] the terminal is brought up to date.
_EVERY = 0.05


def needed(session: Session) -> bool:
    """Return whether a session must run in real time: hardware and remote twins have clocks of their own."""
    return any(not device.twin or device.remote for device in session.model.devices.values())


def run(options: argparse.Namespace, *, window: bool = False) -> int:
    """Run in real time, in a window if that is asked for, and return the exit code."""
    from itouch.cli import keeping
    from itouch.servo import ServoError, launch

    if not 0 <= options.seed < 1 << 63:
        raise ItouchError(f"--seed {options.seed} is out of range: 0 to 2^63 - 1")
    for option in ("screenshot", "film", "wav"):
        if getattr(options, option, None):
            named = option.replace("_", "-")
            raise ItouchError(f"--{named} needs --pace fast: in real time a window or an attached process does that")
    handle = launch(
        options.scene, seed=options.seed, twin=options.twin, rig=options.rig, seconds=options.duration,
        save=options.save, enable=not window, keep=keeping.wanted(options),
    )  # fmt: skip
    with handle:
        if window:
            from itouch.cli import windows

            windows.show(handle, mute=options.mute)
        try:
            code = _follow(handle)
            _report(handle, options.report)
        except ServoError as error:  # it died, and has left no report
            print(error, file=sys.stderr)
            return 1
    if options.save:
        print(f"saved {options.save}")
    return code


def _follow(handle: Handle) -> int:
    """Show the session until it ends; return the exit code."""
    from itouch.loop import DeviceFaultError
    from itouch.report.screen import Screen

    for notice in handle.notices:
        print(f"note: {notice}", file=sys.stderr)
    screen = Screen(Shown(handle), sys.stdout)
    stop = _Stop(handle)
    with stop:
        try:
            while not handle.wait(_EVERY):
                screen.show()
        except DeviceFaultError:
            screen.finish(handle.report())
            return 1
    screen.finish(handle.report())
    if stop.signal:
        print(f"stopped by {signal.Signals(stop.signal).name}; the devices are safe", file=sys.stderr)
        return 128 + stop.signal
    return 0


def _report(handle: Handle, path: str | None) -> None:
    if path is None:
        return
    try:
        with open(path, "w", encoding="utf-8") as stream:
            json.dump(handle.report(), stream, indent=1, allow_nan=False)
            stream.write("\n")
    except OSError as error:
        raise ItouchError(f"cannot write '{path}': {error.strerror or error}") from error


class _Stop:
    """Lets Ctrl-C, SIGTERM and SIGHUP end the session safely."""

    def __init__(self, handle: Handle) -> None:
        self._handle = handle
        self.signal = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> None:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                self._before[number] = signal.signal(number, self._note)

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: object) -> None:
        self.signal = number
        self._handle.request_stop()


class _Contacts:
    def __init__(self, handle: Handle) -> None:
        self._handle = handle

    @property
    def contacts(self) -> list[dict[str, Any]]:
        """Those that have ended."""
        return self._handle.contacts


class _RealClock:
    pace = "real"


class Shown:
    """What a terminal shows of a session elsewhere: its published State under the names of an engine."""

    def __init__(self, handle: Handle) -> None:
        self._handle = handle
        self.ledger = _Contacts(handle)
        self.clock = _RealClock()

    @property
    def seconds(self) -> float:
        """Simulated time [s]."""
        return self._handle.seconds

    @property
    def state(self) -> Record:
        """The last published State."""
        return self._handle.state

    @property
    def times(self) -> Timing:
        """The last published Timing."""
        return self._handle.timing

    @cached_property
    def model(self) -> Model:
        """The compiled scene, made when it is first shown."""
        from itouch.plugin.discovery import Catalog
        from itouch.world import Model

        return Model.of(self._handle.link.scene(), Catalog())
