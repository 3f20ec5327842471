"""What a device's driver must hold to, where it can be opened: a loop-back, or an emulator behind a port."""

from __future__ import annotations

import statistics
import threading
import time
from typing import Any

import numpy as np

from itouch.loop import Engine
from itouch.plugin import Device, DeviceError, Field, Record
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.subject import PERIOD, DeviceSubject
from itouch.testing.twins import _held_by
from itouch.world import Model


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


class Opened:
    """A device that is open, with records of its channels and a count of its own calls."""

    def __init__(self, subject: DeviceSubject) -> None:
        subject.require_hardware()
        self.device = subject.cls(subject.require_params())
        reads, commands = subject.cls.channels(subject.params)
        self.reading = Record.of(Field(c.name, "f8", c.size) for c in reads)
        self.command = Record.of(Field(c.name, "f8", c.size) for c in commands)
        for channel in commands:
            if isinstance(channel.safe, tuple):
                self.command[channel.name] = channel.safe
        self.device.open()

    def __enter__(self) -> Opened:
        return self

    def __exit__(self, *_: object) -> None:
        self.device.close()

    def fresh(self, patience: float = 1.0) -> None:
        """Read until there is something new."""
        deadline = time.perf_counter() + patience
        while self.device.read(self.reading) is False:
            if time.perf_counter() > deadline:
                raise _fail(
                    f"no new reading within {patience:g} s",
                    "the device does not answer, or read always returns False",
                    "return True when the reading is new",
                )


@check("driver-fills", "the driver fills every field of its reading")
def fills(subject: DeviceSubject) -> None:
    """Read into a record full of NaN."""
    with Opened(subject) as opened:
        opened.fresh()
        for view in opened.reading.values():
            view[...] = np.nan
        opened.fresh()
        for name, view in opened.reading.items():
            if np.isnan(view).any():
                raise _fail(
                    f"the field '{name}' was not filled by read", "a forgotten field", "write every field on every read"
                )
        if "pose" in opened.reading and abs(float(np.linalg.norm(opened.reading["pose"][3:])) - 1.0) > 1e-6:
            raise _fail(
                f"the quaternion is {opened.reading['pose'][3:]}",
                "it was left zero, or is x y z w",
                "write w x y z with unit length",
            )


@check("driver-keeps-nothing", "the driver keeps no record")
def keeps_nothing(subject: DeviceSubject) -> None:
    """Look whether the device still holds what it was given."""
    with Opened(subject) as opened:
        opened.fresh()
        _held_by(opened.device, opened.reading, "reading")
        if opened.command:
            opened.device.write(opened.command)
            _held_by(opened.device, opened.command, "command")


@check("writes-in-read", "reading sends no command of its own")
def writes_in_read(subject: DeviceSubject) -> None:
    """Count calls of ``write`` that the device makes by itself."""
    calls: list[str] = []

    class Counting(subject.cls):  # type: ignore[name-defined]
        def write(self, command: Record) -> None:
            calls.append("write")
            super().write(command)

    counted = DeviceSubject(Counting, subject.name, subject.params, hardware=subject.hardware)
    with Opened(counted) as opened:
        for _ in range(20):
            opened.device.read(opened.reading)
    if calls:
        raise _fail(
            "read calls write",
            "the last command is sent again from read",
            "safety lets commands through in write only; send there",
        )


@check("reopens", "open and close pair, again and again, and leave nothing behind")
def reopens(subject: DeviceSubject) -> None:
    """Open and close three times; count threads."""
    before = threading.active_count()
    for _ in range(3):
        with Opened(subject) as opened:
            opened.fresh()
    deadline = time.perf_counter() + 2.0
    while threading.active_count() > before and time.perf_counter() < deadline:
        time.sleep(0.02)
    if threading.active_count() > before:
        names = [thread.name for thread in threading.enumerate()][before:]
        raise _fail(
            f"a thread is left after close: {', '.join(names)}",
            "close does not end what open began",
            "a driver needs no thread: set blocking = True, and the framework brings one",
        )


@check("driver-timing", "a call of the driver fits in the tick, or the device says that it blocks")
def timing(subject: DeviceSubject) -> str:
    """Time reads; the figure is reported."""
    spent = []
    with Opened(subject) as opened:
        opened.fresh()
        for _ in range(60):
            begin = time.perf_counter()
            opened.device.read(opened.reading)
            if opened.command:
                opened.device.write(opened.command)
            spent.append(time.perf_counter() - begin)
    median, worst = statistics.median(spent), max(spent)
    if not subject.cls.blocking and median > 0.5 * PERIOD:
        raise _fail(
            f"an exchange takes {1e3 * median:.1f} ms",
            "it waits for the wire within the tick",
            "set blocking = True on the class: the framework then reads it in a thread",
        )
    if worst > 2.0:
        raise _fail(f"an exchange took {worst:.1f} s", "a wait without a time limit", "give every wait a timeout")
    return f"exchange p50 {1e3 * median:.2f} ms, worst {1e3 * worst:.2f} ms"


