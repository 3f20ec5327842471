"""Checks of a device's driver, where it can be opened: on the device, a loop-back, or an emulator behind a port."""

from __future__ import annotations

import gc
import threading
import time
from typing import Any

import numpy as np

from itouch.loop import Engine
from itouch.loop.clock import WallClock
from itouch.loop.device_runner import DeviceFaultError
from itouch.plugin import Device, DeviceError, Field, Record, Role
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.child_process import described
from itouch.testing.harness import DeviceHarness
from itouch.testing.open_device import Opened, elsewhere
from itouch.testing.process_state import children, native_threads, open_files
from itouch.testing.workload import opened
from itouch.world import Model

#: How long [s] threads may take to end, and to close what they have open, after close or an open that failed.
_ENDING = 1.0


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


@check("driver-fills", "the driver fills its whole reading, always")
def fills(harness: DeviceHarness) -> None:
    """Read into a record full of NaN, several times."""
    with opened(harness) as device:
        device.fresh()
        pose = next((c.name for c in device.reads if c.role is Role.TRACKED_POSE), "")
        for _ in range(30):
            for view in device.reading.values():
                view[...] = np.nan
            device.fresh()
            _filled(device.reading, pose)


def _filled(reading: Record, pose: str) -> None:
    for name, view in reading.items():
        if np.isnan(view).any():
            raise _fail(
                f"the field '{name}' was not filled by read, which is {view}",
                "a forgotten field, or a NaN in place of a DeviceError",
                "write every field on every read that returns True",
            )
    if pose and abs(float(np.linalg.norm(reading[pose][3:])) - 1.0) > 1e-6:
        raise _fail(
            f"the quaternion is {reading[pose][3:]}",
            "it was left zero, or is x y z w",
            "write w x y z with unit length",
        )


@check("writes-in-read", "reading sends no command of its own")
def writes_in_read(harness: DeviceHarness) -> None:
    """Count the calls of ``write`` that the device makes by itself while it is read."""
    calls: list[str] = []

    def write(command: Record) -> None:
        calls.append("write")

    with opened(harness) as device:
        device.exchange()
        kept = device.device.write
        try:
            device.device.write = write  # type: ignore[method-assign]
        except AttributeError as error:
            raise NotApplicableError("its class has slots") from error
        try:
            for _ in range(20):
                device.device.read(device.reading)
        finally:
            device.device.write = kept  # type: ignore[method-assign]
    if calls:
        raise _fail(
            "read calls write",
            "the last command is sent again from read",
            "safety lets commands through in write only; send there",
        )


@check("reopens", "open and close pair, and leave nothing")
def reopens(harness: DeviceHarness) -> None:
    """Open and close; count threads, files and processes; open the same object again."""
    harness.require_hardware()
    cycles = 1 if harness.shared is not None else 4
    if harness.shared is None:
        _cycle(harness)
    first = _left()
    threads = [_cycle(harness) for _ in range(cycles)]
    _compare_left(first, _left(), cycles)
    if cycles > 1 and all(threads):
        raise _fail(
            f"{sum(map(len, threads))} threads that Python does not know are left after {cycles} times open and close",
            "a library's threads, or _thread.start_new_thread",
            "end in close() what open() began",
        )
    if not harness.emulated:
        _same_again(harness)


def _cycle(harness: DeviceHarness) -> set[int]:
    """Open and close once; return the threads unknown to Python that are left.

    They are identified by number after each close: a count over several cycles would be wrong as soon as a thread of an
    earlier cycle ends in between, which depends on how busy the machine is.
    """
    before, native = threading.enumerate(), native_threads()
    device = Opened(harness)
    try:
        device.fresh(5.0)
    finally:
        _close(device)
    deadline = time.perf_counter() + 2.0
    left = [thread for thread in threading.enumerate() if thread not in before]
    while left and time.perf_counter() < deadline:
        time.sleep(0.02)
        left = [thread for thread in left if thread.is_alive()]
    if left:
        raise _fail(
            f"a thread is left after close: {', '.join(thread.name for thread in left)}",
            "close does not end what open began",
            "end it and join it in close; for waiting, no thread is needed: set blocking = True",
        )
    return _settled(native)


def _settled(before: set[int]) -> set[int]:
    """Return the threads that are new, after waiting for those that are just ending."""
    deadline = time.perf_counter() + _ENDING
    new = native_threads() - before
    while new and time.perf_counter() < deadline:
        time.sleep(0.02)
        new &= native_threads()
    return new


def _close(device: Opened) -> None:
    try:
        device.__exit__()
    except Exception as error:  # whatever the plugin's code raises
        raise _fail(
            f"close raised {described(error)}",
            "something was closed twice, or is gone already",
            "close must always succeed, whatever happened before",
        ) from error


def _left() -> tuple[dict[str, str], set[int]]:
    gc.collect()
    return open_files(), children()


def _compare_left(first: Any, last: Any, cycles: int) -> None:
    files = [what for number, what in last[0].items() if number not in first[0]]
    if len(files) >= cycles:
        raise _fail(
            f"{len(files)} files are left open after {cycles} times open and close, the last is {files[-1]}",
            "close does not close the port, or open opens two",
            "close in close() what open() opened",
        )
    if len(last[1] - first[1]) >= cycles:
        raise _fail(
            f"{len(last[1] - first[1])} processes are left after {cycles} times open and close",
            "a program that open started goes on",
            "end it and wait for it in close()",
        )


