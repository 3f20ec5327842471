"""Errors on their way from the servo process to its launcher: as plain data, and back."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Mapping
from typing import Any

from itouch.loop import DeviceFaultError, EngineError, LatchedError
from itouch.plugin import DeviceError
from itouch.safety import Trip
from itouch.schema import ItouchError, Place, Problem, SceneError
from itouch.schema.diagnostics import class_of, named, spoken
from itouch.servo.shared_memory import ServoError
from itouch.session import SessionError

_PLAIN: Mapping[str, type[Exception]] = {
    cls.__name__: cls for cls in (DeviceError, EngineError, LatchedError, SessionError, ServoError, ValueError)
}


class ServoTracebackError(ItouchError):
    """The cause of an error that came from the servo process: its traceback there, as text."""


def let_go(error: BaseException) -> None:
    """Free what the frames of an error hold if memory has run out: making devices safe may need some.

    The frames stay named in the traceback; only their variables are gone.
    """
    with contextlib.suppress(BaseException):  # any access to an error of a plugin may fail
        chain: list[BaseException] = []
        link: BaseException | None = error
        while link is not None and link not in chain:
            chain.append(link)
            link = link.__cause__ or link.__context__
        if any(isinstance(one, MemoryError) for one in chain):
            for one in chain:
                traceback.clear_frames(one.__traceback__)


def encode(error: BaseException) -> dict[str, Any]:
    """Return an error as plain data."""
    told: dict[str, Any] = {
        "type": class_of(error),
        "message": str(error) if issubclass(type(error), ItouchError) else spoken(error),
        "traceback": _traceback(error),
    }
    if isinstance(error, DeviceFaultError):
        told["fault"] = [error.device, error.tick, int(error.trip), error.cause]
    elif isinstance(error, SceneError):
        told["type"] = "SceneError"
        told["problems"] = [_problem(problem) for problem in error.problems]
    elif isinstance(error, ItouchError) and told["type"] not in _PLAIN:
        told["type"] = "ItouchError"
    return told


def _traceback(error: BaseException) -> str:
    try:
        return "".join(traceback.format_exception(error))
    except BaseException:  # any access to an error of a plugin, which may be in the chain, may fail
        return f"{named(error)}, without a traceback\n"


def decode(told: dict[str, Any]) -> Exception:
    """Return the error that ``encode`` was given, with the servo process's traceback as its cause."""
    error = _decode(told)
    error.__cause__ = ServoTracebackError("\n" + str(told.get("traceback", "")))
    return error


def _decode(told: dict[str, Any]) -> Exception:
    kind, message = str(told["type"]), str(told["message"])
    if "fault" in told:
        device, tick, trip, cause = told["fault"]
        return DeviceFaultError(device, tick, Trip(trip), cause)
    if "problems" in told:
        return SceneError([_as_problem(entry) for entry in told["problems"]])
    if kind in _PLAIN:
        return _PLAIN[kind](message)
    if kind == "ItouchError":
        return ItouchError(message)
    return ServoError(f"the servo process failed: {kind}: {message}")


def _place(place: Place | None) -> list[Any] | None:
    return None if place is None else [place.file, place.line, place.column, place.length, place.text]


def _problem(problem: Problem) -> dict[str, Any]:
    return {
        "code": problem.code,
        "sentence": problem.sentence,
        "place": _place(problem.place),
        "advice": problem.advice,
        "related": [[_place(place), label] for place, label in problem.related],
        "severity": problem.severity,
        "mend": problem.mend,
    }


def _as_problem(told: dict[str, Any]) -> Problem:
    place = Place(*told["place"]) if told["place"] is not None else None
    related = tuple((Place(*where), str(label)) for where, label in told["related"])
    wrong, right = told["mend"] or ("", "")
    mend = (wrong, right) if told["mend"] else None
    return Problem(told["code"], told["sentence"], place, told["advice"], related, told["severity"], mend)
