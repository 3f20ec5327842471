"""``itouch-py bench start``: what a first and a later start cost, stage by stage, each in its own process."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from itouch.plugin.commands import exit_code
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_file, write_output

#: How often a later start, and the help, are measured; the least counts.
TIMES = 3
#: Bounds: the first start as a multiple of a later one where nothing is compiled, as from a wheel; CPU of the help [s].
FIRST, HELP = 1.5, 0.15
#: Longest that a start may take [s].
_PATIENCE = 900.0


@dataclass(frozen=True, slots=True)
class Start:
    """One start: CPU and wall time [s] of the whole process, and its stages."""

    name: str
    cpu: float
    wall: float
    stages: tuple[dict[str, Any], ...]

    @property
    def compiled(self) -> int:
        """How many functions were compiled."""
        return sum(int(row["compiled"]) for row in self.stages)


def main(argv: Sequence[str]) -> int:
    """Measure a first start, with nothing cached, and later ones, to the first tick; exit code 1: a bound is missed."""
    parser = Parser(prog="itouch-py bench start", description=main.__doc__)
    parser.add_argument("scene", nargs="?", metavar="SCENE", help="default: the four-material scene")
    parser.add_argument(
        "--times", type=int, default=TIMES, metavar="N", help="number of later starts; the shortest counts"
    )
    parser.add_argument("--json", type=output_file, metavar="FILE", help="write the figures to this file too")
    options = parser.parse_args(argv)
    from itouch_evidence.faults import shipped_scene

    scene = os.fspath(options.scene or shipped_scene())
    try:
        first, later = measure(scene, max(1, options.times))
        asked = min(help_seconds() for _ in range(max(1, options.times)))
    except subprocess.SubprocessError as error:
        late = isinstance(error, subprocess.TimeoutExpired)
        print("a start did not end in time" if late else "a start failed; its error is above", file=sys.stderr)
        return 2
    for line in table(first, later):
        print(line)
    print(f"`itouch-py --help`: {asked:.2f} s of CPU, at most {HELP:g}{_judged(asked, HELP)}")
    if options.json:
        content = {"first": asdict(first), "later": asdict(later), "help_cpu_s": asked}
        write_output(options.json, json.dumps(content, indent=1) + "\n")
    return exit_code([not is_missed(first, later, asked)])


def is_missed(first: Start, later: Start, asked: float) -> bool:
    """Tell whether a first start that compiles nothing, or the help's CPU time ``asked`` [s], misses its bound."""
    return asked > HELP or (not first.compiled and first.wall / later.wall > FIRST)


def measure(scene: str, times: int) -> tuple[Start, Start]:
    """Return a start with empty caches, and the quickest of some with the caches that it filled.

    Raises
    ------
    subprocess.CalledProcessError
        If a start fails; its error has been printed.
    """
    with tempfile.TemporaryDirectory(prefix="itouch-start-") as folder:
        kept = {"NUMBA_CACHE_DIR": "kernels", "ITOUCH_KEPT": "found", "ITOUCH_MESH_CACHE": "meshes"}
        more = {name: os.path.join(folder, place) for name, place in kept.items()}
        first = _start("first", scene, more)
        later = [_start("later", scene, more) for _ in range(times)]
    return first, min(later, key=lambda start: start.cpu)


def help_seconds() -> float:
    """Return the CPU time [s] of ``itouch-py --help``."""
    return _run([sys.executable, "-m", "itouch_tools.cli", "--help"], {})[1]


def table(first: Start, later: Start) -> list[str]:
    """Return the lines of a table with both starts side by side, a stage in each."""
    lines = [f"{'':<13}{'first start':>20}{'':>12}{'later start':>20}", f"{'':<13}{_HEAD}{_HEAD}"]
    pairs = zip(first.stages, later.stages, strict=True)
    lines += [f"{one['stage']:<13}{_cells(one)}{_cells(other)}" for one, other in pairs]
    ends = ({"cpu": s.cpu, "wall": s.wall, "compiled": s.compiled} for s in (first, later))
    lines.append(f"{'whole process':<13}{''.join(map(_cells, ends))}")
    times = first.wall / later.wall
    bound = (
        f", at most {FIRST:g}{_judged(times, FIRST)}" if not first.compiled else " (from a wheel nothing is compiled)"
    )
    lines.append(f"first / later: {first.cpu / later.cpu:.2f} in CPU, {times:.2f} in time{bound}")
    return lines


def _judged(figure: float, bound: float) -> str:
    return " MISSED" if figure > bound else ""


_HEAD = f"{'CPU s':>10}{'wall s':>10}{'compiled':>12}"


def _cells(row: Mapping[str, Any]) -> str:
    return f"{row['cpu']:>10.2f}{row['wall']:>10.2f}{row['compiled']:>12}"


def _start(name: str, scene: str, more: Mapping[str, str]) -> Start:
    out, cpu, wall = _run([sys.executable, "-P", "-m", "itouch_evidence.start.stages", scene], more)
    return Start(name, cpu, wall, tuple(json.loads(out.splitlines()[-1])))


def _run(words: Sequence[str], more: Mapping[str, str]) -> tuple[str, float, float]:
    """Run a process; return what it printed, its CPU time, and how long it took [s]."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(  # in a group of its own: Ctrl-C is for us, and we end it
        words, env={**os.environ, **more}, stdout=subprocess.PIPE, text=True, timeout=_PATIENCE, check=True,
        process_group=0,
    )  # fmt: skip
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.stdout, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall
