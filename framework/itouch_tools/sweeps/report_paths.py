"""Paths in a session's report: ``contacts[0].plate_s``, ``contacts[object=wood].plate_s``, ``contacts[*].plate_s``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from itouch.schema.diagnostics import did_you_mean

_PART = re.compile(r"([^.\[\]]+)((?:\[[^\[\]]*\])*)")
_INDEX = re.compile(r"\[([^\[\]]*)\]")


def split(key: str) -> list[str | tuple[str, ...]]:
    """Split a key into names and indices; an index is ``(word,)``, or ``(name, value)`` to select entries by.

    Raises
    ------
    ValueError
        If it is not a key.
    """
    found: list[str | tuple[str, ...]] = []
    for part in key.split("."):
        match = _PART.fullmatch(part)
        if match is None:
            raise ValueError(f"'{key}' is not a key of the report; write it as in contacts[0].flux_error_rms")
        found.append(match.group(1))
        for inner in _INDEX.findall(match.group(2)):
            if "=" in inner:
                found.append(tuple(inner.split("=", 1)))
            elif inner == "*" or re.fullmatch(r"-?\d{1,6}", inner):
                found.append((inner,))
            else:
                raise ValueError(f"'[{inner}]' is neither a number nor [*] nor [name=value]")
    return found


def values(report: Any, key: str) -> list[Any]:
    """Return the values at a key: one, several if the key has ``[*]``, or none."""
    found = [report]
    for step in split(key):
        found = [value for one in found for value in _step(one, step)]
    return found


def _step(value: Any, step: str | tuple[str, ...]) -> Sequence[Any]:
    if isinstance(step, str):
        return [value[step]] if isinstance(value, Mapping) and step in value else []
    items = list(value.values()) if isinstance(value, Mapping) else value
    if not isinstance(items, list):
        return []
    if len(step) == 2:
        return [item for item in items if isinstance(item, Mapping) and str(item.get(step[0])) == step[1]]
    if step[0] == "*":
        return items
    number = int(step[0])
    return [items[number]] if -len(items) <= number < len(items) else []


def advice(report: Any, key: str) -> str:
    """Return advice on what may have been meant by a key that the report does not have, or an empty string."""
    found = [report]
    for step in split(key):
        following = [value for one in found for value in _step(one, step)]
        if not following:
            names = {name for one in found if isinstance(one, Mapping) for name in one}
            return did_you_mean(step, names, "its keys are") if isinstance(step, str) else ""
        found = following
    return ""
