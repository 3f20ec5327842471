"""Compiled code finds each field of State where State has it, as both follow from one declaration."""

from __future__ import annotations

import pytest

from itouch.blocks import Block, places, width
from itouch.plugin import Field, Record
from itouch.world import state_fields
from itouch_encountered import surface_fields


@pytest.mark.parametrize(
    "declared",
    [
        state_fields.FIGURES,
        state_fields.SURFACE,
        state_fields.PLATE,
        state_fields.rising_fields(),
        (*surface_fields.FIELDS, *surface_fields.OVER_WIRE),
    ],
    ids=["figures", "surface", "plate", "rising", "encountered"],
)
def test_a_field_has_the_same_place_in_a_kernel_and_in_state(declared: tuple[Field, ...]) -> None:
    state = Record.of(declared)
    whole = state.flat(declared[0].name, declared[-1].name)
    assert whole.size == width(declared)
    for number, (name, place) in enumerate(places(declared).items()):
        whole[:] = 0.0
        whole[place] = 1.0 + number
        assert state[name].reshape(-1)[0] == 1.0 + number, name


def test_a_part_that_becomes_wider_moves_all_that_follow() -> None:
    narrow, wide = Block(), Block()
    assert narrow.parts(1, 3, 1) == (0, 1, 4)
    assert wide.parts(1, 9, 1) == (0, 1, 10)
    assert (narrow.width, wide.width) == (5, 11)
