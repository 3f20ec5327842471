"""``itouch-py bench display``: how close the felt flux comes to the real one, and to what is possible at all."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from itouch.plugin import ItouchError, parse_quantity
from itouch_thermal.display.params import DisplayParams, Mismatch
from itouch_thermal.rendering.bound import bound
from itouch_thermal.rendering.closedloop import GAINS, PERIOD, Case, Course, Run, desired_course, simulate
from itouch_thermal.rendering.materials import material
from itouch_thermal.rendering.plants import SEEDS, corners
from itouch_thermal.rendering.score import rms, summary

#: Grid of gains from which `paper` has its one pair.
PROPORTIONAL, INTEGRAL = (5.0, 10.0, 20.0, 40.0), (0.0, 30.0, 100.0)


def main(argv: Sequence[str]) -> int:
    """Measure the rendering of materials on the display's twin."""
    options = _parser().parse_args(list(argv))
    try:
        rows = list(_grid(options) if options.grid else _rows(options))
    except (ValueError, ItouchError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if options.json:
        Path(options.json).write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="itouch-py bench display", description=__doc__)
    add = parser.add_argument
    add("--materials", default="aluminium,pyrex,wood,polystyrene", help="names, or NAME:k:c:rho in SI, with commas")
    add("--object-temperature", default="23 degC", help="of the object before the touch")
    add("--skin-temperature", default="33 degC", help="of the skin before the touch")
    add("--resistance", default="0.002", help="contact resistance [K m2/W]")
    add("--controller", default="model", help="hold, paper, model, or several with commas")
    add("--plant", default="nominal", help="nominal, worst, or a scene or rig file with a thermal display")
    add("--exact-finger", action="store_true", help="in `worst`, leave the finger as modelled")
    add("--flux-gain", type=float, default=0.0, help="error of the flux sensor's gain, such as 0.01")
    add("--flux-noise", type=float, default=None, help="rms of a flux sample [W/m2]")
    add("--press", default="0 s", help="time constant of the press; 0: none")
    add("--press-off", type=float, default=1.0, help="the plant's time constant, in parts of the expected one")
    add("--rate", default="1 kHz", help="of commands: 1 kHz to 10 Hz")
    add("--stream", default="1 kHz", help="of readings")
    add("--seconds", type=float, default=10.0, help="of contact")
    add("--corners", type=int, default=16, help="of `worst`, how many of the list")
    add("--seeds", type=int, default=3, help="of `worst`, how many of the list")
    add("--no-bound", action="store_true", help="leave the bound out")
    add("--grid", action="store_true", help="print `paper` over its grid of gains instead")
    add("--json", metavar="FILE", help="write the rows")
    return parser


def _value(text: str, unit: str, absolute: bool = False) -> float:
    spaced = re.sub(r"(?<=[0-9.])\s*(?=[A-DF-Za-df-z%])", " ", text, count=1)
    return parse_quantity(spaced, unit, absolute=absolute)[0]


def _case(options: argparse.Namespace, name: str) -> Case:
    return Case(
        material(name)[1],
        _value(options.object_temperature, "K", True),
        _value(options.skin_temperature, "K", True),
        _value(options.resistance, "m^2*K/W"),
        options.seconds,
        _value(options.press, "s"),
        options.press_off,
    )


def _plants(options: argparse.Namespace) -> tuple[list[tuple[DisplayParams, int]], DisplayParams]:
    """Return the plants with their seeds, and what the controller believes."""
    nominal = DisplayParams()
    if options.flux_noise is not None:
        nominal = replace(nominal, flux_noise=options.flux_noise)
    if options.plant == "nominal":
        return [(replace(nominal, mismatch=Mismatch(flux_gain=options.flux_gain)), SEEDS[0])], nominal
    if options.plant == "worst":
        listed = corners(exact_finger=options.exact_finger)[: options.corners]
        plants = [(replace(nominal, mismatch=m), seed) for m in listed for seed in SEEDS[: options.seeds]]
        return plants, nominal
    scene: Any = import_module("itouch").load(options.plant)
    for device in scene.devices:
        for part in device.parts:
            if isinstance(part.params, DisplayParams):
                return [(part.params, SEEDS[0])], replace(part.params, mismatch=Mismatch())
    raise ValueError(f"{options.plant}: no device with <thermal:hardware>")


def _rows(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    plants, believed = _plants(options)
    hold = max(1, round(1.0 / _value(options.rate, "Hz") / PERIOD))
    stream = max(1, round(1.0 / _value(options.stream, "Hz") / PERIOD))
    print(f"{'material':<20}{'controller':<8}{'rms %':>8}{'median':>8}{'>0.3s':>8}{'>1s':>7}"
          f"{'W/m2':>8}{'skin K':>8}{'>0.3s':>8}{'>1s':>7}{'2AFC':>7}{'bound':>8}  limited")  # fmt: skip
    for name in options.materials.split(","):
        case = _case(options, name)
        course = desired_course(case)
        spread = max(abs(plant.mismatch.contact_resistance) for plant, _ in plants)
        best = None if options.no_bound else bound(case, course, believed, spread)
        for controller in options.controller.split(","):
            if controller not in ("hold", "paper", "model"):
                raise ValueError(f"controller '{controller}' is unknown: hold, paper or model")
            runs = [
                simulate(case, course, plant, controller, believed=believed, seed=seed, hold=hold, stream=stream)
                for plant, seed in plants
            ]
            row = {
                "material": name.split(":")[0],
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
        f"{row['material']:<20}{row['controller']:<8}{row['rms_pct']:8.3f}{row['rms_pct_median']:8.3f}"
        f"{row['max_after_300ms_pct']:8.2f}{row['max_after_1s_pct']:7.2f}{row['rms_W_m2']:8.2f}"
        f"{row['skin_error_max_K']:8.3f}{row['skin_error_max_after_300ms_K']:8.3f}"
        f"{row['skin_error_max_after_1s_K']:7.3f}{row['jnd_2afc']:7.3f}{best:>8}  {row['plate_limited'] or ''}",
        flush=True,
    )


def _grid(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Yield the worst rms of `paper` over the materials for each pair of gains."""
    plants, believed = _plants(options)
    cases = [(case, desired_course(case)) for case in (_case(options, n) for n in options.materials.split(","))]
    for kp in PROPORTIONAL:
        for ki in INTEGRAL:
            worst = max(rms(_paper(case, course, plants[0], believed, (kp, ki))) for case, course in cases)
            print(f"kp {kp:5g}  ki {ki:5g} /s  worst rms {worst:8.2f} %{'  (used)' if (kp, ki) == GAINS else ''}")
            yield {"proportional": kp, "integral": ki, "rms_pct": worst}


def _paper(
    case: Case, course: Course, plant: tuple[DisplayParams, int], believed: DisplayParams, gains: tuple[float, float]
) -> Run:
    return simulate(case, course, plant[0], "paper", believed=believed, seed=plant[1], gains=gains)
