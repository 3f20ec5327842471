"""Estimate a finger's and a sample's thermal parameters from recorded touches, with intervals."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from itouch.plugin import ItouchError, waiting
from itouch.plugin.commands import command_parser, output_file
from itouch_thermal.atomic_write import write_whole
from itouch_thermal.identify.fit import TOLD, UNITS, Fit, Problem
from itouch_thermal.identify.records import DEPTH, Loaded, load, problem_of


def main(argv: Sequence[str]) -> int:
    """Estimate finger and sample from recorded touches, with intervals; returns 0, or 2 for wrong input."""
    options = _parser().parse_args(list(argv))
    try:
        loaded = load([Path(name) for name in options.touches])
        problem = problem_of(loaded, options.sample, press=options.press, noise=options.noise)
        with waiting("estimating"):
            fit = problem.fit()
        told = {name: found.told for name, found in fit.found.items()}
        print(table(problem, fit))
        if fit.misfit > 2.0:
            print(
                f"note: the data are {fit.misfit:.1f} times as far off as their noise: the model or --sample is "
                f"not right"
            )
        with waiting("profiling"):
            unknown = [name for name in fit.found if not told[name]] if options.profile else []
            profiles = {name: problem.profile(name, fit) for name in unknown}
        for name, rows in profiles.items():
            print(f"{name}: " + ", ".join(f"{_shown(name, value)} worse by {cost:.2f}" for value, cost in rows))
        if options.output:
            write_whole(Path(options.output), json.dumps(document(loaded, problem, fit), indent=2) + "\n")
        if options.heat:
            write_whole(Path(options.heat), heat_text(loaded, problem, fit))
    except ItouchError as error:
        print(error, file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: '{error.filename}': {error.strerror}\n  = help: check the path", file=sys.stderr)
        return 2
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("itouch-py identify", __doc__)
    parser.add_argument("touches", nargs="+", metavar="TOUCHES", help="files or folders of `measure touch --raw`")
    parser.add_argument(
        "--sample", default="", metavar="MATERIAL", help="what was touched, 20 mm of it; default: unknown"
    )
    parser.add_argument("--press", type=float, default=0.05, metavar="S", help="time in which the skin flattens (0.05)")
    parser.add_argument("--noise", type=float, default=20.0, metavar="W/M2", help="rms of one sample of the film (20)")
    parser.add_argument(
        "--profile", action="store_true", help="how flat the likelihood is where the data do not determine a value"
    )
    parser.add_argument(
        "-o", "--output", type=output_file("result", ".json"), metavar="FILE.json", help="write values and intervals"
    )
    parser.add_argument(
        "--heat",
        type=output_file("document", ".xml"),
        metavar="FILE.xml",
        help="write a <thermal:heat> of this finger, to be included",
    )
    return parser


def _shown(name: str, value: float) -> str:
    return f"{value - 273.15:.2f} degC" if UNITS[name] == "K" else f"{value:.4g}"


def table(problem: Problem, fit: Fit) -> str:
    """Return a table of values and intervals, and of which values the data do not determine."""
    lines = [f"{'value':<12}{'':>12}{'95 % from':>14}{'to':>14}  unit"]
    for name, found in fit.found.items():
        unit = "degC" if UNITS[name] == "K" else problem.unit(name)
        words = [_shown(name, x).removesuffix(" degC") for x in (found.value, found.low, found.high)]
        told = "" if found.told else f"  not determined by the data: {100 * found.narrowed:.0f} % of what is assumed"
        lines.append(f"{name:<12}{words[0]:>12}{words[1]:>14}{words[2]:>14}  {unit}{told}")
    return "\n".join(lines)


def document(loaded: Loaded, problem: Problem, fit: Fit) -> dict[str, object]:
    """Return the JSON document to be stored for a participant."""
    rows = {
        name: {
            "value": found.value, "low": found.low, "high": found.high, "unit": problem.unit(name), "told": found.told,
            "narrowed": found.narrowed,
        }
        for name, found in fit.found.items()
    }  # fmt: skip
    assumed = {
        name: {"middle": m, "deviation": d, "of_logarithm": log} for name, (m, d, log) in problem.assumed.items()
    }
    return {
        "who": loaded.who, "what": loaded.what, "when": _now(),
        "touches": len(loaded.known.forces), "forces_N": loaded.known.forces,
        "skin_K": loaded.known.skin, "room_K": loaded.known.room, "misfit": fit.misfit,
        "resistance_at_N": problem.force, "values": rows, "assumed": assumed, "told_below": TOLD,
    }  # fmt: skip


def heat_text(loaded: Loaded, problem: Problem, fit: Fit) -> str:
    """Return a scene document with this finger as a ``<thermal:heat>`` for the probe ``finger``."""
    from itouch_thermal.identify.forward import resistance_at, tissue

    values = fit.values
    unknown = {name: 0.0 for name in ("exponent", "curve") if name not in problem.names}
    values = replace(values, **unknown)
    layers = "".join(
        f'      <thermal:layer name="{layer.name}" thickness="{layer.thickness!r} m" '
        f'conductivity="{layer.conductivity!r} W/(m*K)" density="{layer.density!r} kg/m^3" '
        f'specific-heat="{layer.specific_heat!r} J/(kg*K)" perfusion="{layer.perfusion!r} W/(m^3*K)"/>\n'
        for layer in tissue(values)
    )
    low, high = min(loaded.known.forces), max(loaded.known.forces)
    points = sorted({low, (low * high) ** 0.5, high})
    law = "".join(
        f'        <thermal:point force="{force!r} N" resistance="{resistance_at(values, force)!r} m^2*K/W"/>\n'
        for force in points
    )
    return (
        f"<!-- Finger {_plain(loaded.who)}, by itouch-py identify from {len(loaded.known.forces)} touches, "
        f"{_now()}. -->\n"
        '<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal">\n  <interaction>\n'
        f'    <thermal:heat probe="finger" arterial="{values.core!r} K" object-depth="{DEPTH!r} m">\n{layers}'
        f"      <thermal:table-resistance>\n{law}      </thermal:table-resistance>\n"
        "    </thermal:heat>\n  </interaction>\n</itouch>\n"
    )


def _now() -> str:
    return f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC"


def _plain(text: str) -> str:
    return "".join(c for c in text if c.isalnum() or c in " _.")
