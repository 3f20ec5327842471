"""Plugins that misbehave towards the process in which they run, by the check that must find it."""

from __future__ import annotations

import _thread
import asyncio
import builtins
import contextlib
import gc
import locale
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from dataclasses import dataclass

import numpy as np
from bad import bad, with_twin
from slider import Slider, SliderParams, SliderTwin

from itouch.plugin import DeviceError, Record, schema, wrench


@with_twin("survives")
class ExitsInAStep(SliderTwin):
    def step(self, state, command, touch, period):
        sys.exit(0)


@with_twin("survives")
class EndsTheProcess(SliderTwin):
    def read(self, state, reading):
        os._exit(0)


@with_twin("survives")
class Crashes(SliderTwin):
    def step(self, state, command, touch, period):
        os.kill(os.getpid(), signal.SIGSEGV)


class AbandonShip(BaseException):
    """An exception of its own kind."""


@with_twin("survives")
class RaisesItsOwnKind(SliderTwin):
    def step(self, state, command, touch, period):
        raise AbandonShip("all hands")


@bad("survives")
class DriverInterruptsItself(Slider):
    def read(self, reading: Record) -> bool:
        raise KeyboardInterrupt


@bad("survives")
class DriverIsCancelled(Slider):
    def read(self, reading: Record) -> bool:
        raise asyncio.CancelledError


@bad("quiet")
class PrintsEachTick(Slider):
    def read(self, reading: Record) -> bool:
        print("reading")
        return super().read(reading)


@with_twin("quiet")
class TwinWritesToStandardError(SliderTwin):
    def step(self, state, command, touch, period):
        os.write(2, b"step\n")
        super().step(state, command, touch, period)


@with_twin("quiet")
class WarnsEachTick(SliderTwin):
    def step(self, state, command, touch, period):
        import logging

        logging.getLogger("slider").warning("step")
        super().step(state, command, touch, period)


def surroundings(what: str):
    """Make a device that spoils the process in open, and a twin that does in its step."""

    def note(spoil):
        def open_(self):
            Slider.open(self)
            spoil()

        def step(self, state, command, touch, period):
            spoil()
            SliderTwin.step(self, state, command, touch, period)

        name = spoil.__name__.title().replace("_", "")
        for_driver = type(f"Driver{name}", (Slider,), {"open": open_, "__doc__": what, "__module__": __name__})
        bad("surroundings")(for_driver)
        with_twin("surroundings")(type(f"Twin{name}", (SliderTwin,), {"step": step, "__module__": __name__}))
        return spoil

    return note


@surroundings("It goes elsewhere.")
def changes_the_folder():
    os.chdir("/")


@surroundings("It sets variables.")
def sets_the_environment():
    os.environ["SLIDER"] = "1"


@surroundings("It hears signals.")
def handles_signals():
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)


@surroundings("It turns the collector off.")
def stops_the_collector():
    gc.disable()


@surroundings("It silences NumPy.")
def silences_numpy():
    np.seterr(all="ignore")


@surroundings("It silences warnings.")
def silences_warnings():
    warnings.simplefilter("ignore")


@surroundings("It changes the language.")
def changes_the_locale():
    locale.setlocale(locale.LC_ALL, "C.UTF-8" if locale.setlocale(locale.LC_ALL) == "C" else "C")


@surroundings("It changes rights.")
def changes_the_mask():
    os.umask(0o077 if os.umask(0) != 0o077 else 0o027)


@surroundings("It patches a built-in.")
def patches_a_builtin():
    builtins.open = lambda *a, real=open, **k: real(*a, **k)


@surroundings("It patches the clock.")
def patches_the_clock():
    time.sleep = lambda seconds: None


@surroundings("It listens to errors.")
def hooks_errors():
    sys.excepthook = lambda *_: None


@with_twin("surroundings")
class TwinStartsAThread(SliderTwin):
    def reset(self, state, rng):
        super().reset(state, rng)
        threading.Thread(target=time.sleep, args=(3.0,), daemon=True).start()


LINES: list = []


@with_twin("surroundings")
class TwinOpensASocket(SliderTwin):
    def reset(self, state, rng):
        super().reset(state, rng)
        LINES.append(socket.socket())


@bad("reopens")
class LeaksAFile(Slider):
    held: list = []

    def open(self) -> None:
        super().open()
        self.held.append(os.open("/dev/null", os.O_RDONLY))


