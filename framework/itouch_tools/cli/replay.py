"""``itouch-py replay FILE.mcap``: feed recorded readings to the engine, and compare every command; or show them."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from itouch.schema import ItouchError
from itouch.schema.terminal import note
from itouch.schema.wait_notices import Wait, waiting
from itouch_tools.cli import pictures, sounds
from itouch_tools.cli.arguments import Parser

if TYPE_CHECKING:
    from itouch.recording import Recording
    from itouch.session.replaying import Outcome

#: Ticks between two reports of progress.
_TOLD = 500


def main(argv: Sequence[str]) -> int:
    """Feed a recording to the engine and compare every command; exit code 1 if one differs."""
    parser = Parser(prog="itouch-py replay", description=main.__doc__)
    parser.add_argument("recording", metavar="FILE.mcap", help="a recording")
    parser.add_argument("--view", action="store_true",
                        help="play it in a window with a time line; nothing is compared then")  # fmt: skip
    pictures.add_options(parser)
    sounds.add_options(parser)
    options = parser.parse_args(argv)
    if options.view and (options.screenshot or options.film or options.wav):
        raise ItouchError("--view opens a window; --screenshot, --film and --wav need none: choose one")
    if options.view:
        _need_display()
    return _view(options.recording) if options.view else _compare(options)


def _need_display() -> None:
    from itouch_tools.viewer.offscreen import has_display

    if not has_display():
        raise ItouchError("there is no display for --view; --screenshot FILE.png and --film FILE.mp4 need none")


def _read(path: str) -> Recording:
    """Read a recording, and say what of it is lost."""
    from itouch.recording import read

    recording = read(path)
    for loss in recording.losses:
        note(loss)
    return recording


def _view(path: str) -> int:
    """Play a recording in a window until the window is closed."""
    from itouch_tools.viewer.offscreen import open_player
    from itouch_tools.viewer.played_session import Playback
    from itouch_tools.viewer.recording_seek import SeekableRecording

    with waiting(f"reading {path}"):
        playback = Playback(SeekableRecording(_read(path)))
    open_player(playback, time.perf_counter).show()
    return 0


def _compare(options: argparse.Namespace) -> int:
    with waiting(f"replaying {options.recording}") as wait:
        recording = _read(options.recording)
        begin = time.perf_counter()
        outcome = _replay(recording, options, wait)
        spent = time.perf_counter() - begin
    if outcome.skipped:
        note(f"{outcome.skipped} ticks after gaps could not be replayed")
    seconds = outcome.ticks * recording.period
    print(f"{recording.path}: {outcome.ticks} ticks ({seconds:.3f} s) replayed in {spent:.1f} s, "
          f"{outcome.compared} commands compared, {outcome.mismatches} mismatches")  # fmt: skip
    if not outcome.ticks:
        why = "holds no samples" if recording.whole else "is damaged or was cut before the end of its first samples"
        print(f"nothing was compared: '{recording.path}' {why}", file=sys.stderr)
    if outcome.first is not None:
        print(f"first difference: {outcome.first}")
    if outcome.largest is not None:
        print(f"largest difference: {outcome.largest.share:.2g} of the value; {outcome.largest}")
    if outcome.mismatches and outcome.elsewhere:
        note(f"'{recording.path}' was made with {', '.join(outcome.elsewhere)}: there the last digits may be others")
    return 1 if outcome.mismatches or not outcome.ticks else 0


def _replay(recording: Recording, options: argparse.Namespace, wait: Wait) -> Outcome:
    """Replay a recording, and take the pictures and the sound that are asked for."""
    from itouch.servo.prepare import prepare_replay

    work = prepare_replay(recording)
    session = work.session
    end = (int(recording.ticks[-1]) + 1) * recording.period if len(recording.ticks) else None
    with pictures.taking(session, options, end=end), sounds.keeping(session, options):
        while work.step():
            if work.feed.at % _TOLD == 0:
                wait.part(work.feed.at / len(work.feed.ticks))
        wait.part(None)
    return work.outcome()
