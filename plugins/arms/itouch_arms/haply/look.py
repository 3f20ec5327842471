"""Discovery: the arms that the Inverse Service on this machine lists, and whether they can be used."""

from __future__ import annotations

from itouch.plugin import Attached
from itouch_arms.errors import ArmError
from itouch_arms.haply import messages
from itouch_arms.haply.inverse3 import SERVICE
from itouch_arms.haply.line import Line

#: How long [s] to wait for the service and for its inventory.
_WAIT = 1.0


def look(service: str = SERVICE) -> tuple[Attached, ...]:
    """Return the arms in the service's inventory; nothing is commanded to them."""
    try:
        line = Line(service, wait=_WAIT)
    except ArmError as error:
        return (Attached(f"Inverse Service at {service}", False, str(error)),)
    try:
        inventory = messages.read(line.receive(_WAIT))
        found = messages.arms(inventory)
    except ArmError as error:
        return (Attached(f"Inverse Service at {service}", False, str(error)),)
    finally:
        line.close()
    if not found:
        return (Attached(f"Inverse Service at {service}", False, "it has no Inverse3: plug it in and power it"),)
    return tuple(_attached(one) for one in found)


def _attached(one: messages.Message) -> Attached:
    where = f"Inverse3 {one['device_id']}"
    try:
        messages.check(one)
    except ArmError as error:
        return Attached(where, False, str(error))
    return Attached(where, True, "calibrated and powered, as the service says")
