"""What a modality tells of a contact and of a run, as plain data for the report, whatever its methods return."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, MutableMapping
from dataclasses import replace
from types import NoneType
from typing import Any, NamedTuple, TypedDict

import numpy as np

from itouch.plugin import Measured, Modality, Record
from itouch.plugin.write_protection import WriteProtectedRecord
from itouch.schema.plugin_errors import error_text, written_at
from itouch.world import ModalityModel, Model

#: How deep what `Modality.report` returns may be nested.
_DEEPEST = 20


class ContactFigures(TypedDict):
    """The framework's own part of a contact's entry in the report; `docs/reference/report.md` says what they mean."""

    probe: str
    object: str
    material: str
    begin_s: float
    end_s: float | None
    plate: bool
    plate_s: float | None
    plate_missed: bool | None
    plate_withdrawn: bool | None
    peak_force_N: float
    peak_penetration_mm: float
    peak_area_mm2: float
    impact_speed_m_s: float
    plate_gap_mm: float | None
    plate_lead_ms: float | None


#: Their keys, and the types of values that are plain data whatever the value is.
_OWN, _PLAIN = frozenset(ContactFigures.__annotations__), frozenset({bool, int, str, NoneType})


class ReportedFigures(NamedTuple):
    """What a modality has told: its figures by their keys, and what is wrong with what it returned, a clause each."""

    figures: dict[str, Any]
    faults: tuple[str, ...] = ()

    def entries(self, key: str) -> dict[str, Any]:
        """Return the figures, and under ``key`` what is wrong, if anything is."""
        return {**self.figures, key: "; ".join(self.faults)} if self.faults else self.figures


def of_contact(modality: ModalityModel, state: Record, probe: str, index: int) -> ReportedFigures:
    """Return what a modality has measured of a contact.

    Raises
    ------
    BaseException
        What its ``measures`` raises.
    """
    told: Any = modality.instance.measures(modality.model, state, probe, index)
    if type(told) is not dict and not isinstance(told, Mapping):
        return ReportedFigures({}, (_no_mapping(modality.instance, "measures", told),))
    figures: dict[str, Any] = {}
    faults: list[str] = []
    for key, value in told.items():
        if not isinstance(key, str) or key in _OWN:
            why = "the framework's own figure" if isinstance(key, str) else "no text"
            faults.append(f"measures returned a figure under {key!r:.40}, which is {why}: it needs a key of its own")
            continue
        plain = _number(value)
        if plain is None or isinstance(plain, float | int | str):
            figures[str(key)] = plain
        else:
            faults.append(
                f"measures returned {_kind(value)} as '{key}'; a figure is a number, a text, a yes or no, or None"
            )
    return ReportedFigures(figures, _placed(modality.instance, "measures", faults) if faults else ())


def enter(entry: MutableMapping[str, Any], modality: ModalityModel, state: Record, probe: str, index: int) -> None:
    """Put what a modality has measured into a contact's entry, where its keys are null or not there yet.

    A figure that another modality has given under the same key already stands under ``NAME:key``: both are kept.  The
    entry is made in any case, and says what is missing.
    """
    try:
        figures, faults = of_contact(modality, state, probe, index)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # one that exits neither ends the program nor loses the contact
        figures, faults = {}, (f"failed in measures: {error_text(error)}",)
    if faults:
        figures = ReportedFigures(figures, faults).entries(f"{modality.name}_error")
    for key, value in figures.items():
        if entry.get(key) is None:
            entry[key] = value
        elif value is not None:
            entry[_beside(modality, key)] = value


def own_view(modality: ModalityModel, entry: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a contact's entry with the modality's own figures under its own keys, whoever else has the same ones."""
    own = {key: entry[name] for key in entry if (name := _beside(modality, key)) in entry}
    return {**entry, **own} if own else entry


def figures_of(model: Model, contacts: Iterable[Mapping[str, Any]]) -> tuple[Measured, ...]:
    """Return the figures that a scene's modalities declare, then those of contacts under ``NAME:key``."""
    there = set[str]().union(*contacts)
    first: dict[str, Measured] = {}
    further: list[Measured] = []
    for modality in model.modalities:
        for one in modality.instance.measured:
            if one.key not in first:
                first[one.key] = one
            elif _beside(modality, one.key) in there:
                titles = (one.title or one.key, one.short_title, one.maximum_label)
                long, short, most = (f"{modality.name} {text}" if text else "" for text in titles)
                key = _beside(modality, one.key)
                further.append(replace(one, key=key, title=long, short_title=short, maximum_label=most))
    return (*first.values(), *further)


