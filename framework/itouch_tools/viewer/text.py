"""Text in the picture: labels that are laid out again only when their words change."""

from __future__ import annotations

from typing import Any

import pyglet

#: Monospaced fonts, of which the first that is installed is used.
FONTS = ("DejaVu Sans Mono", "Liberation Mono", "Menlo", "Consolas", "Noto Sans Mono", "monospace")
#: Smallest size of letters [points]: of smaller ones, in a window of a few pixels, some have no pixel at all, and
#: Pyglet fails to draw them.
LEAST = 2.0


class Text:
    """Draws lines of text at places in pixels; call ``begin``, then ``put`` for each line, then ``draw``."""

    def __init__(self) -> None:
        self._batch = pyglet.graphics.Batch()
        self._labels: list[Any] = []
        self._said: list[tuple[Any, ...]] = []
        self._used = 0
        self._widths: dict[float, float] = {}
        self._font = next((font for font in FONTS[:-1] if pyglet.font.have_font(font)), FONTS[-1])

    def width(self, size: float) -> float:
        """Return the width [pixels] of one letter of this size [points]."""
        size = max(size, LEAST)
        if size not in self._widths:
            label = pyglet.text.Label("0" * 50, font_name=self._font, font_size=size)
            self._widths[size] = label.content_width / 50
            label.delete()
        return self._widths[size]

    def begin(self) -> None:
        """Start a new picture."""
        self._used = 0

    def put(
        self, words: str, x: float, y: float, colour: tuple[float, float, float], *, size: float, anchor: str = "left"
    ) -> None:
        """Add a line with its baseline at a place [pixels]; ``anchor`` is left, center or right."""
        size = max(size, LEAST)
        tint = (*(round(255 * part) for part in colour), 255)
        asked = (words, round(x), round(y), tint, size, anchor)
        if self._used == len(self._labels):
            self._labels.append(self._new(asked))
            self._said.append(asked)
        elif self._said[self._used] != asked:
            self._change(self._labels[self._used], self._said[self._used], asked)
            self._said[self._used] = asked
        self._used += 1

    def _new(self, asked: tuple[Any, ...]) -> Any:
        words, x, y, tint, size, anchor = asked
        return pyglet.text.Label(
            words, font_name=self._font, font_size=size, x=x, y=y, color=tint, anchor_x=anchor, batch=self._batch
        )

    @staticmethod
    def _change(label: Any, said: tuple[Any, ...], asked: tuple[Any, ...]) -> None:
        label.begin_update()
        for index, name in enumerate(("text", "x", "y", "color", "font_size", "anchor_x")):
            if said[index] != asked[index]:
                setattr(label, name, asked[index])
        label.end_update()

    def draw(self) -> None:
        """Draw what was put; labels that were not used are emptied."""
        for index in range(self._used, len(self._labels)):
            if self._said[index][0]:
                self._labels[index].text = ""
                self._said[index] = ("", *self._said[index][1:])
        self._batch.draw()
