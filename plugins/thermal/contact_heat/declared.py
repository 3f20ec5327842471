"""Dataclass fields that declare in their metadata what they may hold: unit, range and meaning.

The metadata are plain: ``kind`` (``quantity``, ``text``, ``choice``, ``child``, ``children``), ``doc``, and where they
apply ``unit``, ``low``, ``high``, ``absolute``, ``values``, ``elements``.  A program can thus read files and write
messages or a reference from the same declaration.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import MISSING
from typing import Any

#: Greatest temperature of anything [K].
HOTTEST = 3000.0


def _field(default: Any, **declared: Any) -> Any:
    return dataclasses.field(default=default, metadata=declared, kw_only=True)


def quantity(unit: str, *, low: float, high: float, default: Any = MISSING, doc: str = "") -> Any:
    """Declare a number with an SI unit, from ``low`` to ``high``."""
    return _field(default, kind="quantity", unit=unit, low=low, high=high, doc=doc)


def temperature(*, low: float = 0.0, high: float = HOTTEST, default: Any = MISSING, doc: str = "") -> Any:
    """Declare an absolute temperature [K]."""
    return _field(default, kind="quantity", unit="K", low=low, high=high, absolute=True, doc=doc)


def text(*, default: Any = MISSING, doc: str = "") -> Any:
    """Declare free text."""
    return _field(default, kind="text", doc=doc)


def choice(*values: str, default: Any = MISSING, doc: str = "") -> Any:
    """Declare one word out of a closed set."""
    return _field(default, kind="choice", values=values, doc=doc)


def child(element: type, *, doc: str = "") -> Any:
    """Declare a nested element that may occur once."""
    return _field(None, kind="child", elements=(element,), doc=doc)


def children(element: type, *, doc: str = "") -> Any:
    """Declare nested elements in order, as a tuple."""
    return _field((), kind="children", elements=(element,), doc=doc)


def validate(instance: Any) -> None:
    """Check every number of a dataclass instance against its declaration; call it from ``__post_init__``.

    Raises
    ------
    ValueError
        If one is out of range; the message names the field, the value and the allowed range.
    """
    for field in dataclasses.fields(instance):
        value = getattr(instance, field.name)
        if field.metadata.get("kind") != "quantity" or value is None:
            continue
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            raise ValueError(f"{field.name} = {value!r} is not a number")
        low, high, unit = (field.metadata[word] for word in ("low", "high", "unit"))
        if not math.isfinite(value) or not low <= value <= high:
            raise ValueError(f"{field.name} = {value!r} is out of range: {low:g} to {high:g} {unit}")
