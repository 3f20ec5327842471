"""``itouch-py bench faults``: how the supervisor handles every fault in every device in every phase of a touch."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path

from itouch.plugin.discovery import Catalog
from itouch_evidence.faults.matrix import KINDS, Cell, pairs, run_cell, single
from itouch_evidence.faults.phases import PHASES, phases, prepared
from itouch_evidence.faults.random_rigs import campaign
from itouch_evidence.renamed import RenamedCatalog, Renaming

__all__ = ["KINDS", "PHASES", "Cell", "differing", "main", "pairs", "phases", "prepared", "run_cell", "single"]


def main(argv: Sequence[str]) -> int:
    """Run the matrix of faults, or all pairs of them in contact; exit code 1 if anything passed an absolute limit."""
    parser = argparse.ArgumentParser(prog="itouch-py bench faults", description=main.__doc__)
    parser.add_argument("scene", nargs="?", metavar="SCENE", help="default: the four-material scene")
    parser.add_argument("--pairs", action="store_true", help="all pairs of faults, in contact")
    parser.add_argument(
        "--exchange",
        type=int,
        metavar="MS",
        help="through the entrance of hardware: a display that is exchanged with every N ms",
    )
    parser.add_argument(
        "--threads", action="store_true", help="with --exchange: in threads, in real time, instead of in step"
    )
    parser.add_argument("--part", type=int, default=1, metavar="N", help="with --exchange: every Nth cell only")
    parser.add_argument("--all", action="store_true", help="print every cell, not only the sums and what is wrong")
    parser.add_argument("--random", type=int, metavar="N", help="run N random rigs instead, with random names")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random rigs")
    parser.add_argument("--keep", metavar="FILE", help="with --random: add each result to this file, run only what it "
                        "has not, and sum up all that it has")  # fmt: skip
    parser.add_argument(
        "--renamed",
        type=int,
        metavar="SEED",
        help="run every cell again with random words for the names of all channels and fields, and compare",
    )
    options = parser.parse_args(argv)
    if options.random is not None:
        return 1 if campaign(options.random, options.seed, options.keep) else 0
    if options.exchange is not None:
        return _exchanged(options)
    scene = options.scene or shipped_scene()
    cells = _cells(scene, None, paired=options.pairs)
    if options.renamed is not None:
        other = RenamedCatalog(options.renamed)
        return _compare(cells, _cells(scene, other, paired=options.pairs), other.words)
    return _tell(cells, every=options.all)


def _exchanged(options: argparse.Namespace) -> int:
    from itouch_evidence.faults.behind_wires import Pair, cells, stored

    scene = options.scene or shipped_scene()
    pair = Pair(scene, options.exchange, threads=False, slots=1 + options.pairs)
    phases = stored(pair)
    if options.threads:  # the phases are found in lockstep; what follows is in real time
        pair.close()
        pair = Pair(scene, options.exchange, threads=True, slots=1 + options.pairs)
    try:
        wrong = _tell(cells(pair, phases, both=options.pairs, every=options.part), every=options.all)
    finally:
        pair.close()
    print(f"heat was checked {pair.checks / pair.watched:.0f} times a second")
    return wrong


def _cells(scene: Path | str, catalog: Catalog | None, *, paired: bool) -> Iterator[Cell]:
    session = prepared(scene, slots=2 if paired else 1, catalog=catalog)
    stored = phases(session)
    yield from pairs(session, "contact", stored["contact"]) if paired else single(session, stored)


def differing(one: Cell, other: Cell, words: Renaming) -> list[str]:
    """Return the fields in which a cell and the same one under other names differ; names in sentences are put back."""
    said = words.back(other.cause).replace("_", " ") == one.cause.replace("_", " ")
    apart = [part.name for part in fields(Cell) if getattr(one, part.name) != getattr(other, part.name)]
    return [name for name in apart if name != "cause" or not said]


def _compare(cells: Iterable[Cell], others: Iterable[Cell], words: Renaming) -> int:
    """Print every cell whose result differs under other names, and how many there are."""
    count = wrong = 0
    for one, other in zip(cells, others, strict=True):
        count += 1
        if apart := differing(one, other, words):
            wrong += 1
            print(
                f"{_row(one)}\n{_row(other)}\n  differs in {', '.join(apart)}: {one.cause!r}, {other.cause!r}",
                flush=True,
            )
    print(f"{count} cells under random names, {wrong} with another result")
    return 1 if wrong else 0


def shipped_scene() -> Path:
    """Return the path of the four-material scene that does not wait for the skin, in a checkout or an installation."""
    import itouch

    package = Path(itouch.__file__).parent
    scenes = [place / "scenes" / "four_materials_hurried.xml" for place in (package, package.parents[1])]
    return next(scene for scene in scenes if scene.exists())


def _tell(cells: Iterable[Cell], *, every: bool) -> int:
    found = []
    for cell in cells:
        found.append(cell)
        if every or not cell.good:
            print(_row(cell), flush=True)
    trips = Counter(cell.trip or "none: inside the limits" for cell in found)
    after = [cell.safe_after for cell in found if cell.safe_after is not None]
    wrong = [cell for cell in found if not cell.good]
    print(f"{len(found)} cells, {len(wrong)} wrong")
    early = sum(cell.early for cell in found)
    if early:
        print(f"{early} of them were stopped before their fault began, and show nothing of it")
    for trip, count in trips.most_common():
        print(f"  {count:4d}  {trip}")
    if after:
        print(f"safe state verified after at most {max(after):.3f} s, in half of them within {_median(after):.3f} s")
    if 2 * early > len(found):
        print("NOT SHOWN: most cells never reached their fault; run it on a machine with less to do", file=sys.stderr)
    return 1 if wrong or 2 * early > len(found) else 0


def _median(values: list[float]) -> float:
    return sorted(values)[len(values) // 2]


def _row(cell: Cell) -> str:
    faults = " + ".join(f"{device} {kind}" for device, kind in cell.faults)
    after = "" if cell.after is None else f"{cell.after:.3f} s"
    safe = "" if cell.safe_after is None else f"safe {cell.safe_after:.3f} s later"
    wrong = "; ".join((*cell.broken, *(() if cell.safe else ("not safe",)), *(() if cell.told else ("not told",))))
    line = f"{cell.phase:12} {faults:44} {cell.trip or 'inside the limits':18} {after:8} {safe:22}"
    return f"{line} WRONG: {wrong} ({cell.cause})" if wrong else line.rstrip()
