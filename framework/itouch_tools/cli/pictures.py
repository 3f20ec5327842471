"""The options of ``run`` that take pictures, on a machine with or without a display."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from itouch.schema import ItouchError
from itouch.schema.extras import need
from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import picture_size, seconds
from itouch_tools.cli.output_files import Output, picture_file

if TYPE_CHECKING:
    from itouch.session import Session


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    group = parser.add_argument_group("pictures (simulated sessions; no display needed)")
    group.add_argument("--screenshot", type=picture_file, metavar="FILE.png", help="write a picture of the window")
    group.add_argument("--at", type=seconds, metavar="2.5s", help="when the picture is taken; default: at the end")
    group.add_argument(
        "--film", type=Output("film", (".mp4", ".gif")), metavar="FILE.mp4|.gif", help="write a film of the run"
    )
    group.add_argument("--size", type=picture_size, default=(1280, 720), metavar="1280x720",
                       help="size of picture and film [pixels]")  # fmt: skip


@contextlib.contextmanager
def taking(session: Session, options: argparse.Namespace, *, end: float | None) -> Iterator[None]:
    """Take the pictures that were asked for while the session runs.

    Parameters
    ----------
    session
        The session.
    options
        What the command line says.
    end
        When the session will end [s], if that is known.

    Raises
    ------
    ItouchError
        If the loop is paced in real time, the session ends before the picture, or there is no OpenGL.
    """
    if options.at is not None and not options.screenshot:
        raise ItouchError("--at says when the picture is taken: give --screenshot FILE.png too")
    if (
        options.at is not None
        and end is not None
        and round(options.at / session.model.period) > round(end / session.model.period)
    ):
        raise ItouchError(f"--at {options.at:g} s is after the end, which is at {end:g} s: choose an earlier time")
    if options.at is not None and round(options.at / session.model.period) < int(session.state["tick"]):
        raise ItouchError(
            f"--at {options.at:g} s is before the start, which is at {session.seconds:g} s: choose a later time"
        )
    if options.film:
        need("film", "--film")
    if not (options.screenshot or options.film):
        yield
        return
    if session.clock.pace == "real":
        raise ItouchError("--screenshot and --film draw between ticks: they need --pace fast; a window does not")
    from itouch_tools.viewer.film import Filming

    filming = Filming(
        session.model, session.state, session.statistics.faults, screenshot=options.screenshot or "", at=options.at,
        film=options.film or "", size=options.size,
    )  # fmt: skip
    session.taps.append(filming.tap)
    try:
        yield
    finally:
        session.taps.remove(filming.tap)
        with waiting(f"writing {options.film or options.screenshot}"):
            filming.close()
