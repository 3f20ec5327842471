"""Another scene under the same devices, between two ticks: what a study does from one trial to the next.

The devices go on where they are, with their twins, calibrations, trips, doses and what safety remembers; time goes on.
Objects, modalities, probes and the operator's hand begin as the new scene says; of a modality goes on what it declares
to be the person's, as the heat in the finger.
"""

from __future__ import annotations

from itouch.plugin import Record
from itouch.session.engine import Session
from itouch.session.errors import SessionError

#: What goes on beside the devices' own fields.
_GOES_ON = ("tick", "seed", "ready", "hold", "events.count", "events.table", "marks.count", "marks.table")

#: What goes on of a hand that waits for its skin: how warm that was at the session's start.
_BASELINE = ("baseline", "averaged")


def succeed(session: Session, before: Record) -> None:
    """Let a session that has not run yet go on from the State of one with the same devices, in which nothing touches.

    Parameters
    ----------
    session
        Of the new scene; all its devices are twins.
    before
        The State of the session that ends; it is only read.

    Raises
    ------
    SessionError
        If a device is no twin, or is not the same in both scenes, or something is touched.
    """
    hardware = [device.name for device in session.model.devices.values() if not device.twin]
    if hardware:
        raise SessionError(f"the scene changes under twins only; '{hardware[0]}' is real")
    there, here = before.dtype, session.state.dtype
    known, wanted = set(there.names or ()), here.names or ()
    touching = [name for name in known if name.endswith(".contact.object") and int(before[name]) >= 0]
    if touching:
        raise SessionError("the scene can't change while something is touched")
    devices = tuple(f"{name}." for name in session.model.devices)
    persons = {f"{one.name}.{name}" for one in session.model.modalities for name in one.instance.goes_on}
    persons |= {f"{probe.name}.hand.{name}" for probe in session.model.probes for name in _BASELINE}
    merged = session.state.copy()
    for name in wanted:
        if name in persons:
            if name in known and there[name] == here[name]:
                merged[name] = before[name]
            continue
        if name not in _GOES_ON and not name.startswith(devices):
            continue
        if name not in known or there[name] != here[name]:
            raise SessionError(f"the scenes' devices differ in '{name}': only what is touched and asked may change")
        merged[name] = before[name]
    session.adopt(merged.tobytes())
    session.settle(always=True)
