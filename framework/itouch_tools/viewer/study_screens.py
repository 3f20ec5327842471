"""The screens of a study: the participant's, readable at 2 m, and the operator's; neither shows the condition.

What is shown comes as a `SessionView`: any object with these attributes.  Letters on the participant's screen are at
least 4 % of its height tall: 12 mm on a screen of 0.3 m, 20 minutes of arc at 2 m (ISO 9241-303 asks for 16).
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from pyglet import gl

from itouch_tools.viewer import shaders
from itouch_tools.viewer.buffers import Frame, Paint, Program
from itouch_tools.viewer.colours import Tint
from itouch_tools.viewer.flat_shapes import Rectangle, border, pixels, rectangle
from itouch_tools.viewer.text import Text

#: What the participant reads at each cue; a study may give its own words.
WORDS: Mapping[str, str] = {
    "skin": "Let your finger rest in the air.", "approach": "Get ready.", "go": "Touch now.",
    "contact": "Hold still.", "judge": "Lift your finger.", "lift": "Lift your finger.", "answer": "",
    "hold": "The devices wait for the operator.", "pause": "Thank you. Rest.",
    "end": "Thank you. Rest.", "break": "A break.", "done": "All done. Thank you.",
}  # fmt: skip
#: Height of a capital letter over the font's size in pixels, and pixels per point.
_LETTER, _POINT = 0.73, 96.0 / 72.0


class SessionView(Protocol):
    """What is shown of a session; see `itouch_tools.study.session_display.Shown`."""

    @property
    def cue(self) -> str:
        """What to do now."""

    @property
    def question(self) -> str:
        """The question that is asked."""

    @property
    def choices(self) -> Sequence[str]:
        """The answers to choose from."""

    @property
    def left(self) -> float | None:
        """Seconds left of the present phase; None: it has no end of its own."""

    @property
    def force(self) -> float | None:
        """Force on the finger [N]."""

    @property
    def window(self) -> tuple[float, float] | None:
        """Least and greatest force that is asked for [N]; None: there is no such window."""

    @property
    def trial(self) -> int:
        """Number of the trial, from 1."""

    @property
    def trials(self) -> int:
        """How many trials there are."""

    @property
    def void(self) -> int:
        """How many trials were void."""

    @property
    def message(self) -> str:
        """The last message."""


#: How to go on from the instructions.
GO_ON = "Enter: go on"


@dataclass(frozen=True, slots=True)
class Palette:
    """Colours of a screen."""

    ground: Tint
    ink: tuple[float, float, float]
    quiet: tuple[float, float, float]
    box: Tint
    edge: Tint
    good: Tint
    bad: Tint


DARK = Palette((0.06, 0.07, 0.09, 1.0), (0.95, 0.96, 0.97), (0.70, 0.73, 0.77), (0.16, 0.19, 0.24, 1.0),
            (0.55, 0.62, 0.70, 1.0), (0.35, 0.75, 0.55, 1.0), (0.95, 0.60, 0.30, 1.0))  # fmt: skip
LIGHT = Palette((0.97, 0.97, 0.96, 1.0), (0.08, 0.10, 0.13), (0.27, 0.30, 0.34), (0.88, 0.90, 0.93, 1.0),
             (0.35, 0.40, 0.47, 1.0), (0.10, 0.55, 0.35, 1.0), (0.80, 0.38, 0.10, 1.0))  # fmt: skip


class StudyScreen:
    """Draws a participant's or an operator's screen into frames; needs a current OpenGL context.

    ``targets`` are the areas of the choices in the last picture, for the mouse.
    """

    def __init__(self, look: Palette = DARK, words: Mapping[str, str] | None = None) -> None:
        self.look, self.words = look, {**WORDS, **(words or {})}
        self._paint = Paint(Program(shaders.PAINT_VERTEX, shaders.PAINT_FRAGMENT))
        self._text = Text()
        self.targets: list[Rectangle] = []

    def participant(self, face: SessionView, frame: Frame, *, page: Sequence[str] = ()) -> None:
        """Draw the participant's screen: instructions (``page``, lines of Markdown), else choices or what to do now."""
        self._clear(frame)
        self.targets = []
        if page:
            self._page(page, frame)
        elif face.choices:
            self._choices(face, frame)
        else:
            self._cue(face, frame)
        self._progress(face, frame)
        self._text.draw()

    def operator(self, face: SessionView, lines: Sequence[tuple[str, bool]], frame: Frame) -> None:
        """Draw the operator's screen: trial, phase, time left, and ``lines`` of (words, whether all is well)."""
        self._clear(frame)
        left = "" if face.left is None else f", {face.left:.0f} s left"
        head = [f"trial {min(face.trial, face.trials)} of {face.trials}: {face.cue}{left}", f"void: {face.void}"]
        size, margin = self._points(frame, 0.034), 0.06 * frame.height
        y = frame.height - margin - self._tall(size)
        for index, words in enumerate(head):
            self._text.put(words, margin, y, self.look.ink, size=size * (1.2 if index == 0 else 1.0))
            y -= 2.2 * self._tall(size)
        for words, well in lines:
            tint = self.look.good if well else self.look.bad
            area = (margin, y, self._tall(size), self._tall(size))
            self._fill(rectangle(area, tint), frame)
            self._text.put(words, margin + 2.0 * self._tall(size), y, self.look.ink, size=size)
            y -= 2.0 * self._tall(size)
        keys = "P pause   N note   Esc stop   Space: the rig's switch"
        self._text.put(keys, margin, 2.0 * margin, self.look.quiet, size=size)
        self._progress(face, frame)
        self._text.draw()

    def hit(self, x: float, y: float) -> int | None:
        """Return the index of the choice at a place [pixels] of the last picture, or None."""
        for index, (left, low, width, height) in enumerate(self.targets):
            if left <= x <= left + width and low <= y <= low + height:
                return index
        return None

    def _clear(self, frame: Frame) -> None:
        frame.begin()
        gl.glDisable(gl.GL_DEPTH_TEST)
        gl.glClearColor(*self.look.ground)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        self._text.begin()

    def _fill(self, rows: Any, frame: Frame) -> None:
        self._paint.draw(gl.GL_TRIANGLES, rows, pixels(frame.width, frame.height))

    @staticmethod
    def _points(frame: Frame, letter: float) -> float:
        """Return the size [points] of a font whose capital letters have this share of the picture's height."""
        return letter * frame.height / _LETTER / _POINT

    @staticmethod
    def _tall(size: float) -> float:
        """Return the height of a capital letter [pixels] in a font of this size [points]."""
        return size * _POINT * _LETTER

    def _lines(self, words: str, size: float, room: float) -> list[str]:
        return textwrap.wrap(words, max(8, int(room / self._text.width(size)))) or [""]

    def _cue(self, face: SessionView, frame: Frame) -> None:
        size = self._points(frame, 0.06)
        y, middle = 0.62 * frame.height, frame.width / 2
        for line in self._lines(self.words.get(face.cue, face.cue), size, 0.9 * frame.width):
            self._text.put(line, middle, y, self.look.ink, size=size, anchor="center")
            y -= 2.0 * self._tall(size)
        if face.window is not None and face.force is not None:
            self._bar(face.force, face.window, frame)
        elif face.left is not None and face.cue in ("pause", "break"):
            small = self._points(frame, 0.045)
            self._text.put(f"{face.left:.0f} s", middle, y, self.look.quiet, size=small, anchor="center")
        if face.message:
            small = self._points(frame, 0.04)
            for index, line in enumerate(self._lines(face.message, small, 0.9 * frame.width)[:3]):
                place = 0.30 * frame.height - index * 2.0 * self._tall(small)
                self._text.put(line, middle, place, self.look.quiet, size=small, anchor="center")

    def _bar(self, force: float, window: tuple[float, float], frame: Frame) -> None:
        """Draw the force as a bar, from 0 to twice the middle of the window, with the window marked on it."""
        low, high = window
        most = low + high
        left, bottom, wide, tall = 0.15 * frame.width, 0.38 * frame.height, 0.7 * frame.width, 0.10 * frame.height
        self._fill(rectangle((left, bottom, wide, tall), self.look.box), frame)
        share = float(np.clip(force / most, 0.0, 1.0))
        inside = low <= force <= high
        tint = self.look.good if inside else self.look.bad
        self._fill(rectangle((left, bottom, share * wide, tall), tint), frame)
        span = (left + low / most * wide, bottom, (high - low) / most * wide, tall)
        self._fill(border(span, 0.008 * frame.height, (*self.look.ink, 1.0)), frame)
        words = "" if inside else "softer" if force > high else "harder"
        size = self._points(frame, 0.045)
        middle = span[0] + span[2] / 2
        self._text.put(words, middle, bottom + 1.25 * tall, self.look.ink, size=size, anchor="center")

    def _choices(self, face: SessionView, frame: Frame) -> None:
        """Draw the question above the choices: large targets with numbers, in rows that fill the width."""
        size = self._points(frame, 0.05)
        y = 0.86 * frame.height
        for line in self._lines(face.question, size, 0.92 * frame.width)[:2]:
            self._text.put(line, frame.width / 2, y, self.look.ink, size=size, anchor="center")
            y -= 1.9 * self._tall(size)
        count = len(face.choices)
        columns = count if count <= 3 else -(-count // 2) if count <= 8 else 4
        rows, gap = -(-count // columns), 0.03 * frame.height
        top, bottom = y, 0.16 * frame.height
        wide = (frame.width - (columns + 1) * gap) / columns
        tall = (top - bottom - (rows - 1) * gap) / rows
        for index, words in enumerate(face.choices):
            row, column = divmod(index, columns)
            area = (gap + column * (wide + gap), top - (row + 1) * tall - row * gap, wide, tall)
            self.targets.append(area)
            self._fill(rectangle(area, self.look.box), frame)
            self._fill(border(area, 0.004 * frame.height, self.look.edge), frame)
            self._choice(f"{index + 1}", words, area, frame)

    def _choice(self, number: str, words: str, area: Rectangle, frame: Frame) -> None:
        left, low, wide, tall = area
        size = self._points(frame, 0.04)
        fits = 0.92 * wide / max(1, len(words)) / self._text.width(size)
        shown = size * min(1.0, max(0.6, fits))
        lines = self._lines(words, shown, 0.94 * wide)
        y = low + tall / 2 + (len(lines) - 2) * self._tall(shown)
        for line in lines:
            self._text.put(line, left + wide / 2, y, self.look.ink, size=shown, anchor="center")
            y -= 2.0 * self._tall(shown)
        small = self._points(frame, 0.028)
        corner = (left + 0.02 * frame.height, low + tall - 0.02 * frame.height - self._tall(small))
        self._text.put(number, *corner, self.look.quiet, size=small)

    def _page(self, page: Sequence[str], frame: Frame) -> None:
        """Draw instructions (headings, paragraphs and lists of Markdown), smaller if they would not fit otherwise."""
        for letter in (0.04, 0.034, 0.028, 0.022):
            size = self._points(frame, letter)
            laid = self._laid(page, size, 0.88 * frame.width)
            step = 1.9 * self._tall(size)
            if len(laid) * step <= 0.78 * frame.height:
                break
        y = 0.92 * frame.height - self._tall(size)
        for line, heading in laid:
            tint = self.look.ink if not heading else self.look.good[:3]
            self._text.put(line, 0.06 * frame.width, y, tint, size=size * (1.15 if heading else 1.0))
            y -= step
        self._text.put(GO_ON, 0.06 * frame.width, 0.1 * frame.height, self.look.quiet, size=self._points(frame, 0.04))

    def _laid(self, page: Sequence[str], size: float, room: float) -> list[tuple[str, bool]]:
        found: list[tuple[str, bool]] = []
        for written in page:
            plain = written.strip()
            heading = plain.startswith("#")
            if plain.startswith(("- ", "* ")):
                plain = f"\u2022 {plain[2:]}"
            words = plain.lstrip("#").replace("*", "").replace("`", "").strip()
            found += [(line, heading) for line in self._lines(words, size * (1.15 if heading else 1.0), room)]
        return found

    def _progress(self, face: SessionView, frame: Frame) -> None:
        """Draw the progress of the session, as a bar at the foot."""
        if face.trials <= 0:
            return
        margin, tall = 0.06 * frame.height, 0.016 * frame.height
        wide = frame.width - 2 * margin
        share = float(np.clip((face.trial - 1) / face.trials, 0.0, 1.0))
        self._fill(rectangle((margin, 0.05 * frame.height, wide, tall), self.look.box), frame)
        self._fill(rectangle((margin, 0.05 * frame.height, share * wide, tall), self.look.edge), frame)
