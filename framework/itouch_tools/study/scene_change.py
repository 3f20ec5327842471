"""Another scene under the same devices, between two ticks: what a study does from one trial to the next.

The devices go on where they are, with their twins, calibrations, trips, doses and all that safety remembers; time goes
on, too.  Hardware stays open and is handed from one session to the other: it is at rest meanwhile, and enabled anew.
Objects, modalities, probes and the operator's hand begin as the new scene says; a modality's fields go on if it
declares them to be the person's, as the heat in the finger.
"""

from __future__ import annotations

from itouch.session.engine import Session
from itouch.session.errors import SessionError
from itouch.world import DeviceModel, Model

#: Fields that go on besides the devices' own.
_GOES_ON = ("tick", "seed", "ready", "hold", "events.count", "events.table", "marks.count", "marks.table")

#: Fields that go on of a hand that waits for its skin: the skin's temperature at the session's start.
_BASELINE = ("baseline", "averaged")


def touching(session: Session) -> bool:
    """Tell whether anything is touched."""
    state = session.state
    return any(int(state[name]) >= 0 for name in state if name.endswith(".contact.object"))


def succeed(session: Session, before: Session) -> None:
    """Let a session that has not run yet go on from one with the same devices, in which nothing is touched.

    Parameters
    ----------
    session
        That of the new scene.
    before
        The session that ends; in its State only the status of hardware changes, which it no longer has.

    Raises
    ------
    SessionError
        If a device is not the same in both scenes, something is touched, or hardware is not at rest; both sessions are
        then as they were.
    """
    there, here = before.state.dtype, session.state.dtype
    known, wanted = set(there.names or ()), here.names or ()
    if touching(before):
        raise SessionError("the scene can't change while something is touched")
    _same_hardware(session, before)
    devices = tuple(f"{name}." for name in session.model.devices)
    persons = {f"{one.name}.{name}" for one in session.model.modalities for name in one.instance.goes_on}
    persons |= {f"{probe.name}.hand.{name}" for probe in session.model.probes for name in _BASELINE}
    merged = session.state.copy()
    for name in wanted:
        if name in persons:
            if name in known and there[name] == here[name]:
                merged[name] = before.state[name]
            continue
        if name not in _GOES_ON and not name.startswith(devices):
            continue
        if name not in known or there[name] != here[name]:
            raise SessionError(f"the scenes' devices differ in '{name}': only what is touched and asked may change")
        merged[name] = before.state[name]
    session.adopt(merged.tobytes())
    session.guarded = before.guarded
    session.settle(always=True)
    others = {runner.model.name: runner.lifecycle for runner in before.runners}
    for runner in session.runners:  # last, because from here on the new session has the hardware
        if not runner.model.twin:
            runner.lifecycle.take_over(others[runner.model.name])


def _same_hardware(session: Session, before: Session) -> None:
    """Check that each real device is the same in both sessions, and at rest.

    Raises
    ------
    SessionError
        If one is not.
    """
    found = differing(session.model, before.model)
    if found:
        raise SessionError(found)
    acting = [runner.model.name for runner in before.runners if runner.latch.enabled and not runner.model.twin]
    if acting:
        raise SessionError(f"'{acting[0]}' is real and not at rest: the scene can't change under it")


def differing(model: Model, before: Model) -> str:
    """Return the sentence on a real device, or on safety, that is not the same in two scenes; empty: all are."""
    for name in {**before.devices, **model.devices}:
        here, there = model.devices.get(name), before.devices.get(name)
        if all(one is None or one.twin for one in (here, there)):
            continue
        if here is None or there is None or _driven(here) != _driven(there):
            return f"'{name}' is real: a study may not change it, its place, settings or limits, nor leave it away"
    real = any(not device.twin for device in model.devices.values())
    if real and model.scene.safety != before.scene.safety:
        return "devices are real: a study may not change <safety>"
    return ""


def _driven(model: DeviceModel) -> tuple[object, ...]:
    """Return all that the driver of a device depends on."""
    return (
        model.twin, model.cls, model.params, model.reads, model.commands, model.limits, model.servo_period, model.mount,
        model.mount_error, model.carrier, model.touch_off, model.optional, [type(one) for one in model.monitors],
    )  # fmt: skip
