"""Checks of how long calls take: they must fit into the tick, and wait for nothing."""

from __future__ import annotations

import contextlib
import json
import os
import statistics
import threading
import time
from collections.abc import Callable, Sequence

from itouch.platforms import waits
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.harness import PERIOD, DeviceHarness
from itouch.testing.open_device import Opened
from itouch.testing.scenario import ModalityHarness
from itouch.testing.workload import opened

#: Share of the tick [s] that one plugin's calls may take.
_SHARE = 0.5 * PERIOD
#: Of a thousand calls, so many may be delayed by other programs on this machine.
_MISHAPS = 3
#: Number of attempts in which a plugin may show that it waits for nothing, or lets others run while it waits.
_BOUTS = 3
#: What :func:`_pace` works on, and its result on an idle core of a desktop [s], for which the bounds are made.
_TEXT = {"row": [{"a": 0.125 * k, "b": -1.5e-3 * k, "c": 0.02, "d": 0} for k in range(12)]}
_WORK = 1e-4
#: On any processor, an exchange that computes for longer than this [s] keeps eight ticks from running.
_MOST = 8e-3


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


class Timed:
    """Durations of calls [s], their processor time [s], and the durations of those in which the thread waited [s]."""

    def __init__(self) -> None:
        self.spent: list[float] = []
        self.computed: list[float] = []
        self.waited: list[float] = []

    def call(self, function: Callable[[], object]) -> None:
        """Call a function and record how long it takes."""
        switches = waits()
        begin, computed = time.perf_counter(), time.thread_time()
        function()
        self.computed.append(time.thread_time() - computed)
        self.spent.append(time.perf_counter() - begin)
        gave_way = waits() > switches
        self.waited.append(self.spent[-1] if gave_way else 0.0)

    @property
    def waits(self) -> Sequence[float]:
        """Durations [s] of the calls that waited and took longer than their share of a tick."""
        return [waited for waited in self.waited if waited > _SHARE]

    def mishaps(self, held_up: float) -> float:
        """Return how many calls may wait by no fault of their own, at ``held_up`` waits in a second without them."""
        return max(_MISHAPS, min(3.0 * held_up * sum(self.spent), 0.1 * len(self.spent)))

    def words(self) -> str:
        """Return median and 99th percentile in words."""
        worst = sorted(self.spent)[int(0.99 * len(self.spent))]
        return f"p50 {1e6 * statistics.median(self.spent):.0f} us, p99 {1e6 * worst:.0f} us"


def _held_up() -> float:
    """Return how often in a second this thread waits though it only computes.

    Other threads of the process, such as a virtual device, may hold the interpreter's lock (GIL), and on a busy machine
    they hold it until they get a processor again: that is no wait of the plugin's.
    """
    timed = Timed()
    while sum(timed.spent) < 0.1:
        timed.call(_compute)
    return len(timed.waits) / sum(timed.spent)


def _compute() -> None:
    begin = time.perf_counter()
    while time.perf_counter() - begin < 5e-5:
        pass


def _judge(timed: Timed, what: str, held_up: float) -> None:
    """Fail if calls wait or take too long; ``held_up``: how often in a second this thread waits without them."""
    median = statistics.median(timed.computed)
    if len(timed.waits) > timed.mishaps(held_up):
        raise _fail(
            f"{len(timed.waits)} of {len(timed.spent)} calls of {what} wait, {1e3 * max(timed.waits):.1f} ms at most",
            "sleep, a lock, or a wait for the wire or another thread",
            "never wait within a tick: delays are State; a driver that must wait says blocking = True",
        )
    if median > _SHARE:
        raise _fail(
            f"a call of {what} takes {1e3 * median:.2f} ms, a tick has {1e3 * PERIOD:g} ms for all",
            "it computes too much",
            "compile heavy arithmetic (numba), or do it once in compile() or __init__",
        )
    slow = [spent for spent in timed.computed if spent > 2 * PERIOD]
    if len(slow) > _MISHAPS:
        raise _fail(
            f"{len(slow)} of {len(timed.spent)} calls of {what} take more than 2 ms, {1e3 * max(slow):.1f} ms at most",
            "now and then it computes much, or compiles",
            "spread it over the ticks, or do it once in compile() or __init__",
        )


def _in_one_of(tries: int, measure: Callable[[], str]) -> str:
    """Return what the first attempt that passes returns: a plugin's waits show in each, a busy machine's need not."""
    for _ in range(tries - 1):
        with contextlib.suppress(CheckError):
            return measure()
    return measure()


@check("twin-timing", "a step fits in the tick, and never waits")
def twin_timing(harness: DeviceHarness) -> str:
    """Time step and read; the figure is reported, and a twin that waits or is too slow fails."""
    held_up = _held_up()  # before the first attempt: what a plugin leaves running is no excuse in the next
    return _in_one_of(_BOUTS, lambda: _time_twin(harness, held_up))


def _time_twin(harness: DeviceHarness, held_up: float) -> str:
    bench = harness.bench()
    bench.step(300)
    timed = Timed()
    for _ in range(1000):
        bench.drive()
        timed.call(lambda: bench.step(driven=False))
        if sum(timed.spent) > 2.0:
            break
    _judge(timed, "the twin", held_up)
    return timed.words()


@check("timing", "an update fits in the tick, and never waits")
def modality_timing(harness: ModalityHarness) -> str:
    """Time updates through a touch; the figure is reported."""
    held_up = _held_up()
    return _in_one_of(_BOUTS, lambda: _time_updates(harness, held_up))


