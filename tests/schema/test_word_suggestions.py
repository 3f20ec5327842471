"""Advice where a word is not known: the one that is alike, or all that there are, as far as a line can list them."""

from __future__ import annotations

import pytest

from itouch.schema.diagnostics import did_you_mean


@pytest.mark.parametrize(("count", "more"), [(1, False), (12, False), (13, True), (40, True)])
def test_a_dozen_are_listed_in_order_and_only_that_there_are_more_is_said(count: int, more: bool) -> None:
    names = [f"name{n:02}" for n in range(count)]
    told = did_you_mean("zzz", reversed(names), "known here")
    assert told == "known here: " + ", ".join(f"'{name}'" for name in names[:12]) + ", ..." * more


def test_who_knows_nothing_advises_nothing() -> None:
    assert did_you_mean("zzz", ()) == ""
    assert did_you_mean("stifness", ("damping", "stiffness")) == "did you mean 'stiffness'?"


def test_a_word_in_other_letters_is_found_and_of_several_such_always_the_same() -> None:
    assert did_you_mean("WOOD", ("steel", "wood")) == "did you mean 'wood'?"
    assert {did_you_mean("WOOD", names) for names in (("wood", "Wood"), ("Wood", "wood"))} == {"did you mean 'Wood'?"}
