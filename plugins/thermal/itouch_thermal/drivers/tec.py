"""A Meerstetter TEC controller as the display's current source; live parameters, so that its flash does not wear."""

from __future__ import annotations

from typing import NamedTuple

from itouch.plugin import DeviceError, Trace
from itouch_thermal.drivers.mecom import MecomClient
from itouch_thermal.drivers.params import Mecom

STATUS, ERROR_NUMBER = 104, 105
OBJECT_TEMPERATURE, SINK_TEMPERATURE, ACTUAL_CURRENT = 1000, 1001, 1020
INPUT, OUTPUT = 2000, 2010
INPUT_LIVE, OUTPUT_LIVE = 1, 2
LIVE_ENABLE, LIVE_CURRENT = 50000, 50001
STATES = {0: "init", 1: "ready", 2: "run", 3: "error", 4: "bootloader", 5: "will reset soon"}
KELVIN = 273.15
#: Every so many exchanges one of the slow things is asked, in turn: the current that flows, the sink, the status.
_SLOW = 3


class TecReading(NamedTuple):
    """What the controller measures: temperatures [K] and current [A]."""

    plate: float
    sink: float
    current: float


class TecDriver:
    """An open controller whose current follows commands."""

    def __init__(self, params: Mecom, trace: Trace | None = None, *, patience: float = 1.0) -> None:
        self._client = MecomClient(params.port, params.baud, params.address, patience=patience, trace=trace)
        self._instance, self._count, self._sink, self._actual = params.instance, 0, 0.0, 0.0
        try:
            self._start()
        except BaseException:
            self._client.close()
            raise

    def _start(self) -> None:
        """Check that it is well, and hand its output over to live parameters; flash is written only if it must be."""
        self.identity = self._client.identity()
        self._check()
        self._client.write_float(LIVE_CURRENT, 0.0, self._instance)
        for parameter, wanted in ((INPUT, INPUT_LIVE), (OUTPUT, OUTPUT_LIVE)):
            if self._client.read_int(parameter, self._instance) != wanted:
                self._client.write_int(parameter, wanted, self._instance)
        self._client.write_int(LIVE_ENABLE, 1, self._instance)
        self._sink = self._kelvin(SINK_TEMPERATURE)

    def _check(self) -> None:
        state = self._client.read_int(STATUS)
        if state == 3:
            code = self._client.read_int(ERROR_NUMBER)
            raise DeviceError(f"the TEC controller is in error {code}: see its manual, then reset it")
        if state not in (1, 2):
            raise DeviceError(f"the TEC controller is not ready: it says '{STATES.get(state, state)}'")

    def _kelvin(self, parameter: int) -> float:
        return self._client.read_float(parameter, self._instance) + KELVIN

    def exchange(self, current: float) -> TecReading:
        """Set the current [A], and measure.

        Raises
        ------
        DeviceError
            If the controller does not answer, refuses, or is in error.
        """
        self._client.write_float(LIVE_CURRENT, current, self._instance)
        plate = self._kelvin(OBJECT_TEMPERATURE)
        if self._count % _SLOW == 0:
            self._slowly(self._count // _SLOW % 3)
        self._count += 1
        return TecReading(plate, self._sink, self._actual)

    def _slowly(self, turn: int) -> None:
        if turn == 0:
            self._actual = self._client.read_float(ACTUAL_CURRENT, self._instance)
        elif turn == 1:
            self._sink = self._kelvin(SINK_TEMPERATURE)
        else:
            self._check()

    def close(self) -> None:
        """Set the current to zero and the output off, then let go of the line."""
        try:
            self._client.write_float(LIVE_CURRENT, 0.0, self._instance)
            self._client.write_int(LIVE_ENABLE, 0, self._instance)
        finally:
            self._client.close()
