"""The closed table of units that a number in a file may have, and what they are in SI.

A unit expression is a product of symbols with integer powers, such as ``N*s/m``, ``W/(m*K)`` or ``kg/m^3``.  A ``/``
divides by the symbol or group that follows it; parentheses group.  ``degC`` cannot be combined with others: it is a
scale with an offset, for absolute temperatures only.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

#: Exponents of kg, m, s, K, A, rad.
Dimension = tuple[int, int, int, int, int, int]

NONE: Dimension = (0, 0, 0, 0, 0, 0)
CELSIUS_OFFSET = 273.15

_KG, _M, _S, _K, _A, _RAD = (
    (1, 0, 0, 0, 0, 0),
    (0, 1, 0, 0, 0, 0),
    (0, 0, 1, 0, 0, 0),
    (0, 0, 0, 1, 0, 0),
    (0, 0, 0, 0, 1, 0),
    (0, 0, 0, 0, 0, 1),
)
_N: Dimension = (1, 1, -2, 0, 0, 0)
_J: Dimension = (1, 2, -2, 0, 0, 0)
_W: Dimension = (1, 2, -3, 0, 0, 0)
_V: Dimension = (1, 2, -3, 0, -1, 0)
_OHM: Dimension = (1, 2, -3, 0, -2, 0)
_PA: Dimension = (1, -1, -2, 0, 0, 0)
_HZ: Dimension = (0, 0, -1, 0, 0, 0)

#: Symbol -> (factor to SI, dimension).
SYMBOLS: dict[str, tuple[float, Dimension]] = {
    "m": (1.0, _M), "km": (1e3, _M), "cm": (1e-2, _M), "mm": (1e-3, _M), "um": (1e-6, _M), "µm": (1e-6, _M),
    "kg": (1.0, _KG), "g": (1e-3, _KG), "mg": (1e-6, _KG),
    "s": (1.0, _S), "ms": (1e-3, _S), "us": (1e-6, _S), "µs": (1e-6, _S), "min": (60.0, _S), "h": (3600.0, _S),
    "K": (1.0, _K), "mK": (1e-3, _K),
    "A": (1.0, _A), "mA": (1e-3, _A),
    "rad": (1.0, _RAD), "deg": (0.017453292519943295, _RAD),
    "N": (1.0, _N), "mN": (1e-3, _N), "kN": (1e3, _N),
    "J": (1.0, _J), "mJ": (1e-3, _J), "kJ": (1e3, _J), "MJ": (1e6, _J),
    "W": (1.0, _W), "mW": (1e-3, _W), "kW": (1e3, _W),
    "V": (1.0, _V), "mV": (1e-3, _V), "uV": (1e-6, _V),
    "ohm": (1.0, _OHM),
    "Pa": (1.0, _PA), "kPa": (1e3, _PA), "MPa": (1e6, _PA), "GPa": (1e9, _PA),
    "Hz": (1.0, _HZ), "kHz": (1e3, _HZ),
    "%": (1e-2, NONE),
}  # fmt: skip

_TOKEN = re.compile(r"\s*(?:(?P<symbol>[A-Za-zµ%]+)|(?P<operator>[*/()])|\^(?P<power>-?\d)|(?P<one>1(?=/)))")


@dataclass(frozen=True, slots=True)
class Unit:
    """A parsed unit expression: a number times ``factor`` plus ``offset`` is in SI."""

    text: str
    factor: float
    dimension: Dimension
    offset: float = 0.0


def is_celsius(text: str) -> bool:
    """Tell whether a unit is the Celsius scale."""
    return text in ("degC", "°C")


@cache
def parse_unit(text: str) -> Unit:
    """Parse a unit expression.

    Raises
    ------
    ValueError
        If a symbol is not in the table or the expression is malformed.
    """
    if is_celsius(text):
        return Unit(text, 1.0, _K, CELSIUS_OFFSET)
    if text == "" or text == "1":
        return Unit(text, 1.0, NONE)
    factor, dimension = _Expression(text).parse()
    return Unit(text, factor, dimension)


class _Expression:
    """A recursive-descent parser of products, quotients and powers."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = list(self._split(text))
        self._next = 0

    @staticmethod
    def _split(text: str) -> list[tuple[str, str]]:
        tokens, at = [], 0
        while at < len(text):
            match = _TOKEN.match(text, at)
            if match is None:
                raise ValueError(f"'{text}' is not a unit")
            kind = str(match.lastgroup)
            tokens.append((kind, match.group(kind)))
            at = match.end()
        return tokens

    def parse(self) -> tuple[float, Dimension]:
        result = self._product()
        if self._next != len(self._tokens):
            raise ValueError(f"'{self._text}' is not a unit")
        return result

    def _product(self) -> tuple[float, Dimension]:
        factor, dimension = self._power()
        while self._peek() in (("operator", "*"), ("operator", "/")):
            sign = 1 if self._take()[1] == "*" else -1
            other, exponents = self._power()
            factor *= other**sign
            dimension = _combine(dimension, exponents, sign)
        return factor, dimension

    def _power(self) -> tuple[float, Dimension]:
        factor, dimension = self._atom()
        if self._peek()[0] == "power":
            exponent = int(self._take()[1])
            factor, dimension = factor**exponent, _combine(NONE, dimension, exponent)
        return factor, dimension

    def _atom(self) -> tuple[float, Dimension]:
        kind, word = self._take()
        if kind == "one":
            return 1.0, NONE
        if (kind, word) == ("operator", "("):
            inside = self._product()
            if self._take() != ("operator", ")"):
                raise ValueError(f"'{self._text}' lacks a ')'")
            return inside
        if kind != "symbol" or word not in SYMBOLS:
            raise ValueError(f"'{word or self._text}' is not a unit")
        return SYMBOLS[word]

    def _peek(self) -> tuple[str, str]:
        return self._tokens[self._next] if self._next < len(self._tokens) else ("end", "")

    def _take(self) -> tuple[str, str]:
        token = self._peek()
        self._next += 1
        return token


def _combine(left: Dimension, right: Dimension, sign: int) -> Dimension:
    a, b, c, d, e, f = (x + sign * y for x, y in zip(left, right, strict=True))
    return a, b, c, d, e, f
