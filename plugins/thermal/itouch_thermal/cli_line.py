"""``itouch-py thermal display``: talk to a rig of one's own by itself, for its first power-on and its calibration."""

from __future__ import annotations

import argparse
import contextlib
import time
from pathlib import Path
from typing import Any, TextIO

from itouch.plugin.commands import output_file

_KELVIN = 273.15
#: Period of the commands [s]; the rig's own watchdog is ten times as long.
_PERIOD = 0.02
#: Greatest current [A] and time [s] that may be given here: this is for a look at a display, not a session.
_AMPS, _SECONDS = 1.0, 60.0


def add_display(commands: Any) -> None:
    """Add the sub-command ``display``."""
    display = commands.add_parser("display", help="look at a display of one's own", description=_display.__doc__)
    display.add_argument("port", metavar="PORT", help="serial port, such as /dev/ttyACM0")
    display.add_argument("--baud", type=int, default=250000, metavar="N", help="of the port (default 250000)")
    display.add_argument("--current", type=float, default=0.0, metavar="A", help=f"of either sign, up to {_AMPS:g} A")
    display.add_argument("--seconds", type=float, default=5.0, metavar="S", help="how long (default 5)")
    display.add_argument("--csv", type=output_file(), metavar="FILE", help="write time, current, plate, sink [s, A, K]")
    display.add_argument("--release", action="store_true", help="release a cut-off, if its cause is over")
    display.set_defaults(command=_display)


def _display(options: argparse.Namespace) -> None:
    """Greet a rig that speaks the line protocol, and print its readings; without a finger on it."""
    from itouch.plugin.wire_claims import WireClaims
    from itouch_thermal.drivers.driver_params import LINE_BAUD, LinePort
    from itouch_thermal.drivers.lineport import LineDriver

    if not abs(options.current) <= _AMPS:
        raise ValueError(f"--current {options.current:g}: {_AMPS:g} A at most, without a supervisor")
    if not 0.0 <= options.seconds <= _SECONDS:
        raise ValueError(f"--seconds {options.seconds:g} is out of range: 0 to {_SECONDS:g}")
    if not LINE_BAUD[0] <= options.baud <= LINE_BAUD[1]:
        raise ValueError(f"--baud {options.baud} is out of range: {LINE_BAUD[0]} to {LINE_BAUD[1]}")
    claims = WireClaims()
    claims.take([options.port])
    driver = LineDriver(LinePort(port=options.port, baud=options.baud), release=options.release)
    try:
        print(driver.identity)
        with contextlib.ExitStack() as stack:
            table = stack.enter_context(Path(options.csv).open("w", encoding="utf-8")) if options.csv else None
            _watch(driver, options, table)
    finally:
        driver.close()


def _watch(driver: Any, options: argparse.Namespace, table: TextIO | None) -> None:
    begin, shown = time.monotonic(), -1.0
    while (now := time.monotonic() - begin) < options.seconds:
        read = driver.exchange(options.current)
        if table is not None:
            table.write(f"{now:.4f},{read.current:.5f},{read.plate:.3f},{read.sink:.3f}\n")
        if now - shown >= 0.5:
            shown = now
            print(f"{now:6.1f} s  plate {read.plate - _KELVIN:7.3f} degC  sink {read.sink - _KELVIN:7.3f} degC  "
                  f"flux {read.flux:8.1f} W/m2  current {read.current:8.4f} A", flush=True)  # fmt: skip
        time.sleep(max(0.0, _PERIOD - (time.monotonic() - begin - now)))