def _time_updates(harness: ModalityHarness, held_up: float) -> str:
    engine = harness.engine()
    own = harness.own(engine)[0]
    period, timed = engine.model.period * own.every, Timed()
    engine.run(0.05)
    scratch = engine.state.copy()  # one for all calls, as in a session: a plugin prepares what works on its views once
    for tick in range(round(harness.seconds / engine.model.period)):
        engine.tick()
        if tick % own.every == 0 and len(timed.spent) < 1500:
            scratch.raw[:] = engine.state.raw
            timed.call(lambda: own.instance.update(own.model, scratch, period))
        if sum(timed.spent) > 3.0:
            break
    _judge(timed, "update", held_up)
    return timed.words()


@check("driver-timing", "a call fits in the tick, or says it blocks")
def driver_timing(harness: DeviceHarness) -> str:
    """Time exchanges; the figure is reported."""
    timed, held_up = Timed(), _held_up()
    with opened(harness) as device:
        device.fresh()
        for _ in range(200):
            timed.call(device.exchange)
            if sum(timed.spent) > 2.0:
                break
    median, worst = statistics.median(timed.spent), max(timed.spent)
    most = 0.1 * len(timed.spent) if harness.emulated else 0.0
    often = len(timed.waits) > max(most, timed.mishaps(held_up))
    if not harness.cls.blocking and (statistics.median(timed.computed) > _SHARE or often):
        raise _fail(
            f"an exchange takes {1e3 * median:.1f} ms, {1e3 * worst:.1f} ms at most",
            "it waits for the wire within the tick",
            "set blocking = True on the class: the framework then reads it in a thread",
        )
    if worst > 2.0:
        raise _fail(f"an exchange took {worst:.1f} s", "a wait without a time limit", "give every wait a timeout")
    return f"exchange p50 {1e3 * median:.2f} ms, worst {1e3 * worst:.2f} ms"


@check("lets-others-run", "other threads run while it waits")
def lets_others_run(harness: DeviceHarness) -> str:
    """Exchange in a thread, and watch how long this thread is held up."""
    if not harness.cls.blocking:
        raise NotApplicableError("it does not block")
    return _in_one_of(_BOUTS, lambda: _beside(harness))


def _beside(harness: DeviceHarness) -> str:
    """Return how often everything else stands still while a thread exchanges; fail if it computes or keeps the GIL.

    How long an exchange may compute depends on the present speed of the processor: if it is slow, or other programs use
    it too, the same work takes longer.
    """
    alone = _gaps(lambda: False)
    with opened(harness) as device:
        device.fresh(5.0)
        exchanges = _Exchanges(device)
        exchanges.start()
        beside = _gaps(exchanges.done.is_set)
        exchanges.join(5.0)
    if exchanges.error is not None:
        raise exchanges.error
    often, before = (sum(gap > 4e-3 for gap in gaps) for gaps in (beside, alone))
    allowed = min(_MOST, min(3e-3, max(1e-3, 0.2 * exchanges.spent)) * exchanges.slowness)
    if exchanges.computed > allowed or often > max(20, 5 * before):
        raise _fail(
            f"an exchange takes {1e3 * exchanges.spent:.1f} ms and computes for {1e3 * exchanges.computed:.1f} of it, "
            f"and everything else stands still {often} times",
            "a loop that computes until something comes, or a library that keeps the interpreter's lock (GIL)",
            "wait with select and a timeout; call a library through ctypes.CDLL, which releases the lock",
        )
    return f"{often} gaps above 4 ms"


class _Exchanges(threading.Thread):
    """Exchanges for a while, as the framework's thread does; keeps their median duration and processor time [s].

    Medians, because other work on a busy machine affects single exchanges, and single measurements of its pace.
    """

    def __init__(self, device: Opened) -> None:
        super().__init__(name="exchange", daemon=True)
        self._device = device
        self.done = threading.Event()
        self.error: Exception | None = None
        self.spent = self.computed = 0.0
        self.slowness = 1.0

    def run(self) -> None:
        """Exchange for a while, and measure the processor's pace in between."""
        begin, paces = time.perf_counter(), [_pace()]
        timed = Timed()
        try:
            while time.perf_counter() - begin < 0.6:
                timed.call(self._device.exchange)
                time.sleep(1e-3)
                if len(timed.spent) % 5 == 0:
                    paces.append(_pace())  # after a rest, like an exchange
        except Exception as error:  # raised again in the thread that waits
            self.error = error
        if timed.spent:
            self.computed, self.spent = statistics.median(timed.computed), statistics.median(timed.spent)
        self.slowness = max(1.0, statistics.median(paces) / _WORK)
        self.done.set()


def _pace() -> float:
    """Return the processor time of a little work like that of an exchange [s].

    It writes text, sends it through a pipe and reads it; :data:`_WORK` is what that took where the bounds were set.
    """
    begin = time.thread_time()
    text = json.dumps(_TEXT).encode()
    source, sink = os.pipe()
    try:
        for _ in range(4):
            os.write(sink, text)
            text = os.read(source, 1 << 16)
    finally:
        os.close(source)
        os.close(sink)
    json.loads(text)
    return time.thread_time() - begin


def _gaps(stop: Callable[[], bool]) -> list[float]:
    """Return the times between the turns of a busy loop [s], over half a second."""
    begin = last = time.perf_counter()
    gaps = []
    while last - begin < 0.5 and not stop():
        now = time.perf_counter()
        gaps.append(now - last)
        last = now
    return gaps
