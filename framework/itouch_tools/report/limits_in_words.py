"""The limits in force, in words: what is limited, to how much, and who set it; from the rules of the monitors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from itouch.plugin import Rule
from itouch.world import DeviceModel
from itouch.world.supervision import rules


class LimitRow(NamedTuple):
    """One limit in force for one device."""

    device: str
    name: str
    value: str
    source: str


def limit_rows(device: DeviceModel) -> Iterator[LimitRow]:
    """Yield the limits in force for a device."""
    for rule in rules(device.monitors):
        yield LimitRow(device.name, f"{rule.number} {rule.quantity}".lstrip(), in_words(rule), rule.source)


def in_words(rule: Rule) -> str:
    """Say where a rule begins to act, where it stops, and what is never passed."""
    trip = f"trips at {rule.trip}" if rule.trip else ""
    never = f"never beyond {rule.absolute}" if rule.absolute else ""
    return ", ".join(part for part in (rule.limit, trip, never) if part)


def limit_lines(device: DeviceModel) -> Iterator[str]:
    """Yield the limits in force for a device, a line each."""
    yield f"limits of {device.name}:"
    for row in limit_rows(device):
        yield f"  {row.name}: {row.value} ({row.source})"
