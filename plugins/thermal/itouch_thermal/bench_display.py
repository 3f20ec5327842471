"""``itouch-py bench display``: how close the felt flux comes to the real one, and to what is possible at all."""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from contact_heat.resistance import DEFAULT_RESISTANCE
from itouch.plugin import ItouchError, parse_quantity
from itouch.plugin.commands import command_parser, exit_code, judged, output_file
from itouch_thermal.atomic_write import write_whole
from itouch_thermal.display.params import DisplayParams, Mismatch
from itouch_thermal.rendering.bound import bound
from itouch_thermal.rendering.closedloop import GAINS, PERIOD, Case, desired_course, simulate, start_for
from itouch_thermal.rendering.materials import made_up, material
from itouch_thermal.rendering.performance_table import Table
from itouch_thermal.rendering.plantfile import read_plant
from itouch_thermal.rendering.plants import SEEDS, corners
from itouch_thermal.rendering.score import rms, summary

CONTROLLERS = ("hold", "paper", "model")
#: The grid of gains from which the pair of `paper` was chosen, and the corners on which it was tried besides the
#: nominal plant.
PROPORTIONAL, INTEGRAL, CORNERS = (20.0, 40.0, 60.0, 80.0, 120.0), (0.0, 100.0, 400.0, 800.0, 1600.0), (1, 10, 14)
#: Allowed ranges: temperatures of object and skin [K], resistance, press, press-off, seconds, rates.
OBJECT, SKIN, RESISTANCE = (233.15, 353.15), (293.15, 313.15), (1e-5, 0.1)
PRESSES, PRESS_OFF, SECONDS, RATES = (0.0, 10.0), (0.05, 20.0), (0.5, 120.0), (10.0, 1000.0)

Plants = list[tuple[DisplayParams, int]]


def main(argv: Sequence[str]) -> int:
    """Measure the rendering of materials on the display's twin; 1 if a promise of --table is missed."""
    options = _parser().parse_args(list(argv))
    try:
        rows = list(_grid(options) if options.grid else _table(options) if options.table else _rows(options))
        if options.json:
            write_whole(Path(options.json), json.dumps(rows, indent=1) + "\n")
    except OSError as error:
        print(f"error: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    except (ValueError, ItouchError) as error:
        text = str(error)
        print(text if text.startswith("error[") else f"error: {text}", file=sys.stderr)
        return 2
    return exit_code(row.get("holds") for row in rows)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "itouch-py bench display",
        "Measure how close the felt flux comes to the real one, and to what is possible at all.",
    )
    add = parser.add_argument
    add(
        "--materials",
        default="aluminium,pyrex,wood,polystyrene",
        help="names, or NAME:k:c:rho in SI, separated by commas",
    )
    add("--random", type=int, default=0, metavar="N", help="add N made-up materials, effusivity 20 to 24000")
    add("--random-seed", type=int, default=1, metavar="SEED", help="seed of the made-up materials (default 1)")
    add("--object-temperature", default="23 degC", help="temperature of the object before the touch")
    add("--skin-temperature", default="33 degC", help="temperature of the skin before the touch")
    add("--resistance", default=f"{DEFAULT_RESISTANCE:g}", help="contact resistance [K m2/W]")
    add("--controller", default="model", help="hold, paper, model, or several separated by commas")
    add("--plant", default="nominal", help="nominal, worst, or a file with <thermal:hardware>")
    add("--exact-finger", action="store_true", help="in `worst`, leave the finger as modelled")
    add("--flux-gain", type=float, default=0.0, help="error of the flux sensor's gain, such as 0.01")
    add("--flux-noise", type=float, default=None, help="rms of a flux sample [W/m2]")
    add("--press", default="0 s", help="time constant of the press; 0: none")
    add("--press-off", type=float, default=1.0, help="the plant's time constant, in parts of the expected one")
    add("--rate", default="1 kHz", help="rate of commands: 1 kHz to 10 Hz")
    add("--stream", default="1 kHz", help="rate of readings")
    add("--seconds", type=float, default=10.0, help="seconds of contact")
    add("--corners", type=int, default=16, help="how many corners of `worst` to run")
    add("--seeds", type=int, default=3, help="how many seeds of noise of `worst` to run")
    add("--no-bound", action="store_true", help="leave the bound out")
    add("--grid", action="store_true", help="print `paper` over its grid of gains instead")
    add("--table", action="store_true", help="print every promise with its figure instead")
    add("--quick", action="store_true", help="with --table: four corners, one seed, objects at 23 degC")
    add("--json", type=output_file(), metavar="FILE", help="write the rows")
    return parser


