"""``run`` in real time: the loop runs in a servo process, and this process only shows what that publishes."""

from __future__ import annotations

import argparse
import sys
import time
from functools import cached_property
from typing import TYPE_CHECKING, Any

from itouch.schema import ItouchError
from itouch.schema.terminal import did, note
from itouch.schema.wait_notices import waiting
from itouch_tools.cli import deprecations, windows
from itouch_tools.cli.shutdown import Interrupted, Stopping, write_report
from itouch_tools.viewer.fault_messages import told

if TYPE_CHECKING:
    from itouch.loop.timing import Timing
    from itouch.plugin import Record
    from itouch.servo import Handle
    from itouch.session import Session
    from itouch.world import Model
    from itouch_tools.cli.arm_input import GamepadInput
    from itouch_tools.report.screen import Screen

#: Period [s] at which the terminal is updated.
_EVERY = 0.05
#: Period [s] at which a gamepad is read.
_LOOK = 0.01

#: Seconds without anybody holding the switch after which this is said again, and after which the session ends.
AGAIN, PATIENCE = 30.0, 120.0


def needed(session: Session) -> bool:
    """Tell whether a session must run in real time: hardware and remote twins have clocks of their own."""
    return any(not device.twin or device.remote for device in session.model.devices.values())


def run(
    options: argparse.Namespace, stop: Stopping, *, window: bool = False, gamepad: GamepadInput | None = None
) -> int:
    """Run in real time, in a window if that is asked for, or led by a gamepad, and return the exit code."""
    from itouch.servo import ServoError
    from itouch_tools.cli import arm_input

    for option in ("screenshot", "film", "wav"):
        if getattr(options, option, None):
            named = option.replace("_", "-")
            raise ItouchError(f"--{named} needs --pace fast: in real time a window or an attached process does that")
    handle = _launched(options, stop, window=window)
    windows.tell(options, opened=window)
    with handle:
        try:
            if not window and gamepad is None:
                gamepad = arm_input.without_window(Shown(handle).model, real=True)
            code, error = _follow(handle, stop, window=window, mute=options.mute, gamepad=gamepad)
            write_report(options.report, handle.report)
            if error is not None:
                raise error
        except ServoError as error:  # the servo process died, and left no report
            print(error, file=sys.stderr)
            return 1
        finally:
            if gamepad is not None:
                gamepad.close()
    if options.save:
        did(f"saved {options.save}")
    return code


def _launched(options: argparse.Namespace, stop: Stopping, *, window: bool) -> Handle:
    """Start the session and return its handle once it is built; from then on, signals ask it to end.

    Raises
    ------
    Interrupted
        If a signal came before it was built.
    SceneError, SessionError, ServoError
        If it can't be built.
    """
    from itouch.servo import launching
    from itouch_tools.cli import output_options

    config = launching.configured(
        options.scene, seed=options.seed, twin=options.twin, rig=options.rig, seconds=options.duration,
        save=options.save, enable=not window, linger=window, keep=output_options.wanted(options),
    )  # fmt: skip
    with waiting(f"starting {options.scene}"):
        handle = launching.begin(launching.named(config["scene"]), config)
        try:
            handle.await_ready()
            stop.bind(handle.request_stop)
        except Interrupted:
            stop.bind(handle.request_stop)
            handle.end()
            if not handle.built:
                handle.close()
                raise
            # otherwise it has ended as at any other time: devices may have been enabled by then
    return handle


def _follow(
    handle: Handle, stop: Stopping, *, window: bool, mute: bool, gamepad: GamepadInput | None
) -> tuple[int, ItouchError | None]:
    """Show the session until it ends, on the terminal and in a window if that is asked for.

    Return the exit code, and the error if something other than a device failed: the session's report is written first.
    """
    from itouch.loop import DeviceFaultError
    from itouch_tools.report.screen import Screen

    for notice in handle.notices:
        note(notice)
    shown = Shown(handle)
    deprecations.warn(shown.model)
    screen = Screen(shown, sys.stdout)
    held = Waiting(handle, shown.model) if not window else None
    losses = Losses(handle, screen)
    show = stop.listened(screen.show)
    code, error = 0, None

    def look() -> None:
        screen.show()
        losses.look()

    try:
        if window:
            windows.show(handle, look, mute=mute)
        while not handle.wait(_EVERY if gamepad is None else _LOOK):
            show()
            losses.look()
            if held is not None:
                held.look()
            if handle.faults:  # there is no window in which a person could see the fault and re-arm
                handle.request_stop()
            if gamepad is not None:
                gamepad.lead(handle)
    except DeviceFaultError:
        code = 1
    except ItouchError as raised:
        error = raised
    stop.listened(screen.finish)(handle.report())
    return (code if code or error is not None else stop.code(0)), error


class Losses:
    """Says on the terminal, at once, what of a session is no longer being kept."""

    def __init__(self, handle: Handle, screen: Screen) -> None:
        self._handle, self._screen, self._told = handle, screen, 0

    def look(self) -> None:
        """Print the losses that are new."""
        for loss in self._handle.losses[self._told :]:
            self._screen.interrupt(told(loss))
            self._told += 1


class _Contacts:
    def __init__(self, handle: Handle) -> None:
        self._handle = handle

    @property
    def contacts(self) -> list[dict[str, Any]]:
        """The contacts that have ended."""
        return self._handle.contacts


class _RealClock:
    pace = "real"


class Shown:
    """A session in a servo process, as a terminal shows it: its published State, with the attributes of an engine."""

    def __init__(self, handle: Handle) -> None:
        self._handle = handle
        self.statistics = _Contacts(handle)
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
        """The compiled scene, compiled when it is first needed."""
        from itouch.plugin.discovery import Catalog
        from itouch.world import Model

        return Model.of(self._handle.link.scene(), Catalog())


class Waiting:
    """Watches, where there is no window, whether a session waits for the dead-man's switch."""

    def __init__(self, handle: Handle, model: Model, *, again: float = AGAIN, patience: float = PATIENCE) -> None:
        self._handle, self._model, self._again, self._patience = handle, model, again, patience
        self._begun: float | None = None
        self._next = 0.0
        self._over = False

    def look(self) -> None:
        """Print what the session waits for; end it if nobody has held a switch for too long.

        Raises
        ------
        ItouchError
            When the session is ended; it says what to do.
        """
        if self._over or self._handle.link.phase != "ready" or self._has_a_switch():
            self._over = True
            return
        now = time.monotonic()
        if self._begun is None:
            self._begun, self._next = now, 0.0
        waited = now - self._begun
        if waited >= self._patience:
            self._over = True
            self._handle.request_stop()
            raise ItouchError(f"nobody held a dead-man's switch for {self._patience:.0f} s: nothing was enabled\n"
                              f"  = help: {self._advice()}")  # fmt: skip
        if waited >= self._next:
            self._next += self._again
            hardware = ", ".join(f"'{d.name}'" for d in self._model.devices.values() if not d.twin)
            print(f"waiting: {hardware or 'the devices'} will move or heat for real, and nobody holds a dead-man's "
                  f"switch; {self._advice()}; Ctrl-C ends this", file=sys.stderr, flush=True)  # fmt: skip

    def _has_a_switch(self) -> bool:
        from itouch.plugin import Role

        return any(device.reading(Role.DEADMAN) is not None for device in self._model.devices.values())

    def _advice(self) -> str:
        return (
            f"hold Space in a window of it (itouch-py view {self._handle.name}), or give a device a switch of its own "
            '(for example deadman="centre" on <usb-arm:hardware>)'
        )