def _counting(subject: DeviceSubject, fail_at: int = 0) -> tuple[DeviceSubject, list[str]]:
    """Return the subject with a class that counts its calls, and fails in a write if told."""
    calls: list[str] = []

    class Counting(subject.cls):  # type: ignore[name-defined]
        def open(self) -> None:
            super().open()
            calls.append("open")

        def close(self) -> None:
            calls.append("close")
            super().close()

        def read(self, reading: Record) -> bool | None:
            calls.append("read")
            if fail_at and calls.count("read") >= fail_at:
                raise DeviceError("told to fail")
            return super().read(reading)  # type: ignore[no-any-return]

        def write(self, command: Record) -> None:
            calls.append("write")
            super().write(command)

    return DeviceSubject(Counting, subject.name, subject.params, hardware=subject.hardware), calls


def _engine(subject: DeviceSubject) -> Engine:
    return Engine(Model.of(subject.scene(twin=False), subject.catalog))


def _held_run(engine: Engine, seconds: float) -> None:
    """Enable and run with the dead-man's switch held."""
    engine.hold(True)
    engine.enable()
    engine.run(seconds, each=lambda: engine.hold(True), every=10)


def _paired(calls: list[str]) -> None:
    opened, closed = calls.count("open"), calls.count("close")
    if opened != closed:
        raise _fail(
            f"opened {opened} times, closed {closed} times",
            "close raised, or was never reached",
            "close must always succeed, whatever happened before",
        )
    if "close" in calls and any(call in ("read", "write") for call in calls[calls.index("close") + 1 :]):
        raise _fail("a call came after close", "a thread of the driver's own", "leave threads to the framework")


@check("lifecycle", "open, read, write, close come in order, and close exactly once")
def lifecycle(subject: DeviceSubject) -> None:
    """Run it in an engine."""
    subject.require_hardware()
    counted, calls = _counting(subject)
    engine = _engine(counted)
    try:
        _held_run(engine, 0.05)
    finally:
        engine.close()
    engine.close()
    _paired(calls)


@check("safe-on-exception", "a driver that fails is made safe, closed once, and named")
def safe_on_exception(subject: DeviceSubject) -> None:
    """Let the tenth read fail."""
    subject.require_hardware()
    counted, calls = _counting(subject, fail_at=10)
    engine = _engine(counted)
    caught = ""
    try:
        _held_run(engine, 0.5)
    except Exception as error:  # the kind is what is examined
        caught = str(error)
        if not isinstance(error, (DeviceError,)) and type(error).__name__ != "DeviceFaultError":
            raise
    finally:
        engine.close()
    if "told to fail" not in caught:
        raise _fail(
            f"a failing read was told as '{caught or 'nothing'}'",
            "the driver swallows errors",
            "let DeviceError through",
        )
    _paired(calls)


@check("errors-are-named", "a device that is not there is a DeviceError that says what to do")
def errors_are_named(subject: DeviceSubject) -> None:
    """Open where there is nothing, if the parameters can say so."""
    params = _elsewhere(subject.require_params())
    if params is None:
        raise NotApplicableError("no parameter names a port, a path or a host")
    device: Device = subject.cls(params)
    try:
        device.open()
    except DeviceError as error:
        if len(str(error)) < 10:
            raise _fail(
                f"the message is '{error}'",
                "the cause was not passed on",
                "say what is missing, and what to do about it",
            ) from error
        return
    except Exception as error:
        raise _fail(
            f"opening at nowhere raised {type(error).__name__}: {error}",
            "a library's error came through",
            "raise DeviceError(what to do) from error",
        ) from error
    device.close()
    raise _fail(
        "opening at nowhere succeeds", "open does not open", "find the device in open(), and say if it is missing"
    )


def _elsewhere(params: Any) -> Any:
    from dataclasses import replace

    for name in ("port", "path", "device", "serial_port"):
        if isinstance(getattr(params, name, None), str):
            return replace(params, **{name: "/dev/itouch-nowhere"})
    return None


@check("transcript", "the wire carries what the golden transcript says")
def transcript(subject: DeviceSubject) -> str:
    """Record a trace of opening and ten exchanges, and compare the bytes that were sent."""
    if subject.transcript is None:
        raise NotApplicableError("no golden transcript was given: set `transcript` in the suite")
    import io

    from itouch.plugin import Trace, read_trace

    stream = io.StringIO()
    subject.require_hardware()
    device = subject.cls(subject.require_params())
    device.trace = Trace(stream, "unit")
    reads, _ = subject.cls.channels(subject.params)
    reading = Record.of(Field(c.name, "f8", c.size) for c in reads)
    device.open()
    try:
        for _ in range(10):
            device.read(reading)
    finally:
        device.close()
    sent = [entry.data for entry in read_trace(stream.getvalue().splitlines()) if entry.mark == ">"]
    with open(subject.transcript, encoding="utf-8") as golden:
        wanted = [entry.data for entry in read_trace(golden) if entry.mark == ">"]
    for index, (ours, theirs) in enumerate(zip(sent, wanted, strict=False)):
        if ours != theirs:
            raise _fail(
                f"transfer {index} sends {ours.hex(' ')}, the transcript has {theirs.hex(' ')}",
                "the protocol has changed",
                "if that is meant, record the transcript anew",
            )
    return f"{min(len(sent), len(wanted))} transfers"
