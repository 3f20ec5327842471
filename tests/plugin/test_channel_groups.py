"""What a device declares of one thing says nothing of the others in the same group."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pytest

from itouch.plugin import Device
from itouch.plugin.groups import GROUPS


@pytest.mark.parametrize("name", sorted(GROUPS))
def test_a_group_that_is_declared_with_nothing_in_it_is_none(name: str) -> None:
    declared: Any = type("Declared", (Device,), {name: GROUPS[name]()})
    for member in fields(GROUPS[name]):
        assert getattr(declared, member.name) == getattr(Device, member.name), member.name
    assert declared.deprecations == ()


def test_one_that_may_be_opened_by_another_process_does_not_move_when_it_is() -> None:
    declared: Any = type("Declared", (Device,), {"opening": GROUPS["opening"](second_opener=True)})
    assert (declared.second_opener, declared.moves_on_open, declared.twin_only) == (True, False, False)
