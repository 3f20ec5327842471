"""The option of ``run`` and ``replay`` that keeps a session's sound, rendered offline."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from itouch.schema import ItouchError
from itouch.schema.terminal import note
from itouch_tools.cli.output_files import Output

if TYPE_CHECKING:
    from itouch.session import Session


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the option."""
    parser.add_argument(
        "--wav",
        type=Output("sound", (".wav",)),
        metavar="FILE.wav",
        help="write the sound of a simulated run or of a recording",
    )


@contextlib.contextmanager
def keeping(session: Session, options: argparse.Namespace) -> Iterator[None]:
    """Render the sound while the session runs, if that is asked for.

    Raises
    ------
    ItouchError
        If the loop is paced in real time, or the file can't be written.
    """
    if not options.wav:
        yield
        return
    if session.clock.pace == "real":
        raise ItouchError("--wav renders between ticks: it needs --pace fast")
    from itouch_tools.sound import SoundTrack, write_wav

    track = SoundTrack(session.model, session.state)
    session.taps.append(track.tap)
    try:
        yield
    finally:
        session.taps.remove(track.tap)
        write_wav(options.wav, track.samples)
        if not track.has_sounds:
            note(f"{options.wav} is silent unless a fault is told: no object has a material with a <sound>")
