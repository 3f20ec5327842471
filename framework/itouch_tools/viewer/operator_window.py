"""The operator's window of a study: trial, time left, devices, void trials; pause, note, stop; never the condition."""

from __future__ import annotations

from collections.abc import Sequence

import pyglet.window
from pyglet.window import key

from itouch_tools.viewer.buffers import Frame
from itouch_tools.viewer.context import config
from itouch_tools.viewer.study_screens import DARK, Palette, SessionView, StudyScreen

#: Longest note [letters].
LONGEST = 200


class OperatorWindow(pyglet.window.Window):
    """Shows how the session goes, beside the participant's window or alone.

    P pauses before the next trial, or goes on; N begins a note, which Enter ends and Esc drops; Esc asks to stop.
    Space is the dead-man's switch of hardware: it is held while the key is down and the window has the focus.

    Attributes
    ----------
    paused
        Whether the next trial shall wait.
    stopped
        Whether somebody asked to stop, or closed the window.
    held
        Whether the dead-man's switch is held.
    """

    def __init__(self, *, look: Palette = DARK, width: int = 1280, height: int = 720) -> None:
        super().__init__(width=width, height=height, caption="itouch-py study: operator", resizable=True,
                         config=config(), vsync=False)  # fmt: skip
        self.board = StudyScreen(look)
        self._frame = Frame(*self.get_framebuffer_size())
        self._shown: tuple[object, ...] | None = None
        self._note: str | None = None
        self._notes: list[str] = []
        self.paused = self.stopped = self.held = self._begins = False

    def notes(self) -> list[str]:
        """Return the notes that were written since the last call."""
        found, self._notes = self._notes, []
        return found

    def show(self, face: SessionView, lines: Sequence[tuple[str, bool]]) -> None:
        """Handle the keys, and draw if anything has changed; ``lines`` are pairs of words and whether all is well."""
        self.switch_to()
        self.dispatch_events()
        told = [*lines]
        if self.paused:
            told.append(("paused before the next trial: P goes on", False))
        if self._note is not None:
            told.append((f"note: {self._note[-44:]}_", True))
        shown = (face.cue, face.left is None or round(face.left), face.trial, face.trials, face.void, *told)
        if self.stopped or shown == self._shown:
            return
        self._shown = shown
        self.board.operator(face, told, self._frame)
        self._frame.blit()
        self.flip()

    def on_key_press(self, symbol: int, modifiers: int) -> None:
        """Pause, write a note, or stop."""
        self._begins = False
        if self._note is not None:
            self._write(symbol)
        elif symbol == key.ESCAPE:
            self.stopped = True
        elif symbol == key.P:
            self.paused = not self.paused
        elif symbol == key.N:
            self._note, self._begins = "", True
        elif symbol == key.SPACE:
            self.held = True

    def on_key_release(self, symbol: int, modifiers: int) -> None:
        """Let the switch go."""
        if symbol == key.SPACE:
            self.held = False

    def on_deactivate(self) -> None:
        """Let the switch go when another window takes the focus."""
        self.held = False

    def _write(self, symbol: int) -> None:
        if symbol == key.BACKSPACE:
            self._note = (self._note or "")[:-1]
        elif symbol == key.ESCAPE:
            self._note = None
        elif symbol in (key.ENTER, key.RETURN, key.NUM_ENTER):
            if self._note:
                self._notes.append(self._note)
            self._note = None

    def on_text(self, text: str) -> None:
        """Append to the note; the N that began it does not belong to it."""
        if self._note is not None and text.isprintable() and not self._begins:
            self._note = (self._note + text)[:LONGEST]
        self._begins = False

    def on_resize(self, width: int, height: int) -> None:
        """Draw into a frame of the new size."""
        super().on_resize(width, height)
        if hasattr(self, "_frame"):
            self._frame.delete()
            self._frame, self._shown = Frame(*self.get_framebuffer_size()), None

    def on_close(self) -> None:
        """Ask to stop; whoever opened the window closes it."""
        self.stopped, self.held = True, False
