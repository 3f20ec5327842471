"""The display on real hardware: the part of the device that opens the drivers and exchanges with them."""

from __future__ import annotations

import math
from typing import Any

from itouch.plugin import Attached, Device, DeviceError, Emulation, Opening, Record, Timing
from itouch_thermal.drivers.emulator import DisplayEmulator
from itouch_thermal.drivers.fits import FITS
from itouch_thermal.drivers.rig import Rig, rig_of
from itouch_thermal.drivers.stated_limits import SILENCE
from itouch_thermal.drivers.tec import LONGEST_WATCHDOG

#: Bytes of a command and its answer on the line of a rig of one's own, and the rest of the exchange's time [s].
_LINE_BYTES, _LINE_REST = 75, 5e-3
#: Bytes to set a current and read three values of a controller, and the rest of the exchange's time [s], estimated.
_MECOM_BYTES, _MECOM_REST = 111, 4e-3
#: Time of an averaging T7 beyond its samples [s], estimated.
_MEAN_REST = 2e-3
#: The skin's reading until a thermometer has seen the skin [K]; it is marked as not valid.
_UNSEEN = 306.15


class HardwareDisplay(Device):
    """Opens what ``<thermal:hardware>`` names: a current source, and sensors."""

    #: A MeCom transaction takes 7 ms at 57600 baud, and an exchange has three.  It is worth waiting for the next
    #: command to a controller: its readings are too slow for anything to be missed meanwhile.
    timing = Timing(blocking=True, exchange_time=0.02, command_wait=0.012)
    #: When a process dies, its serial ports and sockets are released: another process can set the current to zero.
    opening = Opening(second_opener=True)
    emulation = Emulation(Emulator=DisplayEmulator, calibrations=FITS)

    @classmethod
    def exchange_time_for(cls, params: Any) -> float:
        """Return how long one exchange takes [s]: 75 bytes on a line, a controller's exchange, or a T7's averaging."""
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
        """Name the port of what drives the module; an instrument that is only read may serve several displays."""
        return tuple(part.port for part in (params.mecom, params.line) if part is not None)

    @classmethod
    def watchdog_for(cls, params: Any) -> float | None:
        """Return the longest silence [s] until the current ends by itself; None if opening cannot make sure of one.

        A controller's watchdog is armed and read back; the reference firmware promises its own in its greeting.
        Nothing is known of another program before it is greeted.
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
        """Look for serial ports; only a scene can tell what is behind them."""
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
        """Open the current source and the sensors, with zero current.

        Raises
        ------
        DeviceError
            If no hardware is named, or a part is missing or refuses.
        """
        if self.params.command != "current":
            raise DeviceError('real displays are driven by a current: write command="current"')
        self._rig = rig = rig_of(self.params, self.trace, patience=self.timeout_factor, limits=self.limits)
        self._current, self._lost = 0.0, False
        try:
            if not math.isfinite(rig.exchange(0.0).flux):
                raise DeviceError("no flux sensor is there: write <thermal:flux-sensor> inside <thermal:labjack>")
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Set the current to zero and release the hardware."""
        rig, self._rig = self._rig, None
        if rig is None:
            return
        try:
            rig.close()
        except DeviceError:
            if not self._lost:  # a read has raised it already
                raise

    def write(self, command: Record) -> None:
        """Set the current, which the next exchange sends."""
        self._current = command["current"].item()

    def read(self, reading: Record) -> bool:
        """Exchange: send the current, read the sensors.

        Raises
        ------
        DeviceError
            If a part fails; its message says which.
        """
        if self._rig is None:
            raise DeviceError("the display is not open")
        try:
            found = self._rig.exchange(self._current, self.timestamps)
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
