"""Sub-commands of ``itouch-py thermal`` about the display: a flux curve, switching, data sheets, dew, a look at one."""

from __future__ import annotations

import argparse
import contextlib
import json
import re
import sys
import time
from pathlib import Path
from typing import Any, TextIO

from itouch.plugin import parse_quantity, waiting
from itouch.plugin.commands import framework, output_file
from itouch_thermal.atomic_write import write_whole

_KELVIN = 273.15
#: Period of the commands [s]; the rig's own watchdog is ten times as long.
_PERIOD = 0.02
#: Greatest current [A] and time [s] that may be given here: this is for a look at a display, not a session.
_AMPS, _SECONDS = 1.0, 60.0
#: Temperatures of a room [K]: -40 to 60 degC.
_ROOMS = (233.15, 333.15)


def add_commands(commands: Any) -> None:
    """Add the sub-commands to ``itouch-py thermal``."""
    _add_record(commands)
    _add_switching(commands)
    module = commands.add_parser("module", help="a Peltier module by its data sheet", description=_module.__doc__)
    for name, text in (("voltage", "U_max, such as 15.4V"), ("current", "I_max"), ("difference", "dT_max")):
        module.add_argument(f"--{name}", required=True, metavar="QUANTITY", help=text)
    module.add_argument("--hot", default="27 degC", metavar="TEMPERATURE", help="T_h of the data sheet (27 degC)")
    module.set_defaults(command=_module)
    dew = commands.add_parser("dew-point", help="where water condenses", description=_dew_point.__doc__)
    dew.add_argument("--room", default="23 degC", metavar="TEMPERATURE", help="temperature of the room (23 degC)")
    dew.add_argument("--humidity", default="50 %", metavar="PART", help="relative humidity (50 %%)")
    dew.set_defaults(command=_dew_point)


def _add_record(commands: Any) -> None:
    record = commands.add_parser(
        "record-flux", help="store the flux of a touch as a curve", description=_record_flux.__doc__
    )
    record.add_argument("scene", metavar="SCENE", help="a scene in which an object is touched")
    record.add_argument("-o", "--output", type=output_file(), required=True, metavar="FILE.csv",
                        help="columns t and j, in s and W/m2")  # fmt: skip
    record.add_argument("--object", default="", metavar="NAME", help="the object; default: the first that is touched")
    record.add_argument("--what", choices=("obtained", "sensor", "desired"), default="obtained",
                        help="flux out of the finger (default), reading of the sensor, or what is desired")  # fmt: skip
    record.add_argument("--for", dest="duration", metavar="30s", help="longest wait; default: the scripted motion")
    record.add_argument("--every", default="", metavar="10ms", help="time between rows; default: the servo period")
    record.add_argument("--seed", type=int, default=0, metavar="N", help="seed of all noise (default 0)")
    record.add_argument("--rig", metavar="FILE", help="put another rig under the scene")
    record.add_argument("--twin", metavar="all|none|NAME", help="run these devices as simulated twins")
    record.set_defaults(command=_record_flux)


def _add_switching(commands: Any) -> None:
    switching = commands.add_parser(
        "switching", help="how long the plate needs between materials", description=_switching.__doc__
    )
    switching.add_argument("scene", metavar="SCENE", help="a scene with flux control")
    switching.add_argument("--rig", metavar="FILE", help="put another rig under the scene")
    switching.add_argument("--json", type=output_file(), metavar="FILE", help="write the times")
    switching.set_defaults(command=_switching)


def _quantity(text: str, unit: str, *, absolute: bool = False) -> float:
    spaced = re.sub(r"(?<=[0-9.])\s*(?=[A-DF-Za-df-z%])", " ", text, count=1)
    return parse_quantity(spaced, unit, absolute=absolute)[0]


def _temperature(option: str, text: str, low: float, high: float) -> float:
    """Read an absolute temperature [K] from ``low`` to ``high``; a number alone is in K, which is seldom meant."""
    value = _quantity(text, "K", absolute=True)
    if low <= value <= high:
        return value
    alone, celsius = re.fullmatch(r"[-+\d.]+", text.strip()), value + _KELVIN
    meant = f"; did you mean {option} {text.strip()}degC?" if alone and low <= celsius <= high else ""
    unit = " K" if alone else ""
    raise ValueError(
        f"{option} {text.strip()}{unit} is out of range: {low - _KELVIN:.4g} to {high - _KELVIN:.4g} degC{meant}"
    )


