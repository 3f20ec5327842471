"""A machine that is late while all is being stopped: time goes on for what is touched, in ticks that were not run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from exchange_phases import Phases, wired, wired_phases
from numpy.typing import NDArray

from itouch.exchange import EveryNth
from itouch.faults import Kind
from itouch.plugin import Record
from itouch.plugin.timestamps import ticks_of
from itouch_evidence.faults.behind_wires import Pair, run

PERIOD = 1e-3

#: A loop in real time minds by the machine's own clock, too, whether it was put to sleep.
pytestmark = pytest.mark.punctual


class Late:
    """The clock of a machine that is held up: as the wall's, but nothing else takes time."""

    pace = "real"

    def __init__(self) -> None:
        self.now = self._due = self._period = 0.0
        self.spans: list[float] = []

    def start(self, period: float) -> None:
        self._due, self._period = self.now, period

    def wait(self) -> float:
        before = self.now
        self._due += self._period
        self.now = max(self.now, self._due)
        self.spans.append(self.now - before)
        return self.now - self._due


class InTime(EveryNth):
    """A device whose exchanges take their time on a clock, however many ticks are run meanwhile, as in a thread."""

    def __init__(self, wire: EveryNth, lasts: float, clock: Late) -> None:
        super().__init__(wire.device, 1)
        self.__dict__.update(wire.__dict__)
        self._lasts, self._clock = lasts, clock
        self._begun = self._came = -1.0
        #: How much longer [s] the next exchange takes.
        self.late = 0.0

    def open(self) -> None:
        self._begun, self.late = -1.0, 0.0
        super().open()

    def read(self, reading: Record) -> bool | None:
        if self._clock.now - self._begun < self._lasts - 1e-9:
            return False
        self._begun, self.late = self._clock.now + self.late, 0.0
        self._every = self._since = 0
        new = super().read(reading)
        if new is not False:
            self._came = self._clock.now
        return new

    def measured(self, state: Record, tick: int, ticks: NDArray[np.int64]) -> None:
        ticks[...] = tick - ticks_of(self._clock.now - self._came, PERIOD)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Pair, Phases, Late]]:
    """Return a host on the clock of a late machine, and its world."""
    pair = wired()
    phases, clock = wired_phases(tmp_path_factory), Late()
    for runner in pair.host.runners:
        wire = runner.gate.device
        assert isinstance(wire, EveryNth)
        runner.gate.device = InTime(wire, wire._every * PERIOD, clock)
    yield pair, phases, clock
    pair.close()


class HoldUp:
    """Holds the machine, or the table's wire alone, up for so long [s] in one tick of 60 of a stop."""

    def __init__(self, pair: Pair, clock: Late, phase: int, seconds: float, *, wire: bool) -> None:
        self._stopping, self._clock, self._phase, self._seconds = pair.host.state["stopping"], clock, phase, seconds
        self._begun = -1
        table = next(runner.gate.device for runner in pair.host.runners if runner.model.name == "table")
        assert isinstance(table, InTime)
        self._wire = table if wire else None

    def __call__(self, tick: int) -> None:
        if not self._stopping.item():
            self._begun = -1
            return
        self._begun = tick if self._begun < 0 else self._begun
        if (tick - self._begun) % 60 != self._phase:
            return
        if self._wire is None:
            self._clock.now += self._seconds
        else:
            self._wire.late = self._seconds


@pytest.mark.parametrize("wire", [False, True], ids=["machine", "wire"])
@pytest.mark.parametrize(("phase", "seconds"), [(2, 0.03), (8, 0.05), (12, 0.035), (55, 0.05)])
def test_a_table_that_is_reversed_and_lies_lets_go_of_the_finger_however_late_it_is_told_to(
    late: tuple[Pair, Phases, Late], phase: int, seconds: float, wire: bool
) -> None:
    """It was judged by what it did in a burst of ticks that caught up, before any command could have reached it."""
    pair, phases, clock = late
    pair.host.clock = clock
    hold_up = HoldUp(pair, clock, phase, seconds, wire=wire)
    pair.host.taps.append(hold_up)
    try:
        cell = run(pair, "contact", phases["contact"], [("table", Kind.SPIKE, 0), ("table", Kind.REVERSED_SIGN, 1)])
    finally:
        pair.host.taps.remove(hold_up)
    (fault,) = [entry for entry in pair.host.report()["faults"] if entry["trip"] is not None]
    assert cell.good and not cell.early
    assert "it pushed as it was told to go back" in fault["safe"]["devices"]["table"]
    assert pair.truth.plate_force < 4.0


def test_what_is_stopped_late_is_not_stopped_in_a_burst_of_ticks(
    late: tuple[Pair, Phases, Late],
) -> None:
    """All ticks of a stop were once run at once where the machine was late before: it was over in no time."""
    pair, phases, clock = late
    pair.host.clock = clock
    pair.adopt(phases["contact"])
    pair.enable()
    pair.host.run(0.05)
    clock.now += 1.0
    clock.spans.clear()
    outcome = pair.host.park()
    assert outcome.safe
    assert min(clock.spans) == pytest.approx(PERIOD)
    assert 0.01 < outcome.seconds <= (len(clock.spans) + 0.5) * PERIOD  # safe by then, minded until all stands


def test_a_stop_tells_how_long_it_took_not_how_many_ticks_it_had(
    late: tuple[Pair, Phases, Late],
) -> None:
    pair, phases, clock = late
    pair.host.clock = clock
    pair.adopt(phases["contact"])
    pair.enable()
    pair.host.run(0.05)
    begun: float = clock.now
    hold_up = HoldUp(pair, clock, 3, 0.2, wire=False)
    pair.host.taps.append(hold_up)
    try:
        outcome = pair.host.park()
    finally:
        pair.host.taps.remove(hold_up)
    assert 0.2 < outcome.seconds <= clock.now - begun + 0.5 * PERIOD
