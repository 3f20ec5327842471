"""Checks that a plugin keeps nothing of what it is given, and that its memory does not grow."""

from __future__ import annotations

import gc
import math
import tracemalloc
import types
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

from itouch.plugin import Record, TwinInputs
from itouch.testing.checks import CheckError, check
from itouch.testing.harness import PERIOD, DeviceHarness
from itouch.testing.hygiene import Harness
from itouch.testing.workload import opened, workloads

#: Bytes by which memory may grow per tick, and that may be allocated and freed within one.
_GROWTH, _WITHIN = 12.0, 16_000


def _kept(watched: weakref.ref[Any], what: str) -> CheckError | None:
    """Return a failure if the memory of a record is still referenced, else None."""
    gc.collect()
    memory = watched()
    if memory is None:
        return None
    return CheckError(
        f"the {what} is kept after the call{_by(memory)}",
        cause=f"an attribute or a variable holds the {what} or a view of it",
        advice="copy the numbers you need: float(x), np.array(x)",
    )


def _by(memory: Any) -> str:
    """Return what references the memory, if it can be found: from views through dictionaries to objects."""
    things, seen = [memory], {id(memory)}
    for _ in range(5):
        further = []
        for thing in things:
            for holder in gc.get_referrers(thing):
                if id(holder) in seen or isinstance(holder, types.FrameType) or holder is things:
                    continue
                seen.add(id(holder))
                name = _named(holder, thing)
                if name:
                    return f" by {name}"
                if isinstance(holder, (np.ndarray, dict, list, tuple, types.CellType)):
                    further.append(holder)
        things = further
    return ""


def _named(holder: Any, thing: Any) -> str:
    if isinstance(holder, dict) and "__name__" in holder:
        key = next((key for key, value in holder.items() if value is thing), "?")
        return f"{holder['__name__']}.{key}"
    if isinstance(holder, (np.ndarray, dict, list, tuple, types.FrameType, types.CellType)):
        return ""
    module = type(holder).__module__
    if module.startswith(("itouch.", "weakref", "builtins", "_pytest")):
        return ""
    attributes = getattr(holder, "__dict__", {})
    key = next((key for key, value in attributes.items() if value is thing), "")
    return f"{type(holder).__name__}.{key}" if key else f"an object of class {type(holder).__name__}"


def _let_go(call: Callable[[Any], Any], record: Record, what: str) -> None:
    """Make a call with a fresh copy of a record, drop the copy, and check that its memory is freed."""
    copied = record.copy()
    watched = weakref.ref(_memory(copied))
    call(copied)
    del copied
    failure = _kept(watched, what)
    if failure is not None:
        raise failure


def _memory(record: Record) -> Any:
    """Return the array that owns a record's memory."""
    array: Any = record.raw
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array


@check("keeps-nothing", "records and touch are not kept")
def keeps_nothing(harness: DeviceHarness) -> None:
    """Pass new records, and check that nothing still references them."""
    bench = harness.bench()
    bench.step(3)
    twin = bench.twin
    _let_go(lambda reading: twin.read(bench.state, reading), bench.reading, "reading")
    _let_go(lambda command: twin.step(bench.state, command, bench.touch, PERIOD), bench.command, "command")
    _let_go(lambda state: twin.step(state, bench.command, bench.touch, PERIOD), bench.state, "State")
    _let_go(lambda state: twin.read(state, bench.reading), bench.state, "State")
    touch = TwinInputs(finger_attached=True)
    watched = weakref.ref(touch.finger_pose)
    twin.step(bench.state, bench.command, touch, PERIOD)
    del touch
    failure = _kept(watched, "touch")
    if failure is not None:
        raise failure


@check("driver-keeps-nothing", "the driver keeps no record")
def driver_keeps_nothing(harness: DeviceHarness) -> None:
    """Pass new records, and check that the driver does not still reference them."""
    with opened(harness) as device:
        device.fresh()
        for _ in range(3):
            _let_go(device.device.read, device.reading, "reading")
            device.exchange()
        if device.command:
            _let_go(device.device.write, device.command, "command")


@check("allocates-nothing", "no memory is gathered, and little taken")
def allocates_nothing(harness: Harness) -> str:
    """Compare allocated memory before and after many calls, and measure what single calls allocate."""
    notes = []
    for make in workloads(harness):
        with make() as workload:
            for _ in range(min(workload.ticks, 500)):
                workload.tick()
            count = 50 if workload.what == "the driver" else 1000
            most = _GROWTH if count == 1000 else 40 * _GROWTH
            grown, taken = _allocated(workload.calls(), count, most)
            if grown > most:
                raise CheckError(
                    f"the memory of {workload.what} grows by {grown:.0f} bytes a tick",
                    cause="a list that is appended to, or a log",
                    advice="keep what must be kept in State, which has a fixed size",
                )
            if taken > (_WITHIN if count == 1000 else 20 * _WITHIN):
                raise CheckError(
                    f"{workload.what} takes {taken / 1e3:.0f} kB in each tick, and gives it back",
                    cause="an array or a buffer that is made anew in every call",
                    advice="make it once, in __init__ or compile() or open(), and write into it",
                )
            notes.append(f"{max(0.0, grown):.1f} bytes a tick")
    return ", ".join(notes)


#: Rounds in which growth may turn out to be a single allocation, of a buffer or another thread: a log grows each time.
_ROUNDS = 4


def _allocated(calls: Any, count: int, most: float) -> tuple[float, float]:
    """Return by how many bytes memory grows per call, the least of some rounds, and how many are taken within one."""
    gc.collect()
    tracemalloc.start()
    try:
        for _ in range(min(count, 200)):
            for _, record, call in calls:
                call(record)
        gc.collect()
        grown = math.inf
        for _ in range(_ROUNDS):
            before, _ = tracemalloc.get_traced_memory()
            for _ in range(count):
                for _, record, call in calls:
                    call(record)
            gc.collect()
            grown = min(grown, (tracemalloc.get_traced_memory()[0] - before) / count)
            if grown <= most:
                break
        taken = max(_taken(record, call) for _, record, call in calls)
    finally:
        tracemalloc.stop()
    return grown, taken


def _taken(record: Record, call: Callable[[Record], Any]) -> float:
    """Return the peak memory of a call above that before it [bytes]; the median of fifty calls."""
    taken = []
    for _ in range(50):
        start, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        call(record)
        taken.append(tracemalloc.get_traced_memory()[1] - start)
    return float(sorted(taken)[25])
