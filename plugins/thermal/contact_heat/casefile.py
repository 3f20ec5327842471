"""Case files: a contact problem as JSON with a closed set of keys, temperatures in degC, all else in SI.

Short keys (``L, k, rho, c, w, T, h``) stand for the fields of the classes in `layers` and `contact`; an
unknown key is an error.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from contact_heat.declared import HOTTEST
from contact_heat.layers import Back, Film, Initial, Layer, Probe, Side

#: Greatest number of times in a case file, less one.
MOST_TIMES = 1_000_000
#: 0 degC in kelvin.
CELSIUS = 273.15

_CASE = ("note", "finger", "object", "Rth", "probes", "times")
_SIDE = ("layers", "T_art", "back", "initial", "air")
_LAYER = {
    "name": "name",
    "L": "thickness",
    "k": "conductivity",
    "rho": "density",
    "c": "specific_heat",
    "w": "perfusion",
}
_BACK = {"type": "kind", "T": "temperature", "h": "coefficient"}
_INITIAL = {"type": "kind", "T": "temperature", "h": "coefficient", "T_amb": "ambient", "T_surface": "surface"}
_AIR = {"h": "coefficient", "T_amb": "ambient"}
_TIMES = ("from", "to", "per_decade", "at")
_PROBE = ("name", "side", "depth", "what")


def read_file(path: str | Path) -> Any:
    """Return the content of a JSON file.

    Raises
    ------
    ValueError
        If it is not JSON; the message names the file.
    OSError
        If the file can't be read.
    """
    if not Path(path).is_file() and Path(path).exists():
        raise ValueError(f"{path}: a folder, a pipe, a device or a socket, not a file")
    try:
        return json.loads(Path(path).read_text(encoding="utf-8-sig"), object_pairs_hook=_once)
    except _TwiceError as error:
        raise ValueError(f"{path}: {error}") from None
    except ValueError as error:
        raise ValueError(f"{path}: not JSON: {error}") from None
    except RecursionError:
        raise ValueError(f"{path}: its lists or objects are too deeply nested for a contact case") from None


class _TwiceError(ValueError):
    """A key that occurs twice in one object."""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON; without this, the last of several equal keys would count, and the others be lost."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise _TwiceError(f"key '{twice}' occurs twice in one object: remove one of them")
    return found


def fields_of(data: Any) -> dict[str, Any]:
    """Return the content of a case file as the fields of a contact.

    Raises
    ------
    ValueError
        If a field is wrong; the message names the field, the value given and what is allowed.
    """
    case = _object("case", data, _CASE, ("finger", "object", "Rth"))
    note = case.get("note", "")
    if not isinstance(note, str):
        raise ValueError(f"note = {note!r} is not text")
    return {
        "finger": _side("finger", case["finger"]),
        "object": _side("object", case["object"]),
        "resistance": _number("Rth", case["Rth"]),
        "probes": tuple(
            _probe(f"probes[{n}]", probe) for n, probe in enumerate(_list("probes", case.get("probes", [])))
        ),
        "times": _times(case["times"]) if "times" in case else (),
        "note": note,
    }


def check_times(times: Sequence[float] | np.ndarray[Any, np.dtype[np.float64]]) -> None:
    """Check that times (n,) [s] are finite, positive and ascending.

    Raises
    ------
    ValueError
        If one is not; the message names the first such time.
    """
    before = 0.0
    for n, time in enumerate(times):
        if not (math.isfinite(time) and time > 0.0):
            raise ValueError(f"times[{n}] = {float(time)!r} is out of range: more than 0 s, finite")
        if time <= before:
            raise ValueError(f"times[{n}] = {float(time)!r} is not above the one before: times must ascend")
        before = time


def _side(where: str, data: Any) -> Side:
    side = _object(where, data, _SIDE, ("layers", "initial"))
    layers = _list(f"{where}.layers", side["layers"])
    try:
        return Side(
            layers=tuple(_value(f"{where}.layers[{n}]", Layer, layer, _LAYER) for n, layer in enumerate(layers)),
            initial=_value(f"{where}.initial", Initial, side["initial"], _INITIAL),
            back=_value(f"{where}.back", Back, side["back"], _BACK) if side.get("back") is not None else None,
            arterial=_kelvin(f"{where}.T_art", _number(f"{where}.T_art", side["T_art"])) if "T_art" in side else None,
            air=_value(f"{where}.air", Film, side["air"], _AIR) if side.get("air") is not None else None,
        )
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(where) else f"{where}: {error}") from None


def _value(where: str, cls: type, data: Any, keys: Mapping[str, str]) -> Any:
    """Build one value class from its JSON object; keys of temperatures are in degC."""
    given = _object(where, data, tuple(keys))
    fields: dict[str, Any] = {}
    for key, item in given.items():
        if key in ("name", "type"):
            if not isinstance(item, str):
                raise ValueError(f"{where}.{key} = {item!r} is not text")
            fields[keys[key]] = item
        elif not (key == "L" and item is None):
            number = _number(f"{where}.{key}", item)
            fields[keys[key]] = _kelvin(f"{where}.{key}", number) if key.startswith("T") else number
    missing = [key for key in ("k", "rho", "c") if cls is Layer and key not in given]
    missing += [key for key in ("type",) if "type" in keys and key not in given]
    missing += [key for key in ("h", "T_amb") if cls is Film and key not in given]
    if missing:
        raise ValueError(f"{where}: '{missing[0]}' is missing")
    try:
        return cls(**fields)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _kelvin(where: str, celsius: float) -> float:
    """Return a temperature [K], checked here so that the message has the file's scale."""
    if not -CELSIUS <= celsius <= HOTTEST - CELSIUS:
        raise ValueError(f"{where} = {celsius!r} is out of range: {-CELSIUS:g} to {HOTTEST - CELSIUS:g} degC")
    return celsius + CELSIUS


