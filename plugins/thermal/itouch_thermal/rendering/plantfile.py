"""A plant from a file: the ``<thermal:hardware>`` of the one thermal display in a scene or rig."""

from __future__ import annotations

from dataclasses import replace

from itouch.plugin.commands import framework
from itouch_thermal.display.params import DisplayParams


def read_plant(path: str, resistance: float) -> DisplayParams:
    """Return the plant that a file describes, for contacts of an expected resistance [K m2/W].

    A contact resistance in the file is the plant's true one; without one, the plant has the expected one.  The finger
    and the press are those of the contact.

    Raises
    ------
    itouch.SceneError
        If the file is not a scene or rig.
    ValueError
        If it has no thermal display, or several.
    """
    found = {
        device.name: part.params
        for device in framework().load(path).devices
        for part in device.parts
        if isinstance(part.params, DisplayParams)
    }
    if len(found) != 1:
        names = ", ".join(found) or "none"
        raise ValueError(f"{path}: wants one device with <thermal:hardware>; it has {names}")
    plant: DisplayParams = next(iter(found.values()))
    plain = DisplayParams()
    off = plant.mismatch
    if plant.contact_resistance != plain.contact_resistance:
        part = plant.contact_resistance * (1.0 + off.contact_resistance) / resistance - 1.0
        off = replace(off, contact_resistance=part)
    return replace(plant, laws=(), full_force=0.0, contact_resistance=plain.contact_resistance, mismatch=off)
