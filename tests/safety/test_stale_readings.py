"""An arm whose exchanges take so long that its readings get too old between them (W1) is told of before it runs."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, ClassVar

import pytest
from test_third_party_device_supervision import Nothing, catalog, scene

import itouch
from itouch.loop import WallClock
from itouch.monitors.default_limits import WATCHDOG
from itouch.plugin import Device, Record, Role, current, deadman, pose, wrench
from itouch.safety import DeviceFaultError, Trip
from itouch.world.safe_values import oldest, stale

#: W1 of what pushes a finger [s], and a period of the loop.
PATIENCE, TICK = WATCHDOG[Role.FORCE_ON_OPERATOR], 1e-3


class Arm(Device):
    """An arm behind a wire that keeps its caller waiting for so long [s]."""

    Params = Nothing
    reads = (pose(), deadman("b"))
    commands = (wrench(force=3.0),)
    blocking: ClassVar[bool] = True
    watchdog: ClassVar[float | None] = 0.1
    #: How long [s] it truly takes.
    lasts: ClassVar[float] = 0.0

    def open(self) -> None:
        """Begin."""

    def close(self) -> None:
        """End."""

    def write(self, command: Record) -> None:
        """Obey."""

    def read(self, reading: Record) -> bool | None:
        time.sleep(self.lasts)
        reading["pose"], reading["b"] = (0.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0), 1.0
        return True


def arm(**of: Any) -> type[Arm]:
    return type("Told", (Arm,), of)


def told(folder: Path, cls: type[Device], twin: str) -> list[str]:
    with itouch.build(scene(folder, "hand", twin=twin), catalog=catalog({"stranger": cls})) as session:
        return [notice for notice in session.notices if "as silent while it runs" in notice]


@pytest.mark.parametrize(
    ("of", "twin", "says"),
    [
        ({"exchange_time": 0.012}, "no", ""),
        ({"exchange_time": 0.014}, "no", "may be stopped"),
        ({"exchange_time": 0.0195}, "no", "may be stopped"),
        ({"exchange_time": 0.0205}, "no", "will be stopped"),
        ({"period": 0.018}, "no", ""),
        ({"period": 0.018, "exchange_time": 0.004}, "no", "may be stopped"),
        ({"exchange_time": 0.008, "command_wait": 0.009}, "no", "may be stopped"),
        ({"exchange_time": 0.014}, "yes", ""),  # only what the twin is given counts for it
        ({"delay": 0.009}, "yes", ""),
        ({"delay": 0.012}, "yes", "will be stopped"),
        ({"delay": 0.004, "period": 0.017}, "yes", "will be stopped"),
        ({"blocking": False, "period": 0.018}, "yes", ""),
    ],
)
def test_readings_that_get_too_old_are_told_of(tmp_path: Path, of: dict[str, Any], twin: str, says: str) -> None:
    found = told(tmp_path, arm(**of), twin)
    assert len(found) == bool(says)
    assert all(f"it {says} as silent while it runs" in sentence for sentence in found)


def test_the_sentence_has_the_figures() -> None:
    (problem,) = stale("hand", arm(exchange_time=0.015), None, Arm.reads, PATIENCE, TICK, None, twin=False)
    assert problem.severity == "warning"
    assert problem.sentence == (
        "device 'hand': with an exchange every 15 ms its readings (pose, b) get 22.5 ms old; the watchdog (W1) allows "
        "20 ms: it may be stopped as silent while it runs"
    )


def test_what_nobody_relies_on_may_be_old() -> None:
    nothing = (current("i", limit=1.0),)
    assert list(stale("hand", arm(exchange_time=0.015), None, nothing, PATIENCE, TICK, None, twin=False)) == []


def test_a_thread_does_what_was_told(tmp_path: Path) -> None:
    """On the wall: an exchange of 17 ms makes readings 25 ms old."""
    cls = arm(exchange_time=0.017, lasts=0.017)
    assert oldest(cls, None, twin=False) == pytest.approx(0.0255)
    with itouch.build(
        scene(tmp_path, "hand", twin="no", more='<interaction><probe name="tip" pose-from="hand"/></interaction>'),
        catalog=catalog({"stranger": cls}),
        clock=WallClock(),
    ) as session:
        session.enable()
        with pytest.raises(DeviceFaultError) as caught:
            session.run(2.0)
        assert caught.value.trip is Trip.SILENT


def test_a_twin_does_what_was_told(tmp_path: Path) -> None:
    for delay, stops in ((0.009, False), (0.012, True)):
        cls = arm(delay=delay)
        with itouch.build(scene(tmp_path, "hand"), catalog=catalog({"stranger": cls})) as session:
            if not stops:
                session.run(0.5)
                continue
            with pytest.raises(DeviceFaultError) as caught:
                session.run(0.5)
            assert caught.value.trip is Trip.SILENT