def _probe(where: str, data: Any) -> Probe:
    given = _object(where, data, _PROBE, ("side", "depth"))
    what = given.get("what", "T")
    name = given.get("name", f"{what}_{given['side']}_{given['depth']}")
    if not isinstance(name, str):
        raise ValueError(f"{where}.name = {name!r} is not text")
    try:
        return Probe(name, given["side"], _number(f"{where}.depth", given["depth"]), what)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _times(data: Any) -> tuple[float, ...]:
    given = _object("times", data, _TIMES)
    if "at" in given:
        if len(given) > 1:
            raise ValueError("times: give either 'at' or 'from', 'to' and 'per_decade'")
        times = [_number(f"times.at[{n}]", time) for n, time in enumerate(_list("times.at", given["at"]))]
        check_times(times)
        return tuple(times)
    for key in ("from", "to", "per_decade"):
        if key not in given:
            raise ValueError(f"times: '{key}' is missing")
    first, last = _number("times.from", given["from"]), _number("times.to", given["to"])
    count = _number("times.per_decade", given["per_decade"])
    if not 0.0 < first < last:
        raise ValueError(f"times.from = {first!r} is out of range: more than 0 s and below 'to' ({last!r})")
    if not 1.0 <= count <= 1e4:
        raise ValueError(f"times.per_decade = {count!r} is out of range: 1 to 10000")
    steps = round((math.log10(last) - math.log10(first)) * count)
    if steps > MOST_TIMES:
        raise ValueError(f"times: {steps + 1} times from {first!r} to {last!r} s; there may be up to {MOST_TIMES + 1}")
    return tuple(first * 10.0 ** (n / count) for n in range(steps + 1))


def _object(where: str, data: Any, allowed: tuple[str, ...], needed: tuple[str, ...] = ()) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise ValueError(f"{where}: expected an object with {', '.join(allowed)}")
    for key in data:
        if key not in allowed:
            raise ValueError(f"{where}: unknown key '{key}'; allowed: {', '.join(allowed)}")
    for key in needed:
        if key not in data:
            raise ValueError(f"{where}: '{key}' is missing")
    return data


def _list(where: str, data: Any) -> list[Any]:
    if not isinstance(data, list):
        raise ValueError(f"{where}: expected a list")
    return data


def _number(where: str, data: Any) -> float:
    try:
        if not isinstance(data, bool) and isinstance(data, (int, float)) and math.isfinite(data):
            return float(data)
    except OverflowError:
        raise ValueError(f"{where}: a whole number of so many digits is out of range") from None
    raise ValueError(f"{where} = {data!r} is not a finite number")
