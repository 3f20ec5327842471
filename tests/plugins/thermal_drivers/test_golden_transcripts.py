"""Golden transcripts of the display's instruments, made by this file as a script; read against the protocols.

``PYTHONPATH=tests python tests/plugins/thermal_drivers/test_golden_transcripts.py [NAME ...]`` makes them anew.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from test_thermal_drivers import SENSOR, labjack, mecom, own_rig

from itouch.plugin import Terminal, Trace, read_trace
from itouch_thermal.drivers import LinePort, Mecom
from itouch_thermal.drivers.labjack import LabJackDriver
from itouch_thermal.drivers.lineport import LineDriver
from itouch_thermal.drivers.tec import TecDriver

HERE = Path(__file__).parent


def tec(trace: Trace) -> None:
    terminal = Terminal()
    with mecom(terminal) as device:
        driver = TecDriver(Mecom(port=terminal.path), trace, patience=20.0)
        for current in (0.0, 1.25, -2.5):
            driver.exchange(current)
        device.injected.busy = 1
        driver.exchange(0.5)
        driver.close()
    terminal.close()


def t7(trace: Trace) -> None:
    with labjack() as (_, params):
        driver = LabJackDriver(params, trace, patience=20.0)
        driver.exchange(300.0)
        driver.close()


def line(trace: Trace) -> None:
    terminal = Terminal()
    with own_rig(terminal) as device:
        driver = LineDriver(LinePort(port=terminal.path), trace, patience=20.0)
        driver.exchange(1.5)
        device.injected.damaged = 1
        driver.exchange(-0.25)
        driver.close()
    terminal.close()


SESSIONS: dict[str, Callable[[Trace], None]] = {"tec": tec, "t7": t7, "line": line}


def recorded(name: str) -> str:
    stream = io.StringIO()
    SESSIONS[name](Trace(stream, name))
    return stream.getvalue()


@pytest.mark.parametrize("name", SESSIONS)
def test_the_wire_is_that_of_the_golden_transcript(name: str) -> None:
    golden = read_trace((HERE / f"{name}.trace").read_text().splitlines())
    now = read_trace(recorded(name).splitlines())
    assert [(entry.mark, entry.data) for entry in now] == [(entry.mark, entry.data) for entry in golden]
    assert SENSOR.sensitivity == 1.2e-6  # what the voltages of the transcript were made with


if __name__ == "__main__":
    for wanted in sys.argv[1:] or SESSIONS:
        (HERE / f"{wanted}.trace").write_text(recorded(wanted))
