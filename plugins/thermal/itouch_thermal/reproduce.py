"""Draw the paper's figures and check its claims, from code."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from itouch.plugin import need, waiting
from itouch.plugin.commands import command_parser, output_folder
from itouch_thermal.atomic_write import write_whole

if TYPE_CHECKING:
    from itouch_thermal.paper.claim import Claim
    from itouch_thermal.paper.figures import Figure

#: Rough duration of each figure, of a claim and of the session [s] on an idle machine; only to estimate the time left.
_WEIGHTS = {3: 4.0, 4: 3.0, 5: 4.0, 6: 4.0, 7: 4.0, 9: 1.5, 11: 5.0}
_CLAIM, _SESSION = 0.6, 4.0


def main(argv: Sequence[str]) -> int:
    """Draw the paper's figures and check its claims."""
    options = _parser().parse_args(list(argv))
    need("plot", "reproduce")
    need("bench", "reproduce")
    begun, out = time.monotonic(), Path(options.out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        wrote = _reproduce(out, options)
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"wrote {wrote} to {out} in {time.monotonic() - begun:.0f} s")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("itouch-py reproduce", __doc__)
    parser.add_argument(
        "-o",
        "--out",
        type=output_folder,
        default="reproduced",
        metavar="DIR",
        help="where to write; default: reproduced",
    )
    parser.add_argument("--figure", type=int, action="append", default=[], metavar="N",
                        help="only this figure of the paper, without the claims; may be repeated")  # fmt: skip
    parser.add_argument("--csv", action="store_true", help="write every curve of the figures as CSV, too")
    parser.add_argument("--measured", metavar="FOLDER",
                        help="lay a lab's curves over figures 2, 5 to 7 and 11: MATERIAL.csv with columns t and "
                             "j")  # fmt: skip
    parser.add_argument("--seconds", type=int, choices=(4, 10), default=10, help="how much of a touch is shown")
    return parser


def _reproduce(out: Path, options: argparse.Namespace) -> str:
    """Draw and check; return a summary of what was written."""
    from itouch_thermal.paper.drawing import draw, write_curves
    from itouch_thermal.paper.figures import FIGURES, LEFT_OUT, left_out, read_curves
    from itouch_thermal.paper.page import page
    from itouch_thermal.paper.work import Work

    for number in options.figure:
        if number in LEFT_OUT:
            raise ValueError(f"figure {number} is left out: {LEFT_OUT[number]}")
        if number not in FIGURES:
            raise ValueError(f"the paper has no figure {number}; there are {', '.join(map(str, FIGURES))}")
    work = Work(curves=read_curves(Path(options.measured)) if options.measured else None)
    numbers = sorted(set(options.figure) or set(FIGURES))
    for said in left_out(Path(options.measured), numbers) if options.measured else ():
        print(f"note: {said}", file=sys.stderr)
    figures: list[Figure] = []
    claims: list[Claim] = []
    jobs: list[tuple[str, float, Callable[[], Any]]] = []
    files = 0

    def make(number: int) -> None:
        nonlocal files
        figure = FIGURES[number](work)
        draw(figure, out, float(options.seconds))
        files += write_curves(figure, out) if options.csv else 0
        figures.append(figure)

    for number in numbers:
        jobs.append((f"figure {number}", _WEIGHTS.get(number, 1.0), lambda number=number: make(number)))  # type: ignore[misc]
    if not options.figure:
        jobs += _claim_jobs(work, claims)
    _run(jobs)
    wrote = f"{len(figures)} figures" if len(figures) != 1 else f"figure {figures[0].number}"
    wrote += f", {files} curves" if files else ""
    if options.figure:
        return wrote
    write_whole(out / "claims.md", page(claims, figures))
    return f"claims.md, {wrote}"


def _claim_jobs(work: Any, claims: list[Claim]) -> list[tuple[str, float, Callable[[], Any]]]:
    from itouch_thermal.paper.claims_display import DISPLAY, session_claims, session_report
    from itouch_thermal.paper.claims_touch import TOUCH

    jobs: list[tuple[str, float, Callable[[], Any]]] = [
        ("claims", _CLAIM, lambda maker=maker: claims.append(maker(work)))  # type: ignore[misc]
        for maker in (*TOUCH, *DISPLAY)
    ]
    return [*jobs, ("a session", _SESSION, lambda: claims.extend(session_claims(session_report())))]


def _run(jobs: list[tuple[str, float, Callable[[], Any]]]) -> None:
    """Do the jobs one after another, and show the progress and the time left on a terminal."""
    whole, done, begun = sum(weight for _, weight, _ in jobs), 0.0, time.monotonic()
    with waiting("reproducing") as wait:
        for name, weight, job in jobs:
            passed = time.monotonic() - begun
            left = f", {passed * (whole - done) / done:.0f} s left" if done > 0.0 else ""
            wait.part(done / whole, f"{name}{left}")
            job()
            done += weight
