"""The participant's window: what to do, the question, and answers by mouse, keys or a pedal that types keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pyglet.window
from pyglet.window import key

from itouch_tools.viewer.buffers import Frame
from itouch_tools.viewer.context import config
from itouch_tools.viewer.study_screens import DARK, Palette, SessionView, StudyScreen


class AskingWindow(pyglet.window.Window):
    """Shows a face, and takes the answers.

    A choice is made by its number (also on the keypad), by a click, or with the arrows and then Enter or Space, so that
    two pedals suffice.  Where there are no choices a number is typed, ended by Enter.  Esc asks to stop.

    Attributes
    ----------
    answer
        The answer to the question that is shown; empty: there is none yet.
    stopped
        Whether somebody asked to stop, or closed the window.
    """

    def __init__(
        self, *, look: Palette = DARK, words: Mapping[str, str] | None = None, page: Sequence[str] = (),
        width: int = 1280, height: int = 720, fullscreen: bool = False,
    ) -> None:  # fmt: skip
        room: dict[str, Any] = {"fullscreen": True} if fullscreen else {"width": width, "height": height}
        super().__init__(caption="itouch-py study", resizable=not fullscreen, config=config(), vsync=False, **room)
        self.board = StudyScreen(look, words)
        self._frame = Frame(*self.get_framebuffer_size())
        self._face: SessionView | None = None
        self._choices: tuple[str, ...] = ()
        self._typed, self._asking, self._chosen = "", False, 0
        self.page, self.answer, self.stopped = tuple(page), "", False

    def ask(self, choices: Sequence[str]) -> None:
        """Take answers from now on; what was pressed before does not count."""
        self.answer, self._typed, self._asking, self._chosen = "", "", True, 0
        self._choices = tuple(choices)

    def take(self) -> str:
        """Return the answer and forget it; empty: there is none yet."""
        answer, self.answer = self.answer, ""
        return answer

    def show_face(self, face: SessionView) -> None:
        """Handle keys and mouse, and draw a face if it differs from the last one."""
        self.dispatch_events()
        if self.stopped or face == self._face:
            return
        self._face = face
        self.switch_to()
        self.board.participant(face, self._frame, page=self.page)
        self._frame.blit()
        self.flip()

    def _take(self, answer: str) -> None:
        if self._asking:
            self.answer, self._asking = answer, False

    def on_key_press(self, symbol: int, modifiers: int) -> None:
        """Choose, type, go on from the instructions, or stop."""
        if symbol == key.ESCAPE:
            self.stopped = True
        elif symbol in (key.ENTER, key.RETURN, key.NUM_ENTER, key.SPACE) and self.page:
            self.page, self._face = (), None
        elif self._choices:
            self._choose(symbol)
        elif symbol in (key.ENTER, key.RETURN, key.NUM_ENTER) and self._typed:
            self._take(self._typed)
        elif symbol == key.BACKSPACE:
            self._typed = self._typed[:-1]

    def _choose(self, symbol: int) -> None:
        count = len(self._choices)
        numbers = {key._1 + n: n for n in range(9)} | {key.NUM_1 + n: n for n in range(9)}  # noqa: SLF001
        if numbers.get(symbol, count) < count:
            self._take(self._choices[numbers[symbol]])
        elif symbol in (key.RIGHT, key.DOWN, key.TAB):
            self._chosen = (self._chosen + 1) % count
        elif symbol in (key.LEFT, key.UP):
            self._chosen = (self._chosen - 1) % count
        elif symbol in (key.ENTER, key.RETURN, key.NUM_ENTER, key.SPACE):
            self._take(self._choices[self._chosen])

    def on_text(self, text: str) -> None:
        """Type a number."""
        if self._asking and not self._choices and text in "0123456789.,-":
            self._typed += text

    def on_mouse_press(self, x: int, y: int, button: int, modifiers: int) -> None:
        """Choose what is under the mouse, or go on from the instructions."""
        if self.page:
            self.page, self._face = (), None
            return
        ratio = self.get_pixel_ratio()
        index = self.board.hit(x * ratio, y * ratio)
        if index is not None and index < len(self._choices):
            self._take(self._choices[index])

    def on_resize(self, width: int, height: int) -> None:
        """Draw into a frame of the new size."""
        super().on_resize(width, height)
        if hasattr(self, "_frame"):
            self._frame.delete()
            self._frame, self._face = Frame(*self.get_framebuffer_size()), None

    def on_close(self) -> None:
        """Ask to stop; whoever opened the window closes it."""
        self.stopped = True
