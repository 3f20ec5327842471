"""What each participant's session needs, on twins and on hardware: its folder, who answers, masking noise."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from itouch.schema.terminal import number_of

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from itouch_tools.study.answer_sources import Answers
    from itouch_tools.study.reading import StudyFile
    from itouch_tools.study.session_display import Shown


def folder_of(options: argparse.Namespace) -> Path:
    """Return the folder of the study's data."""
    if options.output:
        return Path(options.output)
    path = Path(options.study)
    return path.with_name(f"{path.stem}.data")


def opening(participant: str, kept: int, left: int) -> str:
    """Return the line with which a session begins."""
    are = "is" if kept == 1 else "are"
    return (
        f"{participant}: {number_of(kept, 'trial')} {are} kept, {left} of the order {'is' if left == 1 else 'are'} left"
    )


def outcome_of(void: str, *, again: bool) -> str:
    """Return what became of a trial; ``void``: why it does not count, ``again``: whether it is tried again."""
    return f"void ({void}), {'comes again' if again else 'not repeated any more'}" if void else "kept"


def masking(file: StudyFile, options: argparse.Namespace) -> contextlib.AbstractContextManager[object]:
    """Return a context that plays masking noise if the study asks for it; warn if nothing can be heard."""
    if file.study.blind is None or not file.study.blind.noise or options.mute:
        return contextlib.nullcontext()
    from itouch_tools.sound.masking import Masker

    stack = contextlib.ExitStack()
    masker = stack.enter_context(Masker(file.study.seed))
    if not masker.heard:
        print("no sound card is found: the masking noise that the study asks for is not heard", file=sys.stderr)
    return stack


def answers_of(file: StudyFile, options: argparse.Namespace) -> tuple[Answers, Callable[[Shown], None] | None]:
    """Return who answers, and the function that shows a face, if there is a window.

    Raises
    ------
    ItouchError
        If options exclude one another, or the script can't be read.
    """
    from itouch.schema import ItouchError
    from itouch_tools.study.answer_sources import FirstAnswer, Script, Typed
    from itouch_tools.study.plugin_tasks import device_of

    if options.answers and (options.window or options.answers_from):
        raise ItouchError("--answers excludes --window and --answers-from: a script has all answers")
    brought = device_of(options.answers_from, print) if options.answers_from else None
    if options.window:
        from itouch_tools.cli.study_window import WindowAnswers

        page = file.instructions()
        window = WindowAnswers(page, light=options.light, fullscreen=options.full_screen)
        return window if brought is None else FirstAnswer(brought, window), window.show
    if options.answers == "-":
        return Script(sys.stdin), None
    if options.answers:
        try:
            return Script(Path(options.answers).read_text(encoding="utf-8").splitlines()), None
        except (OSError, UnicodeDecodeError) as error:
            raise ItouchError(f"cannot read '{options.answers}': {getattr(error, 'strerror', error)}") from error
    for line in file.instructions():
        print(line)
    if brought is not None:
        return brought, None
    return Typed(sys.stdin, lambda words: print(words, flush=True)), None
