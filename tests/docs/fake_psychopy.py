"""A fake of PsychoPy where its listing is run: no window, a key at once; the names are those of PsychoPy 2026.2."""

from __future__ import annotations

import csv
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any


class Window:
    def __init__(self, size: tuple[int, int], *, color: str, units: str) -> None:
        self.shown = 0

    def flip(self) -> None:
        self.shown += 1

    def close(self) -> None:
        assert self.shown


class TextStim:
    def __init__(self, window: Window) -> None:
        self.text = ""

    def draw(self) -> None:
        assert self.text


class Clock:
    def getTime(self) -> float:
        return 0.25


class TrialHandler:
    """Trials in the order in which they were written, as often as is asked for."""

    def __init__(self, conditions: list[dict[str, Any]], *, nReps: int, method: str) -> None:
        self._rows = [dict(one) for _ in range(nReps) for one in conditions]
        self._at: dict[str, Any] = {}

    def __iter__(self) -> Iterator[dict[str, Any]]:
        for row in self._rows:
            self._at = row
            yield row

    def addData(self, name: str, value: Any) -> None:
        self._at[name] = value

    def saveAsWideText(self, path: str) -> None:
        with Path(path).open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, list(self._rows[0]))
            writer.writeheader()
            writer.writerows(self._rows)


def modules() -> dict[str, types.ModuleType]:
    """Return the modules by name."""
    found = types.ModuleType("psychopy")
    parts: dict[str, dict[str, Any]] = {
        "core": {"Clock": Clock},
        "data": {"TrialHandler": TrialHandler},
        "event": {"waitKeys": lambda keyList: keyList[:1]},
        "visual": {"Window": Window, "TextStim": TextStim},
    }
    known = {"psychopy": found}
    for name, members in parts.items():
        part = known[f"psychopy.{name}"] = types.ModuleType(f"psychopy.{name}")
        vars(part).update(members)
        setattr(found, name, part)
    return known
