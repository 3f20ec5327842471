"""A study's answers from the participant's window."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from itouch.schema.diagnostics import reason
from itouch_tools.study.answer_sources import Question, Stopped

if TYPE_CHECKING:
    from itouch_tools.study.operating import Operator
    from itouch_tools.study.session_display import Shown


class WindowAnswers:
    """Takes answers from a window, which is drawn between ticks.

    Parameters
    ----------
    page
        Instructions, lines of Markdown, which are shown until a key is pressed.
    light
        Dark letters on a light background.
    fullscreen
        Whether the window fills the screen.

    Raises
    ------
    GraphicsError
        If there is no usable OpenGL.
    """

    def __init__(self, page: Sequence[str] = (), *, light: bool = False, fullscreen: bool = False) -> None:
        from itouch_tools.viewer.offscreen import ADVICE, GraphicsError

        try:
            from itouch_tools.viewer.participant_window import AskingWindow
            from itouch_tools.viewer.study_screens import DARK, LIGHT

            self.window = AskingWindow(look=LIGHT if light else DARK, page=page, fullscreen=fullscreen)
        except Exception as error:  # pyglet raises other exceptions on each platform
            raise GraphicsError(f"no window: {reason(error)}\n  = help: {ADVICE}") from error

    def ask(self, question: Question) -> None:
        """Take answers from now on."""
        self.window.ask(question.choices)

    def poll(self, waited: float) -> str | None:
        """Return the answer, if there is one."""
        self._look()
        return self.window.take() or None

    def tell(self, words: str) -> None:
        """Do nothing: the next face contains the message."""

    def show(self, shown: Shown) -> None:
        """Draw a face; while there are instructions, wait until a key is pressed."""
        while True:
            self.window.show_face(shown)
            self._look()
            if not self.window.page:
                return
            time.sleep(0.02)

    def _look(self) -> None:
        if self.window.stopped:
            self.window.close()
            raise Stopped


def operators_window(*, light: bool = False) -> Operator:
    """Open the operator's window.

    Raises
    ------
    GraphicsError
        If there is no usable OpenGL.
    """
    from itouch_tools.viewer.offscreen import ADVICE, GraphicsError

    try:
        from itouch_tools.viewer.operator_window import OperatorWindow
        from itouch_tools.viewer.study_screens import DARK, LIGHT

        return OperatorWindow(look=LIGHT if light else DARK)
    except Exception as error:  # pyglet raises other exceptions on each platform
        raise GraphicsError(f"no window: {reason(error)}\n  = help: {ADVICE}") from error
