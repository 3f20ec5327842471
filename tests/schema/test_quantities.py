from __future__ import annotations

import contextlib
import math
import re

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from itouch.schema.quantities import QuantityError, format_quantity, parse_quantity
from itouch.schema.units import parse_unit


@pytest.mark.parametrize(
    ("text", "unit", "size", "expected"),
    [
        ("60 60 20 mm", "m", 3, (0.06, 0.06, 0.02)),
        ("2.0 N/mm", "N/m", 1, (2000.0,)),
        ("0.002 m^2*K/W", "m^2*K/W", 1, (0.002,)),
        ("5", "N", 1, (5.0,)),
        ("30s", "s", 1, (30.0,)),
        ("2 min", "s", 1, (120.0,)),
        ("90 deg", "rad", 1, (math.pi / 2,)),
        ("1 kHz", "Hz", 1, (1000.0,)),
        ("3 W/m/K", "W/(m*K)", 1, (3.0,)),
        ("+1e-3 m", "m", 1, (1e-3,)),
        (".5 m", "m", 1, (0.5,)),
        ("50 %", "", 1, (0.5,)),
        ("1,2,3 mm", "m", 3, (0.001, 0.002, 0.003)),
        ("1, 2, 3 mm", "m", 3, (0.001, 0.002, 0.003)),
        ("-1,-2 ,3 mm", "m", 3, (-0.001, -0.002, 0.003)),
        ("5,6 1/s", "1/s", 2, (5.0, 6.0)),
    ],
)
def test_quantities_are_read_in_si_units(text: str, unit: str, size: int, expected: tuple[float, ...]) -> None:
    assert parse_quantity(text, unit, size=size) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("nan", "m", "not a number"),
        ("inf m", "m", "not a number"),
        ("-inf", "m", "not a number"),
        ("1_0 mm", "m", "not a number"),
        ("0x10", "m", "not a number"),
        ("1e999 m", "m", "too large"),
        ("3 kg", "N*s/m", "'kg' is not a unit of N*s/m"),
        ("3 furlong", "m", "'furlong' is not a unit"),
        ("3 m/furlong", "m", "^'furlong' is not a unit"),
        ("3 N/", "N", "^'N/' is not a unit"),
        ("1 2 m", "m", "expected 1 number, found 2"),
        ("", "m", "found 0"),
        ("mm", "m", "found 0"),
        ("3 degC", "K", "temperature difference"),
        ("3 m m", "m", "not a unit"),
        ("3 N/(m", "N/m", "lacks a ')'"),
        ("1 2 mm 3", "m", "expected"),
    ],
)
def test_bad_quantities_are_refused(text: str, unit: str, says: str) -> None:
    with pytest.raises(QuantityError, match=says.replace("(", r"\(").replace(")", r"\)").replace("*", r"\*")):
        parse_quantity(text, unit)


@pytest.mark.parametrize(
    ("text", "size", "meant"),
    [
        ("0,2 s", 1, "0.2 s"),
        ("0,2s", 1, "0.2s"),
        ("1,5e-1,2 s", 2, ""),
        ("1,2,3 s", 1, ""),
        ("1, 2 s", 1, ""),
        ("1 2 s", 1, ""),
    ],
)
def test_who_writes_decimal_commas_is_shown_the_point(text: str, size: int, meant: str) -> None:
    with pytest.raises(QuantityError, match="found") as caught:
        parse_quantity(text, "s", size=size)
    assert re.findall("did you mean '(.*)'", caught.value.advice) == ([meant] if meant else [])


@pytest.mark.parametrize("text", ["1,5 2 mm", "2 1,5 mm", "-2 -1,5 mm", "0,5 60 mm", "1 2,5mm"])
def test_a_decimal_comma_is_not_read_as_one_number_more(text: str) -> None:
    """Three numbers are expected, and there would be three."""
    with pytest.raises(QuantityError, match="a comma and spaces between its numbers"):
        parse_quantity(text, "m", size=3)


def test_celsius_is_a_point_on_a_scale() -> None:
    assert parse_quantity("22 degC", "K", absolute=True) == (295.15,)
    assert parse_quantity("15 40 degC", "K", size=2, absolute=True) == (288.15, 313.15)


def test_powers_and_products() -> None:
    unit = parse_unit("kg*m^2/s^2")
    assert unit.dimension == parse_unit("J").dimension
    assert unit.factor == 1.0
    assert parse_unit("N*s/m").dimension == parse_unit("kg/s").dimension


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=7))
def test_what_is_written_reads_to_the_same_bits(values: list[float]) -> None:
    text = format_quantity(tuple(values), "N/m")
    back = parse_quantity(text, "N/m", size=len(values))
    assert [v.hex() for v in back] == [float(v).hex() for v in values]


@given(st.text(max_size=30))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        values = parse_quantity(text, "m", size=(1, 2, 3))
    except QuantityError:
        return
    assert all(math.isfinite(value) for value in values)


@given(st.text("0123,. -m", min_size=1, max_size=9), st.integers(1, 3))
@example("1,5 x", 1)
@example("1,5 2 mm", 3)
@example("1,5 - mm", 2)
@example("0,0,", 1)
@example("1,5, m", 1)
def test_the_text_that_is_said_to_be_meant_is_read(text: str, size: int) -> None:
    with contextlib.suppress(QuantityError):
        parse_quantity(text, "m", size=size)
        return
    with pytest.raises(QuantityError) as caught:
        parse_quantity(text, "m", size=size)
    if found := re.search("did you mean '(.*)'", caught.value.advice):
        pointed = found[1]
        assert "," not in pointed
        try:
            parse_quantity(pointed, "m", size=size)
        except QuantityError as error:  # of what it may still be wrong in: its unit
            assert "expected" not in str(error), (text, pointed)
