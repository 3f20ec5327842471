"""Whether a plugin declares enough: a unit, a sentence, and a role where a wrong guess could hurt."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from itouch.plugin.quantity import PLAIN, Quantity, Role
from itouch.schema.units import parse_unit

#: Units in which a reading must be given a role, since a wrong guess could hurt -> what to write.
_READINGS = {
    "K": "what is measured by one of Role.SKIN_CONTACT_TEMPERATURE, SKIN_TEMPERATURE, HEAT_SINK_TEMPERATURE or "
    "OTHER_TEMPERATURE",
}


def unit_fault(unit: str) -> str:
    """Return what is wrong with a unit, as the end of a sentence; empty if nothing is."""
    if unit in PLAIN:
        return ""
    if not unit:
        return 'has no unit: write one in SI such as unit="Pa", or unit="1" for a plain number'
    try:
        parsed = parse_unit(unit)
    except ValueError:
        return f'has the unit \'{unit}\', which is not a unit: write one in SI such as unit="N*s/m", or unit="1"'
    if parsed.factor != 1.0 or parsed.offset != 0.0:
        return f"has the unit '{unit}', which is not SI: declare it in SI, screens and files convert by themselves"
    return ""


def doc_fault(doc: str) -> str:
    """Return what is wrong with a ``doc`` text, as the end of a sentence; empty if nothing is."""
    if not doc.strip():
        return 'does not say what it is: write one sentence, such as doc="pressure in the bladder"'
    if len(doc) > 400 or "\n" in doc.strip():
        return "has more than one sentence of doc: write what it is in one line"
    return ""


def faults_of(quantities: Iterable[Quantity], what: str) -> Iterator[str]:
    """Yield what is missing or wrong, one sentence each; ``what`` is their kind, such as ``reading`` or ``field``."""
    for quantity in quantities:
        for fault in (unit_fault(quantity.unit), doc_fault(quantity.doc)):
            if fault:
                yield f"{what} '{quantity.name}' {fault}"


def unguessable(reads: Iterable[Quantity]) -> Iterator[str]:
    """Yield a sentence for each reading that cannot be used as it is, because a wrong guess of its role could hurt."""
    for channel in reads:
        if channel.role is Role.SIGNAL and channel.unit in _READINGS:
            yield f"reading '{channel.name}' in {channel.unit} has no role: say {_READINGS[channel.unit]}"
