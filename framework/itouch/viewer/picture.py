"""One whole picture: the stage, the words over it, the curves beside it."""

from __future__ import annotations

from dataclasses import dataclass

from pyglet import gl

from itouch.plugin import Record
from itouch.viewer import charts, overlay
from itouch.viewer.buffers import Frame
from itouch.viewer.camera import Camera
from itouch.viewer.canvas import Canvas
from itouch.viewer.overlay import Situation, Words
from itouch.viewer.signals import Ring
from itouch.viewer.stage import Stage
from itouch.viewer.words import Text
from itouch.world import Model

_TINTS = {
    "plain": (0.86, 0.88, 0.91),
    "good": (0.45, 0.85, 0.65),
    "warn": (0.95, 0.80, 0.35),
    "bad": (1.00, 0.55, 0.40),
}
_PANEL = (0.05, 0.06, 0.08, 0.72)


@dataclass(slots=True)
class Choices:
    """What the person at the window has chosen to see."""

    thermal: bool = False
    aids: bool = True
    curves: bool = True
    help: bool = False
    words: bool = True


class Picture:
    """Draws a State with everything around it into frames; needs a current OpenGL context."""

    def __init__(self, model: Model, *, scale: float = 1.0) -> None:
        self.model, self.stage = model, Stage(model)
        self.canvas, self.text = Canvas(self.stage), Text()
        self.ring, self.camera = Ring(model), Camera()
        self.choices, self.scale = Choices(), scale
        self._framed = False

    def draw(self, state: Record, frame: Frame, now: Situation) -> None:
        """Draw a State into a frame, which stays bound."""
        chosen, size = self.choices, max(7.0, 8.0 * self.scale)
        beside = min(0.30 * frame.width, 46 * size) if chosen.curves and self.ring.charts else 0.0
        self.camera.aside = beside / frame.width
        if not self._framed:
            self.reframe(state, frame)
        self.canvas.draw(state, self.camera, frame, thermal=chosen.thermal, aids=chosen.aids)
        gl.glDisable(gl.GL_DEPTH_TEST)
        seen = charts.pixels(frame.width, frame.height)
        self.text.begin()
        if chosen.words:
            self._corner(overlay.status(self.model, state, now), frame, size, top=True)
            charts.scale(self.canvas.paint, self.text, 2.2 * size, 3.4 * size, seen, size)
        if beside:
            area = (frame.width - beside - size, size, beside, frame.height - 2 * size)
            charts.draw(self.ring, self.canvas.paint, self.text, area, seen, size)
        if now.picked:
            self._corner(overlay.properties(self.model, state, now.picked), frame, size, top=False)
        if chosen.help:
            self._middle(overlay.help_words(), frame, size)
        self.text.draw()

    def reframe(self, state: Record, frame: Frame) -> None:
        """Put everything in the picture."""
        self.camera.frame(*self.stage.bounds(state), frame.width / frame.height)
        self._framed = True

    def _corner(self, words: Words, frame: Frame, size: float, *, top: bool) -> None:
        step, lines = 2.0 * size, words.lines
        left = size
        upper = frame.height - size if top else 10 * size + step * (len(lines) + 0.4)
        self._panel(left, upper, words, frame, size)
        for index, (line, weight) in enumerate(lines):
            self.text.put(line, left + size, upper - step * (index + 1) + 0.1 * size, _TINTS[weight], size=size)

    def _middle(self, words: Words, frame: Frame, size: float) -> None:
        longest = max(len(line) for line, _ in words.lines) * self.text.width(size) + 2 * size
        left = max(size, (frame.width - longest) / 2)
        upper = (frame.height + 2.0 * size * len(words.lines)) / 2
        self._panel(left, upper, words, frame, size)
        for index, (line, weight) in enumerate(words.lines):
            self.text.put(line, left + size, upper - 2.0 * size * (index + 1), _TINTS[weight], size=size)

    def _panel(self, left: float, upper: float, words: Words, frame: Frame, size: float) -> None:
        width = max(len(line) for line, _ in words.lines) * self.text.width(size) + 2 * size
        height = 2.0 * size * (len(words.lines) + 0.4)
        area = (left, upper - height, width, height)
        seen = charts.pixels(frame.width, frame.height)
        self.canvas.paint.draw(gl.GL_TRIANGLES, charts.rectangle(area, _PANEL), seen)
