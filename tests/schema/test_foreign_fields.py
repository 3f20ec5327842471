"""Dataclasses of others: fields whose metadata are a grammar's are read, those of another meaning are left alone."""

from __future__ import annotations

from dataclasses import dataclass, field

from itouch.schema.fields import quantity, specs, validate


@dataclass(frozen=True)
class Strange:
    """Parameters of a plugin that keeps words of its own beside its fields."""

    tension: float = field(default=1.0, metadata={"kind": "analog", "pin": 3})
    port: int = field(default=1, metadata={"kind": "integer", "widget": "slider"})
    colour: str = field(default="red", metadata={"kind": "primary"})
    speed: float = field(default=1.0, metadata={"kind": ["fast", "slow"]})
    travel: float = field(default=0.1, metadata={"kind": "quantity", "unit": "m", "high": 0.2})
    mass: float = quantity("kg", positive=True, default=1.0)


def test_metadata_of_another_meaning_is_left_alone() -> None:
    found = specs(Strange)
    assert list(found) == ["travel", "mass"]
    assert (found["travel"].unit, found["travel"].high) == ("m", 0.2)
    validate(Strange())
