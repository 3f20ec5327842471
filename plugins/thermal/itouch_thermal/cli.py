"""Solve contact cases, list materials, record flux curves, and tell facts about the display."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from itouch.plugin import ItouchError
from itouch.plugin.commands import command_parser, output_file
from itouch_thermal.atomic_write import write_whole
from itouch_thermal.cli_display import add_commands, add_display

#: Units of a duration in seconds; without a unit it is in seconds.
_UNITS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0, "h": 3600.0}
_UNIT_NAMES = ", ".join(filter(None, _UNITS))

if TYPE_CHECKING:
    from contact_heat.contact import Contact
    from contact_heat.table import Table


def main(argv: Sequence[str]) -> int:
    """Solve contact cases, list materials, record flux curves, set up the display; returns 0, or 2 for wrong input."""
    options = _parser().parse_args(argv)
    if options.command is None:
        _parser().print_help()
        return 2
    command: Callable[[argparse.Namespace], None] = options.command
    try:
        command(options)
    except BrokenPipeError:
        raise
    except OSError as error:
        print(f"error: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    except ItouchError as error:
        print(error, file=sys.stderr)
        return 2
    except (ValueError, ImportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("itouch-py thermal", __doc__)
    parser.set_defaults(command=None)
    commands = parser.add_subparsers(metavar="COMMAND")
    solve = commands.add_parser("solve", help="solve a case file", description=_solve.__doc__)
    solve.add_argument("case", metavar="CASE.json", help="the contact problem")
    when = solve.add_mutually_exclusive_group()
    when.add_argument("--times", metavar="FILE", help="file with one time [s] a line")
    when.add_argument("--at", metavar="TIMES", help="times with units, such as 1ms,10ms,1s")
    solve.add_argument("--live", action="store_true", help="step as the servo loop does, to the nearest step")
    solve.add_argument("--period", default="1ms", help="step of --live (default 1ms)")
    solve.add_argument("--method", choices=("exact", "paper"), default="exact", help="exact (default) or the paper's")
    solve.add_argument("-o", "--output", type=output_file(), metavar="FILE",
                       help="OUT.csv or OUT.png; default: CSV on the terminal")  # fmt: skip
    solve.set_defaults(command=_solve)
    materials = commands.add_parser("materials", help="list the material library", description=_materials.__doc__)
    materials.add_argument("documents", nargs="*", metavar="FILE.xml", help="read these scene documents instead")
    materials.set_defaults(command=_materials)
    add_commands(commands)
    add_display(commands)
    return parser


def _solve(options: argparse.Namespace) -> None:
    """Solve a contact case; columns t, j, T_skin, T_object, Q and the probes; s, W/m2, degC, J/m2."""
    from contact_heat import table
    from contact_heat.contact import Contact

    if options.live and options.method == "paper":
        raise ValueError("--live steps the exact model; it does not go with --method paper")
    if options.output is not None and Path(options.output).suffix not in (".csv", ".png"):
        raise ValueError(f"output '{options.output}': the name must end in .csv or .png")
    contact = Contact.from_json(options.case)
    times = _times(options, contact)
    if options.live:
        found = table.live_table(contact, times, _seconds(options.period))
    else:
        found = table.solution_table(contact, times, options.method)
    _write(found, options.output, Path(options.case).stem)


def _write(found: Table, output: str | None, title: str) -> None:
    if output is None:
        sys.stdout.write(found.csv())
    elif output.endswith(".png"):
        from itouch_thermal.plot import plot_table

        plot_table(found, Path(output), title)
    else:
        write_whole(Path(output), found.csv())


def _times(options: argparse.Namespace, contact: Contact) -> list[float]:
    """Return the times asked for [s], or those of the case."""
    from contact_heat.casefile import check_times

    if options.times is not None:
        times = _read_times(Path(options.times))
    elif options.at is not None:
        times = [_seconds(word) for word in options.at.split(",")]
    else:
        times = list(contact.times)
        if not times:
            raise ValueError("times: the case has none; give --at or --times")
    check_times(times)
    return times


def _read_times(path: Path) -> list[float]:
    """Read the first column of a text file; a first line that is not a number is a heading, with a unit in brackets."""
    if not path.is_file() and path.exists():
        raise ValueError(f"times: '{path}' is a folder, a pipe, a device or a socket, not a file")
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not text: byte {error.start} is not UTF-8") from None
    times: list[float] = []
    factor, headed = 1.0, False
    for number, line in enumerate(lines, 1):
        cell = re.split(r"[,;\t]", line.strip())[0].strip()
        if not line.strip() or cell.startswith("#"):
            continue
        try:
            times.append(float(cell.partition(" ")[0]) * factor)
        except ValueError:
            if times or headed:
                raise ValueError(f"{path}: line {number}: '{cell}' is not a number") from None
            factor, headed = _heading(path, number, cell), True
    if not times:
        raise ValueError(f"{path}: no times")
    return times


def _heading(path: Path, number: int, cell: str) -> float:
    """Return the factor to seconds of the unit in the heading of a column of times."""
    if re.match(r"[\d.+-]", cell):
        raise ValueError(
            f"{path}: line {number}: '{cell}' is not a number; a unit belongs into the heading, as in t [ms]"
        )
    unit = re.fullmatch(r"[^\[(]*[\[(]\s*(.*?)\s*[\])]", cell)
    if unit is None:
        return 1.0
    if not unit.group(1) or unit.group(1) not in _UNITS:
        raise ValueError(f"{path}: line {number}: '{unit.group(1)}' is no unit of times; use one of {_UNIT_NAMES}")
    return _UNITS[unit.group(1)]


def _seconds(text: str) -> float:
    """Read a duration such as 1ms or 0.5."""
    found = re.fullmatch(r"((?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?) *([a-zµ]*)", text.strip())
    if found is None or found.group(2) not in _UNITS:
        raise ValueError(f"'{text.strip()}' is not a time; write for example 1ms, with one of {_UNIT_NAMES}")
    return float(found.group(1)) * _UNITS[found.group(2)]


def _materials(options: argparse.Namespace) -> None:
    """List materials with conductivity, density, specific heat, effusivity (SI) and source."""
    from itouch_thermal.library import library

    found = library(options.documents)
    print(f"{'material':<22}{'W/(m*K)':>9}{'kg/m^3':>9}{'J/(kg*K)':>10}{'effusivity':>12}  source")
    for material in sorted(found, key=lambda item: -item.effusivity):
        layer = material.layer
        numbers = (
            f"{layer.conductivity:>9.4g}{layer.density:>9.5g}{layer.specific_heat:>10.4g}{material.effusivity:>12.1f}"
        )
        print(f"{material.name:<22}{numbers}  {material.source}")
    print(f"{len(found)} materials; effusivity in W s^1/2 / (m^2*K), skin has about 1200")
