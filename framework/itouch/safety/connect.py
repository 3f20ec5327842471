"""Connecting: all devices at once, each in a thread of its own, and all failures are told together.

Nothing is opened if another process, or another session, uses a wire of a device that is not optional.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from itouch.monitors import DeviceFaultError
from itouch.platforms import hardware_refused
from itouch.plugin import DeviceError
from itouch.plugin.wire_claims import WireHeldError
from itouch.safety.device_opening import PATIENCE
from itouch.safety.latch import Status
from itouch.safety.lifecycle import Lifecycle


def connect(
    lifecycles: Iterable[Lifecycle], tick: int, *, patience: float = PATIENCE,
    meanwhile: Callable[[], object] | None = None,
) -> dict[str, str]:  # fmt: skip
    """Open every device that is CLOSED, and read each once.

    Parameters
    ----------
    lifecycles
        Those of the devices.
    tick
        The number of the tick that comes next.
    patience
        How long [s] to wait for all of them.
    meanwhile
        Called again and again while it waits; what it raises ends the waiting, and what opens after that is closed.

    Returns
    -------
    dict
        Device -> why it failed; empty if all are open.
    """
    wanted = list(lifecycles)
    failures = claim_wires(wanted)
    if any(one.model.name in failures and not one.model.optional for one in wanted):
        return failures
    begun = [one for one in wanted if one.latch.status is Status.CLOSED and one.model.name not in failures]
    for one in begun:
        if why := _begin(one, patience):
            failures[one.model.name] = why
    try:
        for one in begun:
            if one.model.name not in failures and (why := one.finish_opening(meanwhile)):
                failures[one.model.name] = why
    except BaseException:  # Ctrl-C, or the session is to end: nobody takes the results of the others either
        for one in begun:
            one.give_up(0.0)
        raise
    for one in wanted:
        if one.model.name not in failures:
            first_reading(one, tick, failures)
    return {s.model.name: failures[s.model.name] for s in wanted if s.model.name in failures}


def claim_wires(lifecycles: Iterable[Lifecycle]) -> dict[str, str]:
    """Claim the wires of every device that is CLOSED.

    Returns
    -------
    dict
        Device -> who has its wire.  If one of these devices is not optional, no wire stays claimed for any device.
    """
    wanted = [one for one in lifecycles if one.latch.status is Status.CLOSED]
    failures: dict[str, str] = {}
    for one in wanted:
        if one.busy:  # whatever opens it claims them
            continue
        try:
            one.claim_wires()
        except WireHeldError as error:
            failures[one.model.name] = str(error)
    if any(one.model.name in failures and not one.model.optional for one in wanted):
        for one in wanted:
            one.free_wires()
    return failures


def _begin(one: Lifecycle, patience: float) -> str:
    """Begin to open a device; return why that is refused, or nothing."""
    if one.gate.device is not None and (refused := hardware_refused([one.model.name])):
        return refused
    try:
        one.begin_opening(patience)
    except DeviceError as error:
        return str(error)
    return ""


def first_reading(one: Lifecycle, tick: int, failures: dict[str, str]) -> None:
    """Read a device that was just opened; a failure is put into ``failures`` and stops nothing else."""
    on_loss, one.gate.on_loss = one.gate.on_loss, None  # while connecting, the caller tells of its loss
    try:
        one.gate.read(tick)
    except DeviceFaultError as error:
        failures[one.model.name] = error.cause
    finally:
        one.gate.on_loss = on_loss
