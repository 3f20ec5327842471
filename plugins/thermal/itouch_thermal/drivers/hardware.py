"""The display on real hardware: the part of the device that opens drivers and exchanges with them."""

from __future__ import annotations

import math
from typing import Any

from itouch.plugin import Attached, Device, DeviceError, Emulation, Opening, Record, Timing
from itouch_thermal.drivers.emulator import DisplayEmulator
from itouch_thermal.drivers.fits import FITS
from itouch_thermal.drivers.promises import SILENCE
from itouch_thermal.drivers.rig import Rig, rig_of
from itouch_thermal.drivers.tec import LONGEST_WATCHDOG

#: Bytes of an order and its answer on the line of a rig of one's own, and what it takes besides [s].
_LINE_BYTES, _LINE_REST = 75, 5e-3
#: Bytes of setting a current and reading three values of a controller, and what it takes besides [s], estimated.
_MECOM_BYTES, _MECOM_REST = 111, 4e-3
#: What an averaging T7 takes besides its samples [s], estimated.
_MEAN_REST = 2e-3
#: What stands in a reading of the skin as long as no thermometer has seen it [K]; it is marked as not valid.
_UNSEEN = 306.15


class HardwareDisplay(Device):
    """Opens what ``<thermal:hardware>`` names: a current source, and sensors."""

    #: A MeCom transaction takes 7 ms at 57600 baud, and an exchange has three.  A controller's next command is worth
    #: waiting for: its readings are too slow to be missed meanwhile.
    timing = Timing(blocking=True, exchange_time=0.02, waits=0.012)
    #: Serial ports and sockets of a process that died are free: another one can set the current to zero.
    opening = Opening(second_opener=True)
    emulation = Emulation(Emulator=DisplayEmulator, fits=FITS)

    @classmethod
    def takes(cls, params: Any) -> float:
        """Return the seconds of one exchange: 75 bytes on a line, what a controller takes, or a T7 to average."""
        seconds: float = cls.exchange_time
        if params.line is not None:
            seconds = round(_LINE_BYTES * 10.0 / params.line.baud + _LINE_REST, 3)
        elif params.mecom is not None and params.mecom.raises:
            seconds = round(_MECOM_BYTES * 10.0 / params.mecom.session_baud + _MECOM_REST, 3)
        if params.labjack is not None and params.labjack.samples > 1:
            seconds = max(seconds, round(params.labjack.averaging + _MEAN_REST, 3))
        return seconds

    @classmethod
    def wires(cls, params: Any) -> tuple[str, ...]:
        """Return the port of what drives the module; an instrument that is only read may serve several displays."""
        return tuple(part.port for part in (params.mecom, params.line) if part is not None)

    @classmethod
    def lets_go(cls, params: Any) -> float | None:
        """Return after what silence the current ends by itself [s], at most: where opening it makes sure of that.

        A controller's watchdog is armed and read back, our own program promises its in its greeting.  Of another
        program nothing is known before it is asked.
        """
        if params.mecom is not None:
            return LONGEST_WATCHDOG if params.mecom.watchdog else None
        return SILENCE if params.line is not None and params.line.firmware == "reference" else None

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        self._rig: Rig | None = None
        self._current, self._skin, self._lost = 0.0, _UNSEEN, False

    @classmethod
    def discover(cls) -> tuple[Attached, ...]:
        """Look for serial ports; what is behind them is only known when a scene names one."""
        try:
            import serialx
        except ImportError:
            return (Attached("serial ports", False, "cannot be looked for: pip install 'itouch-py[thermal-hardware]'"),)
        advice = "name it in <thermal:mecom> or <thermal:line> if the display's controller is behind it"
        return tuple(
            Attached(port.device, True, f"a serial port ({port.product or 'it tells no name'}); {advice}")
            for port in serialx.list_serial_ports()
            if port.vid is not None
        )

    def open(self) -> None:
        """Open the current source and the sensors, with no current.

        Raises
        ------
        DeviceError
            If nothing is named, or something is missing or refuses.
        """
        if self.params.command != "current":
            raise DeviceError('real displays are driven by a current: write command="current"')
        self._rig = rig = rig_of(self.params, self.trace, patience=self.patience, limits=self.limits)
        self._current, self._lost = 0.0, False
        try:
            if not math.isfinite(rig.exchange(0.0).flux):
                raise DeviceError("no flux sensor is there: write <thermal:flux-sensor> inside <thermal:labjack>")
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Set the current to zero and let go."""
        rig, self._rig = self._rig, None
        if rig is None:
            return
        try:
            rig.close()
        except DeviceError:
            if not self._lost:  # it was told already
                raise

    def write(self, command: Record) -> None:
        """Set the current, which the next exchange sends."""
        self._current = command["current"].item()

    def read(self, reading: Record) -> bool:
        """Exchange: send the current, take what the sensors say.

        Raises
        ------
        DeviceError
            If a part fails; its message says which.
        """
        if self._rig is None:
            raise DeviceError("the display is not open")
        try:
            found = self._rig.exchange(self._current, self.stamps)
        except DeviceError:
            self._lost = True
            raise
        seen = math.isfinite(found.skin)
        if seen:
            self._skin = found.skin
        reading["skin_temperature"] = self._skin
        reading["skin_valid"] = float(seen)
        reading["plate_temperature"], reading["sink_temperature"] = found.plate, found.sink
        reading["heat_flux"] = found.flux
        return True
