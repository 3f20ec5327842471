"""A Meerstetter TEC controller as the display's current source, driven by live parameters, which spare its flash.

The controller protects the plate by itself when the host falls silent: at the start, its watchdog, current limits and
error thresholds are armed and read back.  Values that differ are written once, and stay in its flash.
"""

from __future__ import annotations

import contextlib
import struct
from time import monotonic
from typing import NamedTuple

from itouch.plugin import DeviceError, Timestamps, Trace
from itouch_thermal.drivers.driver_params import BELIEVED, Mecom
from itouch_thermal.drivers.flowing_current import FlowingCurrent
from itouch_thermal.drivers.mecom import BUSY, NO_INSTANCE, UNKNOWN, MecomClient, MecomRefusal

STATUS, ERROR_NUMBER = 104, 105
OBJECT_TEMPERATURE, SINK_TEMPERATURE, ACTUAL_CURRENT = 1000, 1001, 1020
INPUT, OUTPUT = 2000, 2010
INPUT_LIVE, OUTPUT_LIVE = 1, 2
CURRENT_LIMIT, VOLTAGE_LIMIT, CURRENT_ERROR, WATCHDOG = 2030, 2031, 2032, 2060
LOW_ERROR, HIGH_ERROR, OBJECT_RATE, OBSERVE = 4010, 4011, 6301, 6302
LIVE_ENABLE, LIVE_CURRENT, LIVE_VOLTAGE = 50000, 50001, 50002
STATES = {0: "init", 1: "ready", 2: "run", 3: "error", 4: "bootloader", 5: "will reset soon"}
KELVIN = 273.15
#: Limits that the controller must enforce by itself: plate [degC], and its watchdog [s], which is set to this.
PLATE, LONGEST_WATCHDOG = (8.0, 45.0), 0.5
#: Default for the greatest current [A] that will be commanded, and the error threshold as a multiple of it.
CEILING, THRESHOLD = 16.0, 1.25
#: Below this live voltage [V] the controller has lost its settings.
NO_VOLTAGE = 0.01


class TecReading(NamedTuple):
    """The controller's measurements: temperatures [K] and current [A]."""

    plate: float
    sink: float
    current: float


