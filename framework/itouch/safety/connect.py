"""Connecting: all devices at once, each in a thread of its own, and all failures are told together.

Nothing is opened if another process, or another session, uses a wire of a device that is not optional.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable

from itouch.exchange import failed_in
from itouch.monitors import DeviceFaultError
from itouch.platforms import hardware_refused
from itouch.plugin import Device, DeviceError
from itouch.plugin.wire_claims import WireHeldError
from itouch.safety.latch import Status
from itouch.safety.lifecycle import Lifecycle
from itouch.schema import ItouchError
from itouch.schema.diagnostics import named, spoken
from itouch.schema.plugin_errors import error_text

#: How long [s] a device may take to open.
PATIENCE = 15.0


def connect(lifecycles: Iterable[Lifecycle], tick: int, *, patience: float = PATIENCE) -> dict[str, str]:
    """Open every device that is CLOSED, and read each once.

    Parameters
    ----------
    lifecycles
        Those of the devices.
    tick
        The number of the tick that comes next.
    patience
        How long [s] to wait for all of them.

    Returns
    -------
    dict
        Device -> why it failed; empty if all are open.
    """
    wanted = list(lifecycles)
    failures = claim_wires(wanted)
    if any(one.model.name in failures and not one.model.optional for one in wanted):
        return failures
    threads = {}
    for one in wanted:
        if one.latch.status is Status.CLOSED and one.model.name not in failures:
            threads[one.model.name] = _start(one, failures)
    for name, thread in threads.items():
        thread.join(patience)
        if thread.is_alive():
            failures[name] = f"did not open within {patience:g} s"
    for one in wanted:
        if one.model.name not in failures:
            _first_reading(one, tick, failures)
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
        try:
            one.claim_wires()
        except WireHeldError as error:
            failures[one.model.name] = str(error)
    if any(one.model.name in failures and not one.model.optional for one in wanted):
        for one in wanted:
            one.free_wires()
    return failures


def _start(one: Lifecycle, failures: dict[str, str]) -> threading.Thread:
    """Open a device in a thread, and return it; what it raises becomes an entry of ``failures``."""

    def work() -> None:
        try:
            if one.gate.device is not None and (refused := hardware_refused([one.model.name])):
                raise DeviceError(refused)
            one.open()
        except BaseException as error:  # whatever a driver raises, the other devices' failures must still be told
            failures[one.model.name] = _cause(error, one.gate.device)

    thread = threading.Thread(target=work, name=f"open {one.model.name}", daemon=True)
    thread.start()
    return thread


def _cause(error: BaseException, device: Device | None) -> str:
    """Return why a device did not open: an error of ours, or of the system, explains itself; of another, its line."""
    if not isinstance(error, Exception):
        return f"has tried to end the program: {named(error)}"
    if isinstance(error, ItouchError | OSError):
        return spoken(error) or type(error).__name__
    return f"failed in {failed_in(device, 'open')}: {error_text(error)}"


def _first_reading(one: Lifecycle, tick: int, failures: dict[str, str]) -> None:
    on_loss, one.gate.on_loss = one.gate.on_loss, None  # while connecting, the caller tells of its loss
    try:
        one.gate.read(tick)
    except DeviceFaultError as error:
        failures[one.model.name] = error.cause
    finally:
        one.gate.on_loss = on_loss