def _record_flux(options: argparse.Namespace) -> None:
    """Run a scene until an object has been touched, and store the flux of that touch for target="file"."""
    from itouch_thermal.flux.curve import format_curve
    from itouch_thermal.recordflux import record_flux

    if not 0 <= options.seed < 1 << 63:
        raise ValueError(f"--seed {options.seed} is out of range: 0 to 2^63 - 1")
    seconds = _quantity(options.duration, "s") if options.duration else None
    if seconds is not None and not 0.0 < seconds <= 86400.0:
        raise ValueError(f"--for {options.duration} is out of range: above 0 to 86400 s")
    found = record_flux(
        options.scene, object_name=options.object, kind=options.what, seconds=seconds, seed=options.seed,
        rig=options.rig, twin=options.twin,
    )  # fmt: skip
    every = 1
    if options.every:
        every = round(_quantity(options.every, "s") / found.times[0])
        if every < 1 or len(found.times) // every < 2:
            raise ValueError(f"--every {options.every} is out of range: {found.times[0]:g} s to half the touch")
    times, fluxes = found.times[every - 1 :: every], found.fluxes[every - 1 :: every]
    write_whole(Path(options.output), format_curve(times, fluxes))
    print(
        f"{found.object} ({found.material}): {len(times)} rows over {times[-1]:.3f} s, "
        f"{fluxes[0]:.0f} to {fluxes[-1]:.0f} W/m2 ({options.what}) in {options.output}"
    )


def _switching(options: argparse.Namespace) -> None:
    """Print the least time of a switch between any two materials of a scene, the driver's delay included."""
    from itouch_thermal.flux.flux_report import switches
    from itouch_thermal.flux.modality import FluxControl

    with waiting(f"preparing {options.scene}"):
        session = framework().build(options.scene, rig=options.rig)
    controls = [m for m in session.model.modalities if isinstance(m.instance, FluxControl)]
    if not controls:
        raise ValueError(f"{options.scene}: no <thermal:flux-control>, so no plate that switches")
    with waiting("computing the times of switches"):
        rows = [{"modality": control.name, **row} for control in controls for row in switches(control.model)]
    if options.json:
        write_whole(Path(options.json), json.dumps(rows, indent=1) + "\n")
    for control in controls:
        _print_switches(control.name, [row for row in rows if row["modality"] == control.name])
        if control.model.preset_time:
            print(f"every approach takes {control.model.preset_time:.2f} s (equalise)")


def _print_switches(name: str, rows: list[dict[str, Any]]) -> None:
    """Print the times as a matrix: rows are the materials before the switch, columns those after it."""
    starts = {row["from"]: row["from_start_C"] for row in rows}
    if not starts:
        print(f"{name}: fewer than two materials, nothing to switch between")
        return
    width = max(9, *(len(material) for material in starts)) + 1
    times = {(row["from"], row["to"]): row["seconds"] for row in rows}
    print(f"{'from / to [s]':<{width + 13}}" + "".join(f"{material:>{width}}" for material in starts))
    for first, start in starts.items():
        cells = (f"{times[first, second]:{width}.3f}" if first != second else " " * width for second in starts)
        print(f"{first:<{width}}{start:7.2f} degC " + "".join(cells))


def _module(options: argparse.Namespace) -> None:
    """Print Seebeck coefficient, resistance and conductance of a module from what its data sheet says."""
    from itouch_thermal.display.params import HOT_SIDE, Datasheet

    sheet = Datasheet(
        voltage=_quantity(options.voltage, "V"),
        current=_quantity(options.current, "A"),
        difference=_quantity(options.difference, "K"),
        hot=_temperature("--hot", options.hot, *HOT_SIDE),
    )
    module = sheet.module()
    best = min(sheet.current, module.seebeck * sheet.hot / module.resistance)
    most = module.seebeck * sheet.hot * best - 0.5 * best * best * module.resistance
    print(f"Seebeck coefficient {module.seebeck:.5g} V/K")
    print(f"resistance          {module.resistance:.5g} ohm")
    print(f"conductance         {module.conductance:.5g} W/K")
    print(f"greatest heat       {most:.4g} W at {best:.4g} A without a difference")
    print(
        f'<thermal:datasheet voltage="{sheet.voltage:g} V" current="{sheet.current:g} A" '
        f'difference="{sheet.difference:g} K" hot="{sheet.hot - 273.15:g} degC"/>'
    )


def _dew_point(options: argparse.Namespace) -> None:
    """Print the temperature of a plate below which water condenses on it."""
    from itouch_thermal.flux.condensation import dew_point

    room = _temperature("--room", options.room, *_ROOMS)
    humidity = _quantity(options.humidity, "")
    sys.stdout.write(f"{dew_point(room, humidity) - 273.15:.2f} degC\n")


def add_display(commands: Any) -> None:
    """Add the sub-command ``display``."""
    display = commands.add_parser("display", help="look at a self-built display", description=_display.__doc__)
    display.add_argument("port", metavar="PORT", help="serial port, such as /dev/ttyACM0")
    display.add_argument("--baud", type=int, default=250000, metavar="N", help="speed of the port (default 250000)")
    display.add_argument(
        "--current",
        type=float,
        default=0.0,
        metavar="A",
        help=f"drive it with this current, of either sign, up to {_AMPS:g} A (default 0)",
    )
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
