"""What no quantity of a scene, a study or a sweep may be: durations, rates, masses and powers are never below zero."""

from __future__ import annotations

import dataclasses
import inspect
from types import ModuleType

import pytest

from itouch.scene import elements
from itouch.schema.fields import Spec
from itouch_tools.study import study_elements
from itouch_tools.sweeps import sweep_elements

#: Units in which a number below zero means nothing.
NEVER_NEGATIVE = ("s", "Hz", "kg", "W", "N/m", "N*s/m", "m^2*K/W", "W/m/K", "kg/m^3", "J/kg/K")
#: Quantities of these units that may be below zero all the same, and why.
MAY: dict[str, str] = {}


def quantities(module: ModuleType) -> list[tuple[str, Spec]]:
    """Return each attribute of a language's elements, as ``Element.attribute``, with what it may be."""
    return [
        (f"{name}.{field.name}", field.metadata["itouch"])
        for name, cls in inspect.getmembers(module, dataclasses.is_dataclass)
        for field in dataclasses.fields(cls)
        if isinstance(field.metadata.get("itouch"), Spec) and field.metadata["itouch"].kind == "quantity"
    ]


@pytest.mark.parametrize("module", [elements, study_elements, sweep_elements], ids=["scene", "study", "sweep"])
def test_nothing_lasts_or_weighs_less_than_nothing(module: ModuleType) -> None:
    found = quantities(module)
    assert any(spec.unit in NEVER_NEGATIVE for _, spec in found)
    below = {name for name, spec in found if spec.unit in NEVER_NEGATIVE and spec.low < 0.0}
    assert below == {name for name in MAY if name in dict(found)}
