"""The drivers of a display as its elements name them: one drives the module, one may read the sensors."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from itouch.plugin import DeviceError, Timestamps, Trace
from itouch_thermal.drivers.labjack import LabJackDriver
from itouch_thermal.drivers.lineport import LineDriver, LineReading
from itouch_thermal.drivers.tec import TecDriver, TecReading


@dataclass(frozen=True, slots=True)
class Measured:
    """Readings of a display: temperatures [K], flux [W/m2], current [A]; NaN without a sensor."""

    plate: float
    sink: float
    flux: float
    skin: float
    current: float


class Rig:
    """Open drivers: a controller or a rig of one's own, and a LabJack if one is named."""

    def __init__(
        self, params: Any, trace: Trace | None = None, *, patience: float = 1.0, limits: Mapping[str, Any] | None = None
    ) -> None:
        self._labjack: LabJackDriver | None = None
        self._source: TecDriver | LineDriver
        if params.mecom is not None:
            self._source = TecDriver(params.mecom, trace, patience=patience, ceiling=params.max_current)
        else:
            self._source = LineDriver(params.line, trace, patience=patience, limits=limits)
        if params.labjack is not None:
            try:
                self._labjack = LabJackDriver(params.labjack, trace, patience=patience)
            except BaseException:
                with contextlib.suppress(DeviceError):
                    self._source.close()
                raise

    def exchange(self, current: float, stamps: Timestamps | None = None) -> Measured:
        """Set the current [A], and measure; the times of both are written to ``stamps``.

        Raises
        ------
        DeviceError
            If a part fails; its message says which.
        """
        if self._labjack is not None:
            self._labjack.begin()
        read: TecReading | LineReading = self._source.exchange(current, stamps)
        flux, skin = getattr(read, "flux", math.nan), getattr(read, "skin", math.nan)
        if self._labjack is not None:
            sensors = self._labjack.exchange(read.plate)
            if stamps is not None:
                self._labjack.stamp(stamps, skin=math.isfinite(sensors.skin) or not math.isfinite(skin))
            flux = sensors.flux if math.isfinite(sensors.flux) else flux
            skin = sensors.skin if math.isfinite(sensors.skin) else skin
        return Measured(read.plate, read.sink, flux, skin, read.current)

    def close(self) -> None:
        """Set the current to zero, and release everything."""
        try:
            self._source.close()
        finally:
            if self._labjack is not None:
                self._labjack.close()


def rig_of(
    params: Any, trace: Trace | None = None, *, patience: float = 1.0, limits: Mapping[str, Any] | None = None
) -> Rig:
    """Open the hardware named in the parameters.

    Raises
    ------
    DeviceError
        If they name nothing that drives the module, or two such things, or it cannot be opened.
    """
    if (params.mecom is None) == (params.line is None):
        advice = "write one of <thermal:mecom> and <thermal:line> inside <thermal:hardware>"
        raise DeviceError(f"nothing, or two things, drive the module: {advice}")
    return Rig(params, trace, patience=patience, limits=limits)
