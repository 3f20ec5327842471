"""Numbers with a unit: ``"60 60 20 mm"`` becomes a tuple in SI.

One unit may follow the numbers; without one they are in SI.  The grammar of a number is strict:
what Python's ``float`` accepts beyond it (``nan``, ``inf``, ``1_0``) is refused.
"""

from __future__ import annotations

import math
import re

from itouch.schema import units

#: The longest time [s] that a session may be asked to run, 31 years: a number of ticks still counts it exactly.
LONGEST = 1e9
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
_SEPARATOR = re.compile(r"\s*[\s,]\s*")
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_MIXED = re.compile(r"\d,\d\S*\s+(?!1/)[-+.\d]|\d\s+[-+.]*\d\S*,\d")  # 1/s is a unit


class QuantityError(ValueError):
    """A number or unit that cannot be read; ``advice`` says what to write instead."""

    def __init__(self, sentence: str, advice: str = "") -> None:
        super().__init__(sentence)
        self.advice = advice


def checked_time(name: str, seconds: float) -> float:
    """Return a time in a session [s].

    Raises
    ------
    ValueError
        If it is no number, negative, or longer than any session.
    """
    if not 0.0 <= seconds <= LONGEST:  # false if it is not a number
        raise ValueError(f"{name} = {seconds!r} must be a finite number, at least 0 s, at most {LONGEST:.0e} s")
    return seconds


def parse_number(text: str) -> float:
    """Read one finite decimal number.

    Raises
    ------
    QuantityError
        If the text is not such a number.
    """
    if _NUMBER.fullmatch(text) is None:
        raise QuantityError(f"'{text}' is not a number", "a decimal number such as 0.25 or 2.5e-4")
    value = float(text)
    if not math.isfinite(value):
        raise QuantityError(f"'{text}' is too large for a number", "a finite number")
    return value


def split_unit(text: str) -> tuple[list[str], str]:
    """Split the numbers of a quantity from the unit at its end: ``"1 2 mm"`` -> ``(["1", "2"], "mm")``."""
    words = [word for word in _SEPARATOR.split(text.strip()) if word]
    numbers: list[str] = []
    while words and not _starts_unit(words[0]):
        numbers.append(words.pop(0))
    unit = " ".join(words)
    if numbers and not unit:
        match = _NUMBER.match(numbers[-1])
        rest = numbers[-1][match.end() :] if match else ""
        if match and rest and _is_unit(rest):
            numbers[-1], unit = match.group(), rest
    return numbers, unit


def _starts_unit(word: str) -> bool:
    if word.lower().lstrip("+-") in ("nan", "inf", "infinity"):
        return False
    return word[0].isalpha() or word[0] in "%(/°µ" or word.startswith("1/")


def _is_unit(text: str) -> bool:
    try:
        units.parse_unit(text)
    except ValueError:
        return False
    return True


def parse_quantity(
    text: str, unit: str, *, size: int | tuple[int, ...] = 1, absolute: bool = False
) -> tuple[float, ...]:
    """Read numbers with an optional unit at the end.

    Parameters
    ----------
    text
        As written in the file.
    unit
        The SI unit of the result; the unit in the text must have its dimension.
    size
        How many numbers there must be, or the allowed counts.
    absolute
        Whether it is an absolute temperature, for which ``degC`` is allowed.

    Returns
    -------
    tuple of float
        The numbers in SI.

    Raises
    ------
    QuantityError
        If a number, the count or the unit is wrong.
    """
    words, written = split_unit(text)
    counts = (size,) if isinstance(size, int) else size
    if not words and written and not _is_unit(written):
        raise QuantityError(f"'{written}' is not a number", describe(unit, size, absolute))
    numbers = [parse_number(word) for word in words]
    if _MIXED.search(text):  # "1,5 2 mm" could be three numbers, but that is hardly meant
        raise QuantityError(
            f"'{text.strip()}' has a comma and spaces between its numbers",
            "a decimal point in a number, and the same between all numbers",
        )
    if len(numbers) not in counts:
        wanted = " or ".join(str(count) for count in counts)
        raise QuantityError(
            f"expected {wanted} number{'s' if counts != (1,) else ''}, found {len(numbers)}",
            _with_points(text, counts) or describe(unit, size, absolute),
        )
    factor, offset = _conversion(written, unit, absolute, size)
    return tuple(number * factor + offset if offset else number * factor for number in numbers)


def _with_points(text: str, counts: tuple[int, ...]) -> str:
    """Return advice for a text with decimal commas; empty if the text would be wrong with points too."""
    pointed = _DECIMAL_COMMA.sub(".", text.strip()).rstrip(", ")
    words, _ = split_unit(pointed)
    whole = pointed != text.strip() and "," not in pointed
    right = whole and len(words) in counts and all(map(_NUMBER.fullmatch, words))
    return f"a comma stands between numbers; did you mean '{pointed}'?" if right else ""


def _conversion(written: str, unit: str, absolute: bool, size: int | tuple[int, ...]) -> tuple[float, float]:
    if written == "":
        return 1.0, 0.0
    advice = describe(unit, size, absolute)
    try:
        found = units.parse_unit(written)
    except ValueError as error:
        raise QuantityError(str(error), advice) from None
    wanted = units.parse_unit(unit)
    if found.dimension != wanted.dimension:
        raise QuantityError(f"'{written}' is not a unit of {unit or 'a plain number'}", advice)
    if units.is_celsius(written) and not absolute:
        raise QuantityError("'degC' is a point on a scale, but this is a temperature difference", "a difference in K")
    return found.factor / wanted.factor, found.offset


def describe(unit: str, size: int | tuple[int, ...] = 1, absolute: bool = False) -> str:
    """Return in words what is expected: ``"3 numbers in m"``."""
    what = "in K or degC" if absolute else f"in {unit}" if unit else "without a unit"
    if size == 1:
        return f"a quantity {what}" if unit else "a number without a unit"
    counts = (size,) if isinstance(size, int) else size
    return f"{' or '.join(map(str, counts))} numbers {what}"


def format_quantity(value: float | tuple[float, ...], unit: str) -> str:
    """Write numbers so that reading them gives the same bits: SI, shortest round-trip digits, unit at the end."""
    numbers = (value,) if isinstance(value, (int, float)) else value
    words = " ".join(_shortest(float(number)) for number in numbers)
    return f"{words} {unit}" if unit else words


def _shortest(number: float) -> str:
    text = repr(number)
    return text[:-2] if text.endswith(".0") else text
