"""The menu: the list of keys, on which the mouse can press them.

``picture`` draws it; this module says what can be pressed in it, and where.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from itouch_tools.viewer.flat_shapes import Rectangle
from itouch_tools.viewer.overlay import KEYS, PLAYBACK_KEYS

#: For the words of a row: what can be pressed in it, and pyglet's name of the key.  Rows about the mouse press nothing.
PRESSES: dict[str, tuple[tuple[str, str], ...]] = {
    **{letter: ((letter, letter),) for letter in "HPSRTGCDNLFMU"},
    "Space": (("Space", "SPACE"),),
    "Esc": (("Esc", "ESCAPE"),),
    "+ -": (("+", "PLUS"), ("-", "MINUS")),
    "1 2 3 4 5": tuple((str(number), f"_{number}") for number in range(1, 6)),
    "P, Space": (("P", "P"), ("Space", "SPACE")),
    "Left, Right": (("Left", "LEFT"), ("Right", "RIGHT")),
    "Up, Down": (("Up", "UP"), ("Down", "DOWN")),
    "Page up, down": (("Page up", "PAGEUP"), ("down", "PAGEDOWN")),
    "Home, End": (("Home", "HOME"), ("End", "END")),
}
#: The choice of the picture that each key turns on and off.
SHOWS = {"T": "thermal", "G": "aids", "C": "curves", "N": "names", "L": "light", "U": "sound"}
#: Words of the button that opens the menu.
BUTTON = "menu (H)"
#: Words of the button beside it where there is sound: by whether it is on.
SOUND = {True: "sound on (U)", False: "sound off (U)"}


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the menu: its text, the row of keys that it belongs to, and which of its letters press which key."""

    text: str
    keys: str
    presses: tuple[tuple[int, int, str], ...]  # first letter, letters, key


def rows(*, playback: bool = False, width: int = 200) -> list[Row]:
    """Return the menu in lines of at most ``width`` letters.

    A row with one key can be pressed anywhere; in a row with several, each key is pressed at its own name.
    """
    listed = PLAYBACK_KEYS if playback else KEYS
    column = max(map(len, listed)) + 2
    found = []
    for keys, meaning in listed.items():
        presses = PRESSES.get(keys, ())
        for index, part in enumerate(textwrap.wrap(meaning, max(20, width - column))):
            text = f"{keys if index == 0 else '':<{column}}{part}"
            where: tuple[tuple[int, int, str], ...] = ((0, width, presses[0][1]),) if len(presses) == 1 else ()
            if len(presses) > 1:
                where = tuple((keys.index(word), len(word), key) for word, key in presses if index == 0)
            found.append(Row(text, keys, where))
    return found


@dataclass(frozen=True, slots=True)
class Place:
    """An area of the picture [pixels] that can be pressed, and the key that it presses."""

    area: Rectangle
    key: str

    def holds(self, x: float, y: float) -> bool:
        """Tell whether a point lies in it."""
        left, bottom, width, height = self.area
        return left <= x <= left + width and bottom <= y <= bottom + height


def places(listed: list[Row], area: Rectangle, letter: float, size: float) -> list[Place]:
    """Return the places to press in a menu that fills an area from its top; ``letter`` is a letter's width [pixels]."""
    left, bottom, width, height = area
    found = []
    for index, row in enumerate(listed):
        y = bottom + height - 2.0 * size * (index + 1)
        if y <= bottom:
            break
        for first, letters, key in row.presses:
            x = left + size + (first - 0.5) * letter
            wide = min((letters + 1.0) * letter, left + width - x)
            found.append(Place((x, y - 0.55 * size, wide, 2.0 * size), key))
    return found
