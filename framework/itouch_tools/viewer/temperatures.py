"""Which temperatures the picture shows (skin, plates, objects), and the range that its colours span."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from itouch.plugin import Role
from itouch.schema.units import CELSIUS_OFFSET
from itouch.world import Model, declared
from itouch.world.rig import DeviceModel
from itouch_tools.viewer import colours
from itouch_tools.viewer.colours import Colour
from itouch_tools.viewer.scales import readable

#: The range ends at multiples of ``STEP`` [degC], and is at least ``LEAST`` wide [K].
STEP, LEAST = 5.0, 10.0


class Range:
    """The ends [K] of the temperature scale: it spans the scene's temperatures and all that were shown; it only grows.

    So colours stay constant while a plate cools, and 22 degC can be told from 30 degC.
    """

    def __init__(self, model: Model) -> None:
        ambient = model.scene.world.temperature
        known = [ambient, *(e.temperature for e in model.scene.objects if e.temperature is not None)]
        middle = (min(known) + max(known)) / 2
        self._low, self._high = min(*known, middle - LEAST / 2), max(*known, middle + LEAST / 2)

    def hold(self, state: Mapping[str, Any], model: Model) -> None:
        """Widen the range to the present temperatures of skin and plates."""
        for kelvin in present(state, model):
            if colours.COLDEST < kelvin < colours.HOTTEST:
                self._low, self._high = min(self._low, kelvin), max(self._high, kelvin)

    @property
    def ends(self) -> tuple[float, float]:
        """The lower and the upper end [K], round numbers of degC."""
        return (CELSIUS_OFFSET + STEP * math.floor((self._low - CELSIUS_OFFSET + 0.3) / STEP),
                CELSIUS_OFFSET + STEP * math.ceil((self._high - CELSIUS_OFFSET - 0.3) / STEP))  # fmt: skip

    def colour(self, kelvin: float) -> Colour:
        """Return the colour of a temperature [K]."""
        return colours.of_temperature(kelvin, *self.ends)


def degrees(low: float, high: float) -> list[float]:
    """Return the round numbers [degC] that label a scale from ``low`` to ``high`` [K]: six at most."""
    step = next(step for step in (5.0, 10.0, 20.0, 50.0, 1e3) if (high - low) / step <= 5.0)
    first, last = math.ceil((low - CELSIUS_OFFSET) / step - 1e-6), math.floor((high - CELSIUS_OFFSET) / step + 1e-6)
    return [step * index for index in range(first, last + 1)]


def present(state: Mapping[str, Any], model: Model) -> Iterator[float]:
    """Yield the temperatures [K] of skin and plates, as far as they are known."""
    skin = skin_temperature(state, model)
    if skin is not None:
        yield skin
    for device in model.devices.values():
        plate = plate_temperature(state, device)
        if plate is not None:
            yield plate


def plate_temperature(state: Mapping[str, Any], device: DeviceModel) -> float | None:
    """Return the temperature [K] that a device reads on the surface under the skin.

    None if it has no such channel, or has not been read yet: a reading is 0 K before the first one.
    """
    name = device.field(Role.SKIN_CONTACT_TEMPERATURE)
    kelvin = float(np.ravel(state[name])[0]) if name else math.nan
    return kelvin if readable(kelvin) else None


def skin_temperature(state: Mapping[str, Any], model: Model) -> float | None:
    """Return the temperature [K] of the skin: as a modality renders it, else as a device reads it, else None."""
    key = _skin(state, model)
    kelvin = float(np.ravel(state[key])[0]) if key else math.nan
    return kelvin if math.isfinite(kelvin) and kelvin > 200.0 else None


def skin_named(state: Mapping[str, Any], model: Model) -> str:
    """Return the name of the skin's temperature, the same as that of its curve."""
    key = _skin(state, model)
    return (declared(model)[key].show.partition("|")[2].strip() if key else "") or "skin"


def _skin(state: Mapping[str, Any], model: Model) -> str:
    """Return the name of the field of the skin's temperature; empty: there is none."""
    owners = [modality.name for modality in model.modalities]
    named = [name for name, field in declared(model).items() if field.role is Role.SKIN_TEMPERATURE and name in state]
    return min(named, key=lambda name: name.partition(".")[0] not in owners, default="")