def _value(name: str, text: str, unit: str, allowed: tuple[float, float], *, absolute: bool = False) -> float:
    """Read a quantity and check its range; the message names the option."""
    spaced = re.sub(r"(?<=[0-9.])\s*(?=[A-DF-Za-df-z%])", " ", text.strip(), count=1)
    try:
        value = parse_quantity(spaced, unit, absolute=absolute)[0]
    except (ValueError, ItouchError) as error:
        raise ValueError(f"--{name} '{text}': {error}") from None
    shift = 273.15 if absolute else 0.0
    return _number(name, value, allowed, shift, "degC" if absolute else unit)


def _number(name: str, value: float, allowed: tuple[float, float], shift: float = 0.0, unit: str = "") -> float:
    if not (math.isfinite(value) and allowed[0] <= value <= allowed[1]):
        low, high, given = (f"{end - shift:g}" for end in (*allowed, value))
        raise ValueError(f"--{name} = {given} {unit}".rstrip() + f" is out of range: {low} to {high} {unit}".rstrip())
    return value


def _cases(options: argparse.Namespace) -> list[tuple[str, Case]]:
    materials = [material(text) for text in options.materials.split(",") if text.strip()]
    materials += made_up(int(_number("random", options.random, (0, 1000))), options.random_seed)
    if not materials:
        raise ValueError("--materials: none given")
    found = Case(
        materials[0][1],
        _value("object-temperature", options.object_temperature, "K", OBJECT, absolute=True),
        _value("skin-temperature", options.skin_temperature, "K", SKIN, absolute=True),
        _value("resistance", options.resistance, "m^2*K/W", RESISTANCE),
        _number("seconds", options.seconds, SECONDS),
        _value("press", options.press, "s", PRESSES),
        _number("press-off", options.press_off, PRESS_OFF),
    )
    return [(name, replace(found, material=what)) for name, what in materials]


def _plants(options: argparse.Namespace) -> tuple[Plants, DisplayParams]:
    """Return the plants with their seeds, and the parameters that the controller assumes."""
    nominal = DisplayParams()
    seeds = SEEDS[: int(_number("seeds", options.seeds, (1, len(SEEDS))))]
    gain = _number("flux-gain", options.flux_gain, (-0.5, 1.0))
    if options.plant not in ("nominal", "worst"):
        nominal = read_plant(options.plant, _value("resistance", options.resistance, "m^2*K/W", RESISTANCE))
    if options.flux_noise is not None:
        nominal = replace(nominal, flux_noise=_number("flux-noise", options.flux_noise, (0.0, 5e3)))
    believed = replace(nominal, mismatch=Mismatch())
    if options.plant == "worst":
        every = corners(exact_finger=options.exact_finger)
        listed = every[: int(_number("corners", options.corners, (1, len(every))))]
        offs = [replace(off, flux_gain=gain) for off in listed]
        return [(replace(nominal, mismatch=off), seed) for off in offs for seed in seeds], believed
    off = replace(nominal.mismatch, flux_gain=gain) if gain else nominal.mismatch
    return [(replace(nominal, mismatch=off), SEEDS[0])], believed


