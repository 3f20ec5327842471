"""Connecting: all devices at once, each in a thread of its own, and all failures are told together.

Nothing is opened if another process, or another session, uses a wire of a device that is not optional.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable

from itouch.monitors import DeviceFaultError
from itouch.platforms import hardware_refused
from itouch.plugin import DeviceError
from itouch.plugin.wire_claims import WireHeldError
from itouch.safety.lifecycle import Status
from itouch.safety.supervisor import Supervisor
from itouch.schema.diagnostics import named, spoken

#: How long [s] a device may take to open.
PATIENCE = 15.0


def connect(supervisors: Iterable[Supervisor], tick: int, *, patience: float = PATIENCE) -> dict[str, str]:
    """Open every device that is CLOSED, and read each once.

    Parameters
    ----------
    supervisors
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
    wanted = list(supervisors)
    failures = claim_wires(wanted)
    if any(supervisor.model.name in failures and not supervisor.model.optional for supervisor in wanted):
        return failures
    threads = {}
    for supervisor in wanted:
        if supervisor.status is Status.CLOSED and supervisor.model.name not in failures:
            threads[supervisor.model.name] = _start(supervisor, failures)
    for name, thread in threads.items():
        thread.join(patience)
        if thread.is_alive():
            failures[name] = f"did not open within {patience:g} s"
    for supervisor in wanted:
        if supervisor.model.name not in failures:
            _first_reading(supervisor, tick, failures)
    return {s.model.name: failures[s.model.name] for s in wanted if s.model.name in failures}


def claim_wires(supervisors: Iterable[Supervisor]) -> dict[str, str]:
    """Claim the wires of every device that is CLOSED.

    Returns
    -------
    dict
        Device -> who has its wire.  If one of these devices is not optional, no wire stays claimed for any device.
    """
    wanted = [supervisor for supervisor in supervisors if supervisor.status is Status.CLOSED]
    failures: dict[str, str] = {}
    for supervisor in wanted:
        try:
            supervisor.claim_wires()
        except WireHeldError as error:
            failures[supervisor.model.name] = str(error)
    if any(supervisor.model.name in failures and not supervisor.model.optional for supervisor in wanted):
        for supervisor in wanted:
            supervisor.free_wires()
    return failures


def _start(supervisor: Supervisor, failures: dict[str, str]) -> threading.Thread:
    """Open a device in a thread, and return it; what it raises becomes an entry of ``failures``."""

    def work() -> None:
        try:
            if supervisor.device is not None and (refused := hardware_refused([supervisor.model.name])):
                raise DeviceError(refused)
            supervisor.open()
        except BaseException as error:  # whatever a driver raises, the other devices' failures must still be told
            ends = f"has tried to end the program: {named(error)}"
            said = spoken(error) or type(error).__name__
            failures[supervisor.model.name] = said if isinstance(error, Exception) else ends

    thread = threading.Thread(target=work, name=f"open {supervisor.model.name}", daemon=True)
    thread.start()
    return thread


def _first_reading(supervisor: Supervisor, tick: int, failures: dict[str, str]) -> None:
    on_loss, supervisor.on_loss = supervisor.on_loss, None  # while connecting, the caller tells of its loss
    try:
        supervisor.read(tick)
    except DeviceFaultError as error:
        failures[supervisor.model.name] = error.cause
    finally:
        supervisor.on_loss = on_loss