@bad("reopens")
class LeaksAProcess(Slider):
    held: list = []

    def open(self) -> None:
        super().open()
        self.held.append(subprocess.Popen(["sleep", "5"]))


@bad("reopens")
class LeaksANativeThread(Slider):
    def open(self) -> None:
        super().open()
        _thread.start_new_thread(time.sleep, (5.0,))


@bad("reopens")
class OpensOnlyOnce(Slider):
    def __init__(self, params) -> None:
        super().__init__(params)
        self.unused = [True]

    def open(self) -> None:
        if not self.unused.pop():
            raise DeviceError("used up")
        super().open()


@bad("reopens")
class ClosesWithAnError(Slider):
    def close(self) -> None:
        super().close()
        raise OSError("already closed")


@bad("errors-are-named")
class LeaksWhenItFails(Slider):
    def open(self) -> None:
        self.spare = os.open("/dev/null", os.O_RDONLY)
        super().open()


@bad("errors-come-through")
class SwallowsEverythingInRead(Slider):
    def read(self, reading: Record) -> bool:
        try:
            return super().read(reading)
        except BaseException:
            return True


@bad("errors-come-through")
class SwallowsErrorsInWrite(Slider):
    def write(self, command: Record) -> None:
        with contextlib.suppress(Exception):
            self.last = float(command["wrench"][2])


@with_twin("errors-come-through")
class TwinSwallowsCtrlC(SliderTwin):
    def step(self, state, command, touch, period):
        with contextlib.suppress(KeyboardInterrupt):
            super().step(state, command, touch, period)


@with_twin("errors-come-through")
class TwinSwallowsErrors(SliderTwin):
    def step(self, state, command, touch, period):
        try:
            super().step(state, command, touch, period)
        except Exception:
            return


@with_twin("params-untouched")
class ChangesItsParameters(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        object.__setattr__(self.params, "travel", self.params.travel * 1.001)


@dataclass(frozen=True)
class LimitedParams(SliderParams):
    """Parameters with a limit."""

    max_force: float = schema.quantity("N", low=0.5, high=10.0, default=5.0, doc="greatest force")


@bad("limits-of-params")
class IgnoresItsLimit(Slider):
    Params = LimitedParams
    commands = (wrench(force=5.0, locked=(0, 1, 3, 4, 5)),)


@with_twin("opens-nothing")
class WritesALog(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        with open(os.devnull, "a") as log:
            log.write("step\n")


@with_twin("opens-nothing")
class AsksASettingsFile(SliderTwin):
    def read(self, state, reading):
        os.listdir("/")
        return super().read(state, reading)


@with_twin("opens-nothing")
class SleepsNowAndThen(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        if touch.force > 0.999:
            time.sleep(1e-6)


@with_twin("twin-timing")
class WaitsNowAndThen(SliderTwin):
    count = 0

    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        type(self).count += 1
        if self.count % 50 == 0:
            time.sleep(0.003)


@with_twin("twin-timing")
class ComputesTooMuch(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        sum(range(60_000))


@with_twin("steady")
class TakesLongerAndLonger(SliderTwin):
    def __init__(self, params) -> None:
        super().__init__(params)
        self.past = np.zeros(100_000)
        self.when = np.zeros(1, int)

    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        self.past[self.when[0]] = touch.force
        self.when[0] += 1
        sum(self.past[: self.when[0]].tolist())


@with_twin("steady")
class MakesCircles(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        circle = [1.0]
        circle.append(circle)


@with_twin("allocates-nothing")
class TakesMuchMemory(SliderTwin):
    def step(self, state, command, touch, period):
        super().step(state, command, touch, period)
        np.zeros(50_000)[0] = 1.0


@bad("allocates-nothing")
class DriverKeepsALog(Slider):
    log: list = []

    def read(self, reading: Record) -> bool:
        self.log.append(bytes(2000))
        return super().read(reading)


@bad("lets-others-run")
class ComputesWhileItWaits(Slider):
    blocking = True

    def read(self, reading: Record) -> bool:
        begin = time.thread_time()
        while time.thread_time() - begin < 0.01:
            pass
        return super().read(reading)


@bad("driver-timing")
class BlocksNowAndThen(Slider):
    count = 0

    def read(self, reading: Record) -> bool:
        type(self).count += 1
        if self.count % 20 == 0:
            time.sleep(0.01)
        return super().read(reading)
