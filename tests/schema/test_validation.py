"""What is built in Python is checked as what a scene says: in its range, finite, and a number at all."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import pytest

from itouch import schema
from itouch.schema.diagnostics import meant


@dataclass(frozen=True)
class Params:
    """A number, several, one that may be left out, and a count."""

    delay: float = schema.quantity("s", low=0.0, high=2.0, default=1.0, doc="a delay")
    size: tuple[float, ...] = schema.quantity("m", size=3, positive=True, default=(1.0, 1.0, 1.0), doc="edges")
    most: float | None = schema.quantity("N", low=1.0, high=2.0, default=None, doc="a force")
    count: int = schema.integer(low=1, high=5, default=2, doc="how many")

    def __post_init__(self) -> None:
        schema.validate(self)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("delay", 2.5, "delay = 2.5 is out of range: 0 to 2 s"),
        ("delay", -0.1, "delay = -0.1 is out of range"),
        ("delay", math.nan, "delay = nan is out of range"),
        ("delay", "1", "delay = '1' is not a number"),
        ("delay", True, "delay = True is not a number"),
        ("size", (1.0, 1.0, 0.0), "size = 0.0 is out of range"),
        ("size", (1.0, math.inf, 1.0), "size = inf is out of range"),
        ("most", 0.5, "most = 0.5 is out of range: 1 to 2 N"),
        ("count", 6, "count = 6 is out of range"),
    ],
)
def test_what_is_out_of_its_range_is_refused_with_its_name(field: str, value: Any, said: str) -> None:
    with pytest.raises(ValueError) as refused:
        Params(**{field: value})
    assert str(refused.value).startswith(said)


def test_what_is_in_its_range_or_left_out_is_taken() -> None:
    assert Params(delay=2.0, size=(1e-3, 1.0, 2.0), most=None, count=5).most is None


@pytest.mark.parametrize(
    ("word", "names", "found"),
    [
        ("stifness", ("stiffness", "damping", "mass"), "stiffness"),
        ("stifness", ("damping", "stiffness", "stillness of it"), "stiffness"),
        ("Damping", ("damping", "dampings"), "damping"),
        ("finger3", ("finger1", "finger2"), None),  # another of its kind
        ("reader", ("header", "leader"), None),  # either may be meant
        ("colour", ("mass", "size"), None),
    ],
)
def test_only_the_one_name_that_can_have_been_meant_is_taken_for_it(
    word: str, names: tuple[str, ...], found: str | None
) -> None:
    assert meant(word, names) == (None if found is None else (word, found))


def test_a_unit_that_no_scene_may_write_can_not_be_declared():
    with pytest.raises(
        ValueError, match=r"unit 'inch' is not known: declare it in m, km, cm, mm, .*degC, or a product"
    ):
        schema.quantity("inch", default=1.0, doc="a width")
    for unit in ("", "1", "N*s/m", "1/K", "degC", "W/(m*K)", "%"):
        schema.quantity(unit, default=1.0, doc="anything")