def _beside(modality: ModalityModel, key: str) -> str:
    return f"{modality.name}:{key}"


def of_run(modality: ModalityModel, state: Record) -> dict[str, Any]:
    """Return what a modality says of the run; a report is made in any case, and says what is missing."""
    instance = modality.instance
    try:
        told: Any = instance.report(modality.model, WriteProtectedRecord(state, ()))
        if not isinstance(told, Mapping):
            return {"error": _no_mapping(instance, "report", told)}
        faults: list[str] = []
        return ReportedFigures(_plain(told, "", faults, 0), _placed(instance, "report", faults)).entries("error")
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # as above
        return {"error": f"failed in report: {error_text(error)}"}


def status(modality: ModalityModel, state: Record) -> str:
    """Return a modality's few words for the live line, or in what it has failed; empty: nothing."""
    return " ".join(_words(modality, "status", state))


def contact_summary(modality: ModalityModel, entry: Mapping[str, Any]) -> str:
    """Return a modality's few words on a contact that has ended, or in what it has failed; empty: nothing."""
    return " ".join(_words(modality, "contact_summary", own_view(modality, entry)))


def contact_warnings(modality: ModalityModel, entry: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what a modality says was wrong in a contact, or in what it has failed itself."""
    return _words(modality, "contact_warnings", own_view(modality, entry))


def _words(modality: ModalityModel, method: str, of: Any) -> tuple[str, ...]:
    """Return the texts that a method returns, one or several; a run does not end because one fails."""
    asked = getattr(modality.instance, method)
    try:
        told: Any = asked(modality.model, of)
        texts = tuple(told) if isinstance(told, tuple | list) else () if told is None else (told,)
        for one in texts:
            if not isinstance(one, str):
                return (f"{modality.name}: {method} returned {_kind(one)}; words are wanted{written_at(asked)}",)
        return texts
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # one that exits does not end the program
        return (f"{modality.name} failed in {method}: {error_text(error)}",)


def _plain(value: Any, name: str, faults: list[str], depth: int) -> Any:
    """Return plain data for JSON; what cannot be is null, and noted in ``faults`` by its name."""
    if isinstance(value, np.ndarray) and value.size != 1 and value.dtype.kind in "biuf":
        value = value.tolist()
    if isinstance(value, Mapping) and depth < _DEEPEST:
        return {str(key): _plain(one, f"{name}.{key}" if name else str(key), faults, depth + 1)
                for key, one in value.items()}  # fmt: skip
    if isinstance(value, list | tuple) and depth < _DEEPEST:
        return [_plain(one, f"{name}[{place}]", faults, depth + 1) for place, one in enumerate(value)]
    plain = _number(value)
    if plain is None or isinstance(plain, float | int | str):
        return plain
    faults.append(f"report returned {_kind(value)} as '{name}', which is not plain data")
    return None


def _number(value: Any) -> Any:
    """Return a number, text, yes or no of NumPy's, or of a class made from Python's own, as Python's own.

    NaN and infinity, which JSON has not, are None; everything else is returned as it is.
    """
    if type(value) is float:
        return value if math.isfinite(value) else None
    if type(value) in _PLAIN:
        return value
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.size == 1):
        value = value.item()
    if isinstance(value, bool):
        return value
    for kind in (int, float, str):
        if isinstance(value, kind):
            value = kind(value)
            return None if kind is float and not math.isfinite(value) else value
    return value


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.size} numbers" if value.dtype.kind in "biufc" else "an array"
    return f"a value of type {type(value).__name__}"


def _no_mapping(instance: Modality, method: str, value: Any) -> str:
    what = "None" if value is None else _kind(value)
    return f"{method} returned {what}; a mapping of names to figures is wanted, {{}} if there are none" + written_at(
        getattr(instance, method)
    )


def _placed(instance: Modality, method: str, faults: list[str]) -> tuple[str, ...]:
    where = written_at(getattr(instance, method)) if faults else ""
    return tuple(f"{fault}{where}" for fault in faults)
