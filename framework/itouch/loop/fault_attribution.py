"""Whose fault it is: an error in a plugin's code stops a device, and a command that is not a number has a writer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from itouch.plugin import Modality, Record
from itouch.safety import DeviceFaultError, Trip
from itouch.world import ModalityModel, Model
from itouch.world.plugin_errors import said


def modality_fault(
    model: Model, instance: Modality, method: str, tick: int, error: BaseException
) -> DeviceFaultError:  # fmt: skip
    """Return the fault of a modality that has raised: it stands at the device that it commands, or at the first."""
    failed = next(m for m in model.modalities if m.instance is instance)
    devices = [command.partition(".")[0] for command in failed.commands] or list(model.devices)
    cause = f"has lost its modality '{failed.name}', which failed in {method}: {said(error)}"
    return DeviceFaultError(devices[0] if devices else "", tick, Trip.MODALITY_ERROR, cause)


def foreign_write(model: Model, listed: Sequence[ModalityModel], field: str, tick: int) -> DeviceFaultError:
    """Return the fault of modalities of which one has written a field that is not its own, past the views it got."""
    devices = [command.partition(".")[0] for one in listed for command in one.commands] or list(model.devices)
    names = " or ".join(f"'{one.name}'" for one in listed)
    cause = f"has lost its modality {names}, which wrote '{field}': that is not its own, and was put back"
    return DeviceFaultError(devices[0] if devices else "", tick, Trip.MODALITY_ERROR, cause)


def broken_off(model: Model, tick: int, error: BaseException) -> DeviceFaultError:
    """Return the fault of a tick that something has ended which is no fault of a device, such as Ctrl-C."""
    cause = f"was stopped in the middle of a tick, which ended with {said(error)}"
    return DeviceFaultError(next(iter(model.devices), ""), tick, Trip.MODALITY_ERROR, cause)


def with_writer(model: Model, state: Record, fault: DeviceFaultError) -> DeviceFaultError:
    """Return a fault that names who has written a command that is not a number; other faults as they are."""
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
