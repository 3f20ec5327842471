"""Lengths without a unit, which are metres but hardly meant so: ``size="60 60 20"`` is a box of 60 metres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from itouch.scene import Scene
from itouch.schema import Place, Problem

#: A length above this [m], large for a scene for a finger, gives a warning if it has no unit.
LARGE = 1.5
#: Attributes of an object that are lengths.
_LENGTHS = ("size", "radius", "length", "pos")


def large(scene: Scene) -> Iterator[Problem]:
    """Warn of large lengths of objects that were written without a unit."""
    for element in scene.objects:
        for name in _LENGTHS:
            value = getattr(element, name, None)
            place = scene.places.of(element, name) if scene.places.given(element, name) else None
            if value is None or place is None or not unitless(place):
                continue
            greatest = max(abs(part) for part in (value if isinstance(value, tuple) else (value,)))
            if greatest > LARGE:
                what = "is at" if name == "pos" else f"has a {name} of"
                sentence = f"object '{element.name}' {what} {greatest:g} m, as no unit is written; is it in mm?"
                advice = f'write {name}="{written(place)} mm", or m'
                yield Problem("metres", sentence, place, advice, severity="warning")


def unitless(place: Place) -> bool:
    """Tell whether the attribute at a place has numbers only."""
    text = written(place)
    return bool(text) and not any(character.isalpha() for character in text.replace("e", "").replace("E", ""))


def written(place: Place) -> str:
    """Return the text of the attribute's value at a place, or nothing."""
    text: Any = place.text[place.column - 1 : place.column - 1 + place.length]
    return str(text).partition("=")[2].strip().strip("\"'") if "=" in text else str(text).strip("\"'")
