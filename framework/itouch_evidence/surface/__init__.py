"""``itouch-py bench surface``: random scenes under arm and plate, each law of the carried surface beside its bound."""

from __future__ import annotations

import argparse
import math
import shutil
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from itouch.loop import DeviceFaultError
from itouch_evidence.faults import shipped_scene
from itouch_evidence.resumable import Kept
from itouch_evidence.surface.course import follow
from itouch_evidence.surface.draw import draw, draw_wire
from itouch_evidence.surface.laws import LAWS, LAWS_WIRED, VIRTUAL, WIRED, Law, broken, judge, least
from itouch_evidence.surface.reach import reach
from itouch_evidence.surface.wide import draw_wide, widths


def main(argv: Sequence[str]) -> int:
    """Draw random scenes, let a finger touch each, and judge every tick; exit code 1 if one breaks a law."""
    parser = argparse.ArgumentParser(prog="itouch-py bench surface", description=main.__doc__)
    parser.add_argument("--random", type=int, default=56, metavar="N", help="number of random scenes (default 56)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the scenes (default 0)")
    parser.add_argument("--only", type=int, metavar="K", help="the scene of this number alone, with all its figures")
    parser.add_argument("--wire", action="store_true", help="the same scenes with a random wire between loop and table")
    parser.add_argument("--wide", action="store_true", help="scenes of a wider kind: other rates of the loop, force "
                        "sensors, fingers and clearances, laws of heat, a touch-off, neighbours of other heights, "
                        "bodies that are pushed; with --wire, these behind wires")  # fmt: skip
    parser.add_argument("--keep", metavar="FILE", help="add each result to this file, run only what it has not, and "
                        "sum up all that it has")  # fmt: skip
    options = parser.parse_args(argv)
    if options.random < 1:
        parser.error(f"--random {options.random} is out of range: from 1 on")
    if options.only is not None and options.only < 0:
        parser.error(f"--only {options.only} is out of range: from 0 on")
    numbers = range(options.random) if options.only is None else (options.only,)
    full = options.only is not None
    try:
        kind = " ".join(name for name in OPTIONS if getattr(options, name))
        return 1 if campaign(numbers, options.seed, options.keep, full=full, kind=kind) else 0
    except MixedError as error:
        parser.error(str(error))


class MixedError(ValueError):
    """The file of results has scenes of another kind."""


#: The options that choose a kind of scenes, in the order in which its name has them; and how scenes of each are called.
OPTIONS = ("wide", "wire")
KINDS = {"": "of the usual kind", "wire": "behind wires", "wide": "of a wider kind", "wide wire": "of a wider kind "
         "behind wires"}  # fmt: skip


def campaign(
    numbers: Iterable[int], seed: int, keep: str | None = None, *, full: bool = False, kind: str = ""
) -> int:  # fmt: skip
    """Run the scenes with these numbers that have no result yet, and print a table of all results.

    Parameters
    ----------
    numbers, seed
        Which scenes.
    keep
        A file of results, which this run extends; None: nothing is kept.
    full
        Whether to print all figures of each scene, not only those that break a law.
    kind
        Which kind of scenes, one of `KINDS`.

    Returns
    -------
    int
        How many of all scenes with a result broke a law.

    Raises
    ------
    MixedError
        If the file has scenes of another kind.
    """
    kept = Kept(keep)
    for other in {_kind(row) for row in kept.rows.values()} - {kind}:
        raise MixedError(f"'{keep}' has scenes {KINDS[other]}: keep these in another file")
    with tempfile.TemporaryDirectory(prefix="itouch-surface-") as made:
        folder = Path(made) / "scenes"
        shutil.copytree(shipped_scene().parent, folder)
        for number in numbers:
            if (seed, number) not in kept:
                kept.add(seed, number, run(number, seed, folder, kind=kind))
                _tell(kept.rows[seed, number], full=full)
    return _sum_up(list(kept.rows.values()), kept.seeds, kind)


