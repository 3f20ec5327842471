"""Line and column at which every element and attribute of a scene was written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from itouch.schema.diagnostics import Place
from itouch.schema.fields import specs


@dataclass(frozen=True, slots=True)
class Places:
    """Where every bound element and attribute was written; kept apart from the frozen description."""

    _elements: dict[int, tuple[Any, Place]] = field(default_factory=dict)
    _attributes: dict[tuple[int, str], Place] = field(default_factory=dict)

    def put(self, element: Any, place: Place, attributes: Mapping[str, Place]) -> None:
        """Record the place of an element, and those of its fields."""
        self._elements[id(element)] = (element, place)  # the reference keeps the id from being used again
        for name, spot in attributes.items():
            self._attributes[(id(element), name)] = spot

    def succeed(self, element: Any, before: Any) -> None:
        """Give an element the places of the element ``before``, from which it was made."""
        place = self.of(before)
        if place is not None:
            names = [name for name in specs(type(before)) if (id(before), name) in self._attributes]
            self.put(element, place, {name: self._attributes[(id(before), name)] for name in names})

    def of(self, element: Any, name: str = "") -> Place | None:
        """Return the place of an element's field, else that of the element, or None if it came from no file."""
        found = self._elements.get(id(element))
        if found is None:
            return None
        return self._attributes.get((id(element), name), found[1])

    def given(self, element: Any, name: str) -> bool:
        """Tell whether the file gives a field, so that its default does not hold."""
        return (id(element), name) in self._attributes