def _same_again(harness: DeviceHarness) -> None:
    device: Device = harness.cls(harness.require_params())
    for turn in ("first", "second"):
        try:
            device.open()
        except Exception as error:
            raise _fail(
                f"the same object can't be opened a {turn} time: {described(error)}",
                "something that open needs was used up",
                "a device that was lost is closed and opened again: set in open() all that open needs",
            ) from error
        device.close()


def _counting(harness: DeviceHarness, fail_at: int = 0) -> tuple[DeviceHarness, list[str]]:
    """Return the harness with a class that lists its calls; from read number ``fail_at`` on, if given, reads fail."""
    calls: list[str] = []

    class Counting(harness.cls):  # type: ignore[name-defined]
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

    return DeviceHarness(Counting, harness.name, harness.params, hardware=harness.hardware), calls


def _require_in_step(harness: DeviceHarness) -> None:
    """Leave the check out on an emulator, as the engine's time is simulated here and the emulator's is not."""
    if not harness.hardware:
        raise NotApplicableError("needs the device or a loop-back: `hardware = True`, or --hardware")


def _engine(harness: DeviceHarness) -> Engine:
    model = Model.of(harness.scene(twin=False), harness.catalog)
    return Engine(model, clock=WallClock() if harness.cls.blocking else None)  # its thread lives in real time


def _held_run(engine: Engine, seconds: float) -> None:
    """Enable, and run for ``seconds`` [s] with the dead-man's switch held."""
    engine.hold(True)
    engine.enable()
    engine.hold(True)  # opening may have taken longer than one hold is good for
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


@check("lifecycle", "open, read, write, close in order, once")
def lifecycle(harness: DeviceHarness) -> None:
    """Run it in an engine."""
    _require_in_step(harness)
    counted, calls = _counting(harness)
    engine = _engine(counted)
    try:
        _held_run(engine, 0.05)
    except DeviceFaultError as error:
        if not harness.cls.blocking or "silent" not in str(error):  # on a busy machine it may be late
            raise
    finally:
        engine.close()
    engine.close()
    _paired(calls)


@check("safe-on-exception", "a failing driver is closed once, and named")
def safe_on_exception(harness: DeviceHarness) -> None:
    """Let the tenth read fail."""
    _require_in_step(harness)
    for _ in range(3):
        counted, calls = _counting(harness, fail_at=10)
        caught = _fault(counted)
        if not harness.cls.blocking or "silent" not in caught:  # on a busy machine it may be late
            break
    if "told to fail" not in caught:
        raise _fail(
            f"a failing read was reported as '{caught or 'nothing'}'",
            "the driver swallows errors",
            "let DeviceError through",
        )
    _paired(calls)


def _fault(harness: DeviceHarness) -> str:
    """Run until a device fails; return the message."""
    engine = _engine(harness)
    try:
        _held_run(engine, max(0.5, 12.0 * harness.cls.period))
    except (DeviceError, DeviceFaultError) as error:
        return str(error)
    finally:
        engine.close()
    return ""


@check("errors-are-named", "a missing device is a DeviceError")
def errors_are_named(harness: DeviceHarness) -> None:
    """Open the driver where there is no device, if a parameter can say so."""
    params = elsewhere(harness.require_params())
    if params is None:
        raise NotApplicableError("no parameter names a port, a path or a host")
    device: Device = harness.cls(params)
    before = open_files()
    try:
        device.open()
    except DeviceError as error:
        _nothing_kept(before)
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


def _nothing_kept(before: dict[str, str]) -> None:
    """Check that nothing stays open; what the emulator's own threads still have open, they get a second to close."""
    gc.collect()
    until = time.monotonic() + _ENDING
    while files := [what for number, what in open_files().items() if number not in before]:
        if time.monotonic() < until:
            time.sleep(0.01)
            continue
        raise _fail(
            f"an open that fails leaves {files[0]} open",
            "what was opened before the failure is forgotten",
            "close it where open gives up: close() is not called after an open that failed",
        )


@check("transcript", "the wire carries the golden transcript")
def transcript(harness: DeviceHarness) -> str:
    """Record a trace of opening and ten exchanges, and compare the bytes that were sent."""
    if harness.transcript is None:
        raise NotApplicableError("no golden transcript was given: set `transcript` in the suite")
    import io

    from itouch.plugin import Trace, read_trace

    stream = io.StringIO()
    harness.require_hardware()
    device = harness.cls(harness.require_params())
    device.trace = Trace(stream, "unit")
    reads, _ = harness.cls.channels(harness.params)
    reading = Record.of(Field.of(c) for c in reads)
    device.open()
    try:
        for _ in range(10):
            device.read(reading)
    finally:
        device.close()
    sent = [entry.data for entry in read_trace(stream.getvalue().splitlines()) if entry.mark == ">"]
    with open(harness.transcript, encoding="utf-8") as golden:
        wanted = [entry.data for entry in read_trace(golden) if entry.mark == ">"]
    for index, (ours, theirs) in enumerate(zip(sent, wanted, strict=False)):
        if ours != theirs:
            raise _fail(
                f"transfer {index} sends {ours.hex(' ')}, the transcript has {theirs.hex(' ')}",
                "the protocol has changed",
                "if that is meant, record the transcript again",
            )
    return f"{min(len(sent), len(wanted))} transfers"