class TecDriver:
    """An open controller whose current follows commands.

    Parameters
    ----------
    params
        The port and its settings.
    trace, patience
        As for every driver.
    ceiling
        Greatest current [A] that will be commanded: the controller is limited to it.
    """

    def __init__(
        self, params: Mecom, trace: Trace | None = None, *, patience: float = 1.0, ceiling: float = CEILING
    ) -> None:
        self._client = MecomClient(params.port, params.baud, params.address, patience=patience, trace=trace)
        self._instance, self._count, self._bulk = params.instance, 0, True
        #: Temperature of the sink [K], which is not read in every exchange, and when it was measured [s].
        self._sink, self._sink_since = 0.0, 0.0
        self._flowing = FlowingCurrent("the TEC controller")
        self._watched, self._enabled = params.watchdog, False
        #: Instance of the status: a controller with two channels may have one status for both.
        self._status = params.instance
        #: Protective parameters that this controller does not have.
        self.missing: list[int] = []
        try:
            if params.raises:
                self._client.hasten(params.session_baud)
            self._start(ceiling)
        except BaseException:
            if self._enabled:
                with contextlib.suppress(DeviceError):  # the first error is the one to report
                    self._client.write_int(LIVE_ENABLE, 0, self._instance)
            self._client.close()
            raise

    def _start(self, ceiling: float) -> None:
        """Check the controller's state, arm its protection of the plate, and switch its output to live parameters."""
        self.identity = self._client.identity()
        self._status = self._place(STATUS)
        self._check(self._client.read_int(STATUS, self._status))
        client, instance = self._client, self._instance
        client.write_int(LIVE_ENABLE, 0, instance)
        client.write_float(LIVE_CURRENT, 0.0, instance)
        for parameter, wanted in ((INPUT, INPUT_LIVE), (OUTPUT, OUTPUT_LIVE)):
            if client.read_int(parameter, instance) != wanted:
                client.write_int(parameter, wanted, instance)
        self._arm_float(CURRENT_LIMIT, 0.0, ceiling, ceiling)
        self._arm_float(CURRENT_ERROR, 0.0, THRESHOLD * ceiling, THRESHOLD * ceiling)
        self._arm_float(LOW_ERROR, PLATE[0], PLATE[1], PLATE[0])
        self._arm_float(HIGH_ERROR, PLATE[0], PLATE[1], PLATE[1])
        self._arm_float(WATCHDOG, 0.05, LONGEST_WATCHDOG, LONGEST_WATCHDOG, self._place(WATCHDOG))
        if WATCHDOG in self.missing and self._watched:
            raise DeviceError(
                f"the TEC controller knows no parameter {WATCHDOG}: nothing in it would end the current if this "
                'program died; watchdog="no" in <thermal:mecom> lets it run, with guardian and hold-to-run only'
            )
        self._arm_int(OBSERVE, 2)
        self._arm_int(OBJECT_RATE, 1)
        self._open_voltage()
        self._enabled = True  # even if its answer is lost
        client.write_int(LIVE_ENABLE, 1, instance)
        self._sink = _temperature(client.read_raw(SINK_TEMPERATURE, instance), "sink")
        self._sink_since = self._begun(20)
        client.hurry = True  # from now on a loop is waiting

    def _place(self, parameter: int) -> int:
        """Return the instance of a parameter, which may exist only once for all channels, as instance 1."""
        if self._instance > 1:
            try:
                self._client.read_raw(parameter, self._instance)
            except MecomRefusal as refusal:
                if refusal.code == NO_INSTANCE:
                    return 1
        return self._instance

    def _open_voltage(self) -> None:
        """Set the live voltage to its limit: after a start it is 0 V, and no current would flow."""
        try:
            voltage = self._client.read_float(VOLTAGE_LIMIT, self._instance)
            if not voltage > NO_VOLTAGE:
                raise DeviceError(
                    f"the TEC controller's voltage limit (parameter {VOLTAGE_LIMIT}) is {voltage:g} V, with which "
                    "no current flows: set it with the maker's program"
                )
            self._client.write_float(LIVE_VOLTAGE, voltage, self._instance)
        except MecomRefusal as refusal:
            self._note(VOLTAGE_LIMIT, refusal)

    def _note(self, parameter: int, refusal: MecomRefusal) -> None:
        """Record a parameter that does not exist; raise any other refusal."""
        if refusal.code not in UNKNOWN:
            raise refusal
        self.missing.append(parameter)

    def _arm_float(self, parameter: int, low: float, high: float, wanted: float, instance: int = 0) -> None:
        """Bring a parameter into a range, and read it back; ``instance`` 0: the channel's."""
        instance = instance or self._instance
        try:
            found = self._client.read_float(parameter, instance)
            if low - _rounded(low) <= found <= high + _rounded(high):
                return
            self._client.write_float(parameter, wanted, instance)
            found = self._client.read_float(parameter, instance)
        except MecomRefusal as refusal:
            self._note(parameter, refusal)
            return
        if not low - _rounded(low) <= found <= high + _rounded(high):
            self._refuse_rig(parameter, found, wanted)

    def _arm_int(self, parameter: int, wanted: int) -> None:
        try:
            if self._client.read_int(parameter, self._instance) == wanted:
                return
            self._client.write_int(parameter, wanted, self._instance)
            found = self._client.read_int(parameter, self._instance)
        except MecomRefusal as refusal:
            self._note(parameter, refusal)
            return
        if found != wanted:
            self._refuse_rig(parameter, found, wanted)

    @staticmethod
    def _refuse_rig(parameter: int, found: float, wanted: float) -> None:
        what = "it would not protect the plate by itself"
        if parameter == WATCHDOG:
            what = "its own watchdog " + ("would come too late" if found > wanted else "is off")
        raise DeviceError(
            f"the TEC controller keeps parameter {parameter} at {found:g} where {wanted:g} was written: {what}; set it "
            "with the maker's program"
        )

    def _check(self, state: int) -> None:
        if state == 3:
            code = self._client.read_int(ERROR_NUMBER)
            raise DeviceError(
                f"the TEC controller is in error {code}: see its manual, then reset it: switch it off and on (one of a "
                "virtual rig: start that again)"
            )
        if state not in (1, 2):
            raise DeviceError(f"the TEC controller is not ready: it says '{STATES.get(state, state)}'")

    def exchange(self, current: float, stamps: Timestamps | None = None) -> TecReading:
        """Set the current [A], and read the measurements.

        Raises
        ------
        DeviceError
            If the controller does not answer, refuses, is in error, has restarted, or gives another current.
        """
        self._client.write_float(LIVE_CURRENT, current, self._instance)
        if stamps is not None:
            stamps.command_sent(ago=16 * self._byte())  # it had received the command when it began to acknowledge
        self._flowing.ask(current)
        slow = (SINK_TEMPERATURE, STATUS, LIVE_ENABLE, LIVE_VOLTAGE)[self._count % 4]
        self._count += 1
        if slow == LIVE_VOLTAGE and VOLTAGE_LIMIT in self.missing:
            slow = SINK_TEMPERATURE
        if slow == STATUS and self._status != self._instance:
            self._check(self._client.read_int(STATUS, self._status))
            slow = SINK_TEMPERATURE
        (plate, since), (actual, _), (other, then) = self._values((OBJECT_TEMPERATURE, ACTUAL_CURRENT, slow))
        if slow == SINK_TEMPERATURE:
            self._sink_since = then
        if stamps is not None:
            now = monotonic()
            stamps.measured("plate_temperature", ago=now - since)
            stamps.measured("sink_temperature", ago=now - self._sink_since)
        flowing = _float(actual)
        self._slowly(slow, other)
        self._flowing.follows(flowing)
        return TecReading(_temperature(plate, "plate"), self._sink, flowing)

    def _byte(self) -> float:
        """Return the duration of a byte on the line [s]."""
        return 10.0 / self._client.baud

    def _values(self, parameters: tuple[int, ...]) -> list[tuple[bytes, float]]:
        """Return parameters, and when each was measured at the earliest [s].

        They are read in one request, or one by one if the controller does not know that request.
        """
        if self._bulk:
            try:
                found = self._client.read_several(parameters, self._instance)
                since = self._begun(12 + 8 * len(parameters))
                return [(value, since) for value in found]
            except MecomRefusal as refusal:
                if refusal.code == BUSY:
                    raise
                self._bulk = False  # a refused parameter shows when read by itself
        return [(self._client.read_raw(one, self._instance), self._begun(20)) for one in parameters]

    def _begun(self, size: int) -> float:
        """Return when the controller began to send the newest answer at the earliest [s], by its number of bytes."""
        return monotonic() - size * self._byte() - max(0.0, self._client.doubt)

    def _slowly(self, parameter: int, data: bytes) -> None:
        """Handle a value that is not read in every exchange."""
        if parameter == SINK_TEMPERATURE:
            self._sink = _temperature(data, "sink")
        elif parameter == STATUS:
            self._check(_int(data))
        elif parameter == LIVE_ENABLE:
            if _int(data) != 1:
                self._restarted()
        elif not _float(data) > NO_VOLTAGE:  # a lower value may be all that it can give
            self._restarted()

    @staticmethod
    def _restarted() -> None:
        raise DeviceError(
            "the TEC controller has restarted: its live output is off; check its supply, then connect it again"
        )

    def close(self) -> None:
        """Set the current to zero and switch the output off, then release the line."""
        try:
            try:
                self._client.write_float(LIVE_CURRENT, 0.0, self._instance)
            finally:  # even if it refuses the first
                self._client.write_int(LIVE_ENABLE, 0, self._instance)
        finally:
            self._client.close()


def _temperature(data: bytes, part: str) -> float:
    """Convert a temperature to [K].

    Raises
    ------
    DeviceError
        If it is implausible for a plate or a sink.
    """
    value = _float(data)
    if not BELIEVED[0] <= value <= BELIEVED[1]:
        raise DeviceError(
            f"the TEC controller says that the {part} is at {value:g} degC: its sensor is open, short or not set up; "
            "check its wires, and the sensor's type in the maker's program"
        )
    return value + KELVIN


def _rounded(value: float) -> float:
    """Return the tolerance for a value that was written in single precision."""
    return 1e-6 * abs(value)


def _float(data: bytes) -> float:
    value: float = struct.unpack(">f", data)[0]
    return value


def _int(data: bytes) -> int:
    value: int = struct.unpack(">i", data)[0]
    return value