def run(number: int, seed: int, folder: Path, *, kind: str = "") -> dict[str, Any]:
    """Run a scene; return its family and what is special to its kind, its figures by law, and the changes of hands.

    If it was stopped by a trip, that is its only figure, with the ``cause``.  ``folder`` holds the shipped scenes, and
    this one is written there; ``kind``: one of `KINDS`.
    """
    wide, wired = (option in kind.split() for option in OPTIONS)
    family, scene = draw_wide(number, seed, folder) if wide else draw(number, seed, folder)
    wire = draw_wire(number, seed) if wired else None
    row: dict[str, Any] = {"family": family}
    if wide:
        row["wide"] = widths(scene)
    if wire:
        row["wire"] = str(wire)
    session = scene.build(folder, catalog=wire.catalog() if wire else None)
    table = session.model.devices["table"]
    try:
        course = follow(session)
    except DeviceFaultError as fault:
        return {**row, "figures": {"trip": 1.0}, "changes": 0, "cause": str(fault)}
    finally:
        session.close()
    figures = judge(course, wired=wire is not None)
    if wire and "plate" in figures:
        best = reach(course, table)
        row["reach"] = {"know": least(course, best.know), "straight": least(course, best.straight)}
    return {**row, "figures": figures, "changes": len(course.changes())}


def _tell(row: dict[str, Any], *, full: bool) -> None:
    wrong, figures, kind = broken(row["figures"]), row["figures"], _kind(row)
    if not wrong and not full:
        return
    shown = [law for law in (*LAWS, VIRTUAL) if law.name in (figures if full else wrong)]
    said = ", ".join(f"{law.name} {_figure(law, figures[law.name])}" for law in shown)
    cause = f" ({row['cause']})" if "cause" in row else ""
    shown_as = f"--seed {row['seed']} --only {row['number']}" + "".join(f" --{option}" for option in kind.split())
    what = ", ".join((row["family"], *(row[option] for option in kind.split() if row[option])))
    print(f"{shown_as} ({what}): {'WRONG: ' * bool(wrong)}{said}{_at_best(row, shown)}{cause}", flush=True)


def _at_best(row: dict[str, Any], shown: list[Law]) -> str:
    """Return how near the plate could have come through this wire, if its law is shown."""
    best = row.get("reach")
    if best is None or WIRED.name not in {law.name for law in shown}:
        return ""
    know, straight = _figure(WIRED, best["know"]), _figure(WIRED, best["straight"])
    return f"; through this wire the plate's commands reach {know} if they know the finger's path, {straight} if not"


def _figure(law: Law, value: float) -> str:
    digits = max(0, 2 - math.floor(math.log10(law.bound))) if law.bound else 3
    return f"{value:.{min(3, digits)}f} {law.unit}".removesuffix(" 1")


def _kind(row: dict[str, Any]) -> str:
    return " ".join(option for option in OPTIONS if option in row)


def _sum_up(rows: list[dict[str, Any]], seeds: list[int], kind: str) -> int:
    wrong = [row for row in rows if broken(row["figures"])]
    changes = sum(row["changes"] for row in rows)
    which = f" {KINDS[kind]}" if kind else ""
    print(f"{len(rows)} random scenes of seed {', '.join(map(str, seeds))}{which}, "
          f"{changes} changes between arm and plate, {len(wrong)} scenes break a law")  # fmt: skip
    print(f"{'law':<8} {'bound':>8} {'worst':>10} {'broken':>14}")
    for law in LAWS_WIRED if "wire" in kind.split() else LAWS:
        print(_line(law, rows))
    itself = sum(row["figures"].get(VIRTUAL.name, 0.0) > VIRTUAL.bound for row in rows)
    print(f"{VIRTUAL.says}: {itself} scenes")
    if "wire" in kind.split():
        print(_out_of_reach(rows))
    return len(wrong)


def _out_of_reach(rows: list[dict[str, Any]]) -> str:
    """Return how many of the scenes that break the plate's law would break it with the best of commands, too."""
    off = [row for row in rows if row["figures"].get(WIRED.name, 0.0) > WIRED.bound and row.get("reach")]
    know = sum(row["reach"]["know"] > WIRED.bound for row in off)
    straight = sum(row["reach"]["straight"] > WIRED.bound for row in off)
    times = sorted(row["figures"][WIRED.name] / row["reach"]["straight"] for row in off)
    middle = f"; at the median they are {times[len(times) // 2]:.1f} x as far off as these" if times else ""
    return (
        f"{WIRED.name}: of {len(off)} scenes that break it, {know} do with commands that know the finger's path, too, "
        f"{straight} with commands that take it to go on straight{middle}"
    )


def _line(law: Law, rows: list[dict[str, Any]]) -> str:
    figures = [row["figures"][law.name] for row in rows if law.name in row["figures"]]
    worst = _figure(law, max(figures)) if figures else "-"
    count = sum(figure > law.bound for figure in figures)
    return f"{law.name:<8} {_figure(law, law.bound):>8} {worst:>10} {f'{count} of {len(figures)}':>14}  {law.says}"