def _controllers(options: argparse.Namespace) -> list[str]:
    found = [name.strip() for name in options.controller.split(",")]
    for name in found:
        if name not in CONTROLLERS:
            raise ValueError(f"--controller '{name}' is unknown: {', '.join(CONTROLLERS)}")
    return found


def _rows(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    plants, believed = _plants(options)
    hold, stream = (
        max(1, round(1.0 / _value(name, text, "Hz", RATES) / PERIOD))
        for name, text in (("rate", options.rate), ("stream", options.stream))
    )
    cases, controllers = _cases(options), _controllers(options)
    print(f"{'material':<20}{'controller':<11}{'rms %':>8}{'median':>8}{'>0.3s':>8}{'>1s':>7}"
          f"{'W/m2':>8}{'skin K':>8}{'>0.3s':>8}{'>1s':>7}{'2AFC':>7}{'bound':>8}  limited")  # fmt: skip
    for name, case in cases:
        course = desired_course(case)
        best = None if options.no_bound else bound(case, course, believed, [plant.mismatch for plant, _ in plants])
        for controller in controllers:
            start = start_for(case, course, believed) if controller == "model" else None
            runs = [
                simulate(
                    case, course, plant, controller, believed=believed, seed=seed, hold=hold, stream=stream,
                    start=start,
                )
                for plant, seed in plants
            ]  # fmt: skip
            row = {
                "material": name,
                "object_temperature_C": round(case.object_temperature - 273.15, 6),
                "controller": controller,
                "plant": options.plant,
                **summary(runs),
                "bound_rms_pct": None if best is None else best.rms_pct,
                "plate_limited": None if best is None else best.limited,
            }
            _show(row)
            yield row


def _show(row: dict[str, Any]) -> None:
    best = "-" if row["bound_rms_pct"] is None else f"{row['bound_rms_pct']:.3f}"
    print(
        f"{row['material']:<20}{row['controller']:<11}{row['rms_pct']:8.3f}{row['rms_pct_median']:8.3f}"
        f"{row['max_after_300ms_pct']:8.2f}{row['max_after_1s_pct']:7.2f}{row['rms_W_m2']:8.2f}"
        f"{row['skin_error_max_K']:8.3f}{row['skin_error_max_after_300ms_K']:8.3f}"
        f"{row['skin_error_max_after_1s_K']:7.3f}{row['jnd_2afc']:7.3f}{best:>8}  {row['plate_limited'] or ''}",
        flush=True,
    )


def _table(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Yield every promise with its measured value."""
    materials = [(name, case.material) for name, case in _cases(options)]
    print(f"{'case':<40}{'figure':<42}{'value':>11}{'limit':>9}       worst")
    for line in Table(materials, options.quick, seconds=options.seconds).lines():
        limit = "-" if line.limit is None else f"{line.limit:g}"
        print(
            f"{line.case:<40}{line.figure:<42}{line.value:>11.4g}{limit:>9} {judged(line.holds):<6}{line.worst}",
            flush=True,
        )
        yield {**line._asdict(), "holds": line.holds}


def _grid(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Yield the worst rms error of `paper` over materials, nominal plant and some corners, for each pair of gains."""
    nominal = DisplayParams()
    plants = [nominal, *(replace(nominal, mismatch=corners()[k]) for k in CORNERS)]
    cases = [(case, desired_course(case)) for _, case in _cases(options)]
    for kp in PROPORTIONAL:
        for ki in INTEGRAL:
            worst = max(
                rms(simulate(case, course, plant, "paper", believed=nominal, seed=SEEDS[0], gains=(kp, ki)))
                for case, course in cases
                for plant in plants
            )
            print(f"kp {kp:5g}  ki {ki:5g} /s  worst rms {worst:8.2f} %{'  (used)' if (kp, ki) == GAINS else ''}",
                  flush=True)  # fmt: skip
            yield {"proportional": kp, "integral": ki, "rms_pct": worst}
