"""Units by our closed table and by pint: the same factor and the same dimension for whatever is written."""

from __future__ import annotations

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch.schema.units import CELSIUS_OFFSET, SYMBOLS, parse_unit

PINT: pint.UnitRegistry = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
#: Our dimension's places in pint's words; angles have none there.
PLACES = ("[mass]", "[length]", "[time]", "[temperature]", "[current]")

symbols = st.sampled_from([symbol for symbol in SYMBOLS if symbol != "%"])
powers = st.sampled_from(["", "", "^2", "^3", "^-1"])
factors = st.builds(lambda symbol, power: symbol + power, symbols, powers)
expressions = st.recursive(
    factors,
    lambda inner: (
        st.builds(lambda a, sign, b: f"{a}{sign}({b})", inner, st.sampled_from("*/"), inner)
        | st.builds(lambda a, sign, b: f"{a}{sign}{b}", factors, st.sampled_from("*/"), inner)
    ),
    max_leaves=5,
)


def compared(text: str) -> None:
    ours, theirs = parse_unit(text), PINT(text).to_base_units()
    assert ours.factor == pytest.approx(float(theirs.magnitude), rel=1e-12), text
    assert ours.dimension[:5] == tuple(theirs.dimensionality.get(place, 0) for place in PLACES), text


@pytest.mark.parametrize("symbol", SYMBOLS)
def test_every_symbol_is_what_pint_says(symbol: str) -> None:
    compared(symbol)


@given(expressions)
def test_every_expression_is_what_pint_says(text: str) -> None:
    compared(text)


@given(st.floats(-273.15, 1000.0))
def test_the_celsius_scale_begins_where_pints_does(celsius: float) -> None:
    kelvin = PINT.Quantity(celsius, PINT.degC).to(PINT.kelvin).magnitude
    unit = parse_unit("degC")
    assert celsius * unit.factor + unit.offset == pytest.approx(kelvin, abs=1e-9)
    assert unit.offset == CELSIUS_OFFSET
