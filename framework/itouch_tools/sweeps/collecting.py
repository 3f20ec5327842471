"""What is collected from a run: keys of its report, fields of State reduced over time, and results of functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from itouch.session import Session
from itouch_tools.sweeps import report_paths
from itouch_tools.sweeps.functions import load_function
from itouch_tools.sweeps.sweep_elements import FromCall, FromField, FromReport, Until

Result = float | str | None
_KINDS: Mapping[str, type] = {kind.__name__: kind for kind in (FromReport, FromField, FromCall)}


class CollectError(ValueError):
    """A result that is not of the type that the sweep states."""


class Collector:
    """Collects the results of one session after the other."""

    def __init__(self, told: Sequence[Mapping[str, Any]], folder: Path) -> None:
        self._elements = [_element(one) for one in told]
        self._functions = {
            each.name: load_function(each.function, folder) for each in self._elements if isinstance(each, FromCall)
        }
        self._ends: dict[str, Callable[[], Any]] = {}

    def begin(self, session: Session) -> None:
        """Begin to watch a session, before its first tick."""
        self._ends = {}
        for each in self._elements:
            if isinstance(each, FromField):
                reducer = Reducer(each, session)
                session.taps.append(reducer.tap)
                self._ends[each.name] = reducer.value
            elif isinstance(each, FromCall) and each.when == "begin":
                self._ends[each.name] = self._functions[each.name](session)

    def collect(self, session: Session) -> dict[str, Result]:
        """Return the results of a session that has ended, by column.

        Raises
        ------
        CollectError
            If a result is not of the type that the sweep states.
        """
        report = session.report()
        found: dict[str, Result] = {}
        for each in self._elements:
            if isinstance(each, FromReport):
                found[each.name] = from_report(report, each)
            elif isinstance(each, FromField):
                found[each.name] = _number(each.name, self._ends[each.name]())
            else:
                end = self._ends.get(each.name)
                found |= _called(each, end() if end is not None else self._functions[each.name](session))
        return found


def _element(told: Mapping[str, Any]) -> FromReport | FromField | FromCall:
    fields = {name: value for name, value in told.items() if name != "kind"}
    made: FromReport | FromField | FromCall = _KINDS[told["kind"]](**fields)
    return made


def from_report(report: Mapping[str, Any], element: FromReport) -> Result:
    """Return the value of a key of the report, reduced if there are several; None if there is none.

    Raises
    ------
    CollectError
        If it is not a number although the sweep says so.
    """
    found = report_paths.values(report, element.key)
    if "[*]" in element.key and element.reduce == "count":
        return float(len(found))
    known = [value for value in found if value is not None]
    if not known:
        return None
    if element.type_ == "text":
        return "; ".join(str(value) for value in known)
    numbers = [_number(element.key, value) or 0.0 for value in known]
    return {"mean": sum(numbers) / len(numbers), "min": min(numbers), "max": max(numbers), "sum": sum(numbers),
            "count": float(len(numbers))}[element.reduce]  # fmt: skip


def _number(name: str, value: Any) -> float | None:
    if value is None:
        return None
    if isinstance(value, (bool, int, float, np.integer, np.floating, np.bool_)):
        return float(value)
    raise CollectError(f"'{name}' is {str(value)[:60]!r}, no number: say type=\"text\", or name a part of it")


def _called(element: FromCall, value: Any) -> dict[str, Result]:
    if not element.results:
        return {element.name: str(value) if element.type_ == "text" else _number(element.name, value)}
    if not isinstance(value, Mapping):
        raise CollectError(f"'{element.function}' returned {type(value).__name__}, not a mapping of its results")
    missing = [name for name in element.results.split() if name not in value]
    if missing:
        raise CollectError(f"'{element.function}' returned no '{missing[0]}'")
    text = element.type_ == "text"
    return {
        f"{element.name}_{name}": str(value[name]) if text else _number(name, value[name])
        for name in element.results.split()
    }


class Reducer:
    """Reduces one number of State over time, tick by tick."""

    def __init__(self, element: FromField, session: Session) -> None:
        self._element, self._period = element, session.model.period
        self._view = session.state[element.of].reshape(-1)
        self._begin = round(element.begin / self._period)
        self._end = math.inf if element.end is None else round(element.end / self._period)
        self._count, self._sum, self._squares, self._above = 0, 0.0, 0.0, 0
        self._low, self._high, self._last = math.inf, -math.inf, math.nan
        self._index, self._level = element.index, element.level

    def tap(self, tick: int) -> None:
        """Take the number after a tick."""
        if not self._begin <= tick < self._end:
            return
        value = float(self._view[self._index])
        self._last = value
        self._count += 1
        self._sum += value
        self._squares += value * value
        self._above += value > self._level
        if value < self._low:
            self._low = value
        if value > self._high:
            self._high = value

    def value(self) -> float | None:
        """Return the reduced number; None if no tick counted."""
        if not self._count:
            return None
        how = self._element.reduce
        if how == "mean":
            return self._sum / self._count
        if how == "rms":
            return math.sqrt(self._squares / self._count)
        found = {"last": self._last, "min": self._low, "max": self._high, "integral": self._sum * self._period,
                 "above": self._above * self._period}  # fmt: skip
        return found[how]


def ending(rule: Mapping[str, Any]) -> float | Callable[[Session], bool] | None:
    """Return when a run ends, as a batch takes it: a time [s], a function of the session, or None: with its motion."""
    seconds, untils = rule["for_"], [Until(**each) for each in rule["until"]]
    if not untils:
        return None if seconds is None else float(seconds)

    def ends(session: Session) -> bool:
        if session.done if seconds is None else session.ticks * session.model.period >= seconds - 1e-9:
            return True
        for until in untils:
            value = float(session.state[until.field].reshape(-1)[until.index])
            if (until.above is not None and value > until.above) or (until.below is not None and value < until.below):
                return True
        return False

    return ends
