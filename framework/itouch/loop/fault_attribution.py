"""Whose fault it is: an error in a plugin's code stops a device, and a command that is not a number has a writer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from itouch.loop import builtins_guard
from itouch.loop.touchoff import DONE
from itouch.plugin import Modality, Record
from itouch.safety import DeviceFaultError, Trip
from itouch.schema import ItouchError
from itouch.schema.plugin_errors import error_text
from itouch.world import ModalityModel, Model


def modality_fault(
    model: Model, instance: Modality, method: str, tick: int, error: BaseException
) -> DeviceFaultError:  # fmt: skip
    """Return the fault of a modality that has raised, put down to the first device that it commands, or of the rig."""
    failed = next(m for m in model.modalities if m.instance is instance)
    devices = [command.partition(".")[0] for command in failed.commands] or list(model.devices)
    cause = f"has lost its modality '{failed.name}', which failed in {method}: {error_text(error)}"
    return DeviceFaultError(devices[0] if devices else "", tick, Trip.MODALITY_ERROR, cause)


def foreign_write(model: Model, listed: Sequence[ModalityModel], field: str, tick: int) -> DeviceFaultError:
    """Return the fault of modalities of which one has written a field that is not its own, bypassing its views."""
    devices = [command.partition(".")[0] for one in listed for command in one.commands] or list(model.devices)
    names = " or ".join(f"'{one.name}'" for one in listed)
    cause = (
        f"has lost its modality {names}, which wrote '{field}', a field that is not its own; its old value was put back"
    )
    return DeviceFaultError(devices[0] if devices else "", tick, Trip.MODALITY_ERROR, cause)


def broken_off(model: Model, tick: int, error: BaseException, replaced: tuple[str, ...] = ()) -> DeviceFaultError:
    """Return the fault of a tick that was cut short by something other than a device's fault, such as Ctrl-C.

    ``replaced``: names of what a plugin had replaced in Python itself, which was put back.
    """
    notes = "".join(f", {note}" for note in getattr(error, "__notes__", ()))
    told = builtins_guard.blamed(replaced)
    cause = (
        f"was stopped in the middle of a tick, which ended with {error_text(error)}{notes}{'; ' if told else ''}{told}"
    )
    return DeviceFaultError(next(iter(model.devices), ""), tick, Trip.MODALITY_ERROR, cause)


def changed_python(model: Model, tick: int, replaced: tuple[str, ...]) -> DeviceFaultError:
    """Return the fault of a plugin that has replaced functions of Python itself."""
    cause = f"was stopped because {builtins_guard.blamed(replaced)}"
    return DeviceFaultError(next(iter(model.devices), ""), tick, Trip.MODALITY_ERROR, cause)


def with_replaced(fault: DeviceFaultError, replaced: tuple[str, ...]) -> DeviceFaultError:
    """Return a fault that also tells what a plugin had replaced in Python itself, or the same fault if nothing."""
    told = builtins_guard.blamed(replaced)
    return DeviceFaultError(fault.device, fault.tick, fault.trip, f"{fault.cause}; {told}") if told else fault


def ended_by(fault: DeviceFaultError | None, raised: BaseException) -> BaseException:
    """Return the error that tells how a run ended: the fault for which all was made safe, if there was one.

    An ``ItouchError`` is returned as it is, for it explains itself.
    """
    if fault is None or issubclass(type(raised), ItouchError):
        return raised
    fault.__cause__ = raised
    return fault


def with_writer(model: Model, state: Record, fault: DeviceFaultError) -> DeviceFaultError:
    """Return a fault that names the modality that wrote a command that is not a number; other faults as they are."""
    device = model.devices.get(fault.device)
    if fault.trip is not Trip.NOT_A_NUMBER or device is None:
        return fault
    for channel in device.commands:
        command = f"{fault.device}.command.{channel.name}"
        writer = next((m.name for m in model.modalities if f"{fault.device}.{channel.name}" in m.commands), None)
        if writer is not None and not np.isfinite(state[command]).all():
            cause = f"{fault.cause} by modality '{writer}'"
            return DeviceFaultError(fault.device, fault.tick, fault.trip, cause)
    return fault


def before_touch_off(model: Model, state: Record, fault: DeviceFaultError) -> DeviceFaultError:
    """Return a fault that tells that the finger moved while its surface was in touch-off; other faults as they are.

    A person or a virtual rig's operator may do so: only the hand of a run on twins waits until it is done.
    """
    device = model.devices.get(fault.device)
    if fault.trip not in (Trip.SURFACE_SPEED, Trip.PLATE_FORCE) or device is None or not device.touch_off:
        return fault
    if int(state[f"{fault.device}.touch_off.stage"]) == DONE:
        return fault
    advice = "touch-off was not done, and until then the finger must rest (on a virtual rig: by a longer first hold)"
    return DeviceFaultError(fault.device, fault.tick, fault.trip, f"{fault.cause}; {advice}")
