"""From the text of an attribute to its value, by the spec of its field."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

from itouch.schema.diagnostics import did_you_mean, meant
from itouch.schema.fields import Spec
from itouch.schema.hold_until import LEAST, MOST, SKIN, WORD, Until
from itouch.schema.quantities import QuantityError, describe, parse_quantity, split_unit
from itouch.schema.units import CELSIUS_OFFSET, Unit, parse_unit

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")
_INTEGER = re.compile(r"[+-]?\d{1,18}")
_FLAGS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


class ValueProblemError(ValueError):
    """A value that is not accepted: the problem's code, the advice, and the correction if only one can be meant."""

    def __init__(self, code: str, sentence: str, advice: str = "", mend: tuple[str, str] | None = None) -> None:
        super().__init__(sentence)
        self.code, self.advice, self.mend = code, advice, mend


def parse_value(spec: Spec, text: str) -> Any:
    """Read an attribute by its spec.

    Raises
    ------
    ValueProblemError
        With the code of the problem and the advice.
    """
    return _PARSERS[spec.kind](spec, text)


def _quantity(spec: Spec, text: str) -> float | tuple[float, ...]:
    try:
        values = parse_quantity(text, spec.unit, size=spec.size, absolute=spec.absolute)
    except QuantityError as error:
        raise ValueProblemError("bad-value", str(error), error.advice) from None
    for value in values:
        if not (math.isfinite(value) and spec.admits(value)):
            raise ValueProblemError(
                "out-of-range", f"{_shown(spec, text, value)} is out of range", _range_advice(spec, text, values)
            )
    return values[0] if spec.scalar else values


def _hold(spec: Spec, text: str) -> float | Until:
    words = text.split(maxsplit=2)
    if words[:1] != [WORD]:
        return _lasting(spec, text)
    example = f"such as '{WORD} {SKIN} 0.5 K'"
    if len(words) < 2 or words[1] != SKIN:
        found = f"'{words[1]}' cannot be waited for" if len(words) > 1 else "it does not say for what"
        mend = (words[1], SKIN) if len(words) > 1 and meant(words[1], (SKIN,)) else None
        raise ValueProblemError("bad-value", found, f"the skin's temperature, {example}", mend)
    if len(words) < 3:
        raise ValueProblemError("bad-value", "it does not say how near the skin must be", f"a difference, {example}")
    try:
        (within,) = parse_quantity(words[2], "K")
    except QuantityError as error:
        raise ValueProblemError("bad-value", str(error), f"a difference of temperature in K, {example}") from None
    if not LEAST <= within <= MOST:
        raise ValueProblemError("out-of-range", f"{within:g} K is out of range", f"allowed: {LEAST:g} to {MOST:g} K")
    return Until(within)


def _lasting(spec: Spec, text: str) -> float:
    """Read a duration; if it is none, add to the advice that a wait is allowed too."""
    try:
        value = _quantity(spec, text)
    except ValueProblemError as fault:
        if fault.code == "bad-value":
            fault.advice += f", or a wait such as '{WORD} {SKIN} 0.5 K'"
        raise
    return value[0] if isinstance(value, tuple) else value


def _written(spec: Spec, text: str) -> Unit | None:
    """Return the unit in which a quantity is written; None if that is the one of its range."""
    _, written = split_unit(text)
    unit = parse_unit(written)
    in_si = unit.factor == parse_unit(spec.unit).factor and unit.offset == 0.0
    return None if written == "" or in_si else unit


def _shown(spec: Spec, text: str, value: float) -> str:
    written = _written(spec, text)
    if written is None:
        return f"{value:g} {spec.unit}".strip()
    return f"{_converted(spec, written, value):g} {written.text}"


def _converted(spec: Spec, written: Unit, value: float) -> float:
    return (value - written.offset) * parse_unit(spec.unit).factor / written.factor


def _range_advice(spec: Spec, text: str, values: tuple[float, ...]) -> str:
    if spec.absolute and all(spec.admits(value + CELSIUS_OFFSET) for value in values):
        return f"did you mean '{text.removesuffix('K').strip()} degC'?"
    advice, written = f"allowed: {_allowed(spec)}", _written(spec, text)
    if written is None or spec.absolute or not any(math.isfinite(end) and end for end in (spec.low, spec.high)):
        return advice
    low, high = (_converted(spec, written, end) for end in (spec.low, spec.high))
    return f"{advice}, which is {replace(spec, unit=written.text, low=low, high=high).range_text()}"


def _allowed(spec: Spec) -> str:
    if spec.absolute and math.isfinite(spec.low) and math.isfinite(spec.high):
        return f"{spec.low - CELSIUS_OFFSET:g} to {spec.high - CELSIUS_OFFSET:g} degC"
    return spec.range_text() or describe(spec.unit, spec.size, spec.absolute)


def _integer(spec: Spec, text: str) -> int:
    if _INTEGER.fullmatch(text.strip()) is None:
        raise ValueProblemError("bad-value", f"'{text}' is not a whole number", spec.range_text())
    value = int(text)
    if not spec.admits(value):
        raise ValueProblemError("out-of-range", f"{value} is out of range", f"allowed: {spec.range_text()}")
    return value


def _text(spec: Spec, text: str) -> str:
    return text


def _file(spec: Spec, text: str) -> str:
    if not text.strip() or "\0" in text:
        raise ValueProblemError("bad-value", "it names no file", "a path relative to this file")
    return text


def _name(spec: Spec, text: str) -> str:
    if _NAME.fullmatch(text) is None:
        advice = "letters from a to z and A to Z, digits, '_' and '-', beginning with a letter or '_'"
        raise ValueProblemError("bad-value", f"'{text}' is not a name", advice)
    return text


def _choice(spec: Spec, text: str) -> str:
    if text not in spec.values:
        raise ValueProblemError(
            "bad-value",
            f"'{text}' is not one of its values",
            did_you_mean(text, spec.values, "allowed"),
            meant(text, spec.values),
        )
    return text


def _flag(spec: Spec, text: str) -> bool | str:
    if text in spec.values:
        return text
    if text not in _FLAGS:
        also = "".join(f", or {word}" for word in spec.values)
        raise ValueProblemError(
            "bad-value", f"'{text}' is neither yes nor no{also.replace('or', 'nor')}", f"yes or no{also}"
        )
    return _FLAGS[text]


_PARSERS: dict[str, Any] = {
    "quantity": _quantity,
    "hold": _hold,
    "integer": _integer,
    "text": _text,
    "file": _file,
    "name": _name,
    "ref": _name,
    "choice": _choice,
    "flag": _flag,
}
