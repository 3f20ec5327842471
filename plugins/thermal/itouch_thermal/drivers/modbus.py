"""Numbers in the registers of a Modbus-TCP device; a request can also be sent now and its answer fetched later."""

from __future__ import annotations

import logging
import math
import struct
import time
from collections.abc import Callable
from typing import Any

from itouch.plugin import DeviceError, Trace, schema

PORT = 502
#: What goes wrong is said once, by this program: without a handler Python prints the client's own lines as well.
_SILENT = logging.NullHandler()
#: How long [s] an answer may take, for how many such times a request is repeated, and how often at most.
PATIENCE, SILENT, TRIES = 0.2, 2, 8
#: Time [s] after which a request is repeated at the earliest, and how many usual answer times: a reading must not get
#: too old because an answer was lost.  And the number of such early repetitions.
QUICK, USUAL, SOONER = 0.025, 3.0, 3
#: Weight of a new answer time in the usual one.
_NEWEST = 0.25
#: Temporary Modbus exceptions (5 acknowledge, 6 busy), and how often a request is then sent.
_BUSY, _TRIES = (5, 6), 3
_READ, _WRITE, _REFUSED = 3, 16, 0x80
#: Bytes of an answer up to its data: number, protocol, length, unit, function, count or exception.
_HEAD = 9
#: The lowest number of our own requests: pymodbus numbers its own from 1 to 65000.
_OWN = 65001


class ModbusRefusal(DeviceError):  # noqa: N818
    """The device has refused a request."""


class ModbusLine:
    """A connection to a device whose numbers are all 32 bits wide, high word first.

    Raises
    ------
    DeviceError
        If nothing answers.
    """

    def __init__(self, name: str, host: str, trace: Trace | None = None, *, patience: float = 1.0) -> None:
        try:
            from pymodbus.client import ModbusTcpClient
            from pymodbus.exceptions import ModbusException
        except ImportError as error:
            raise DeviceError(f"a {name} needs another package: pip install 'itouch-py[thermal-hardware]'") from error
        try:
            address, port = schema.host_port(host, port=PORT)
        except ValueError as error:
            raise DeviceError(f"host = {error}") from error
        logging.getLogger("pymodbus").addHandler(_SILENT)
        self._name, self._host, self._trace, self._failure = name, host, trace, ModbusException
        client: Any = ModbusTcpClient
        self._patience = PATIENCE * patience
        self._client: Any = client(address, port=port, timeout=PATIENCE * patience, retries=0)
        #: Usual time that answers take [s], from the latest ones; None before the first.
        self._usual: float | None = None
        self._number, self._asked_for = _OWN, -1
        #: When the newest answer was requested, and when it arrived [s]; how long the quickest took so far [s].
        self.sent, self.arrived, self.quickest = 0.0, 0.0, math.inf
        #: Number of connections made so far.
        self.connections = 0
        if not self._connect():
            self._client.close()
            raise DeviceError(f"no {name} answers at {host}: check its address and power")

    def _connect(self) -> bool:
        """Connect if not connected; return whether it is connected."""
        before = self._client.connected
        found = bool(self._client.connect())
        self.connections += found and not before
        return found

    def close(self) -> None:
        """Close the connection."""
        self._client.close()

    def floats(self, address: int, count: int = 1) -> list[float]:
        """Return the floating-point numbers at a register and the following ones.

        Raises
        ------
        DeviceError
            If it does not answer, or refuses.
        """
        return list(struct.unpack(f">{count}f", self._read(address, count)))

    def whole(self, address: int) -> int:
        """Return the unsigned integer at a register; raises as `floats` does."""
        found: int = struct.unpack(">I", self._read(address, 1))[0]
        return found

    def write(self, address: int, data: bytes) -> None:
        """Write words to a register and the following ones; raises as `floats` does."""
        words = list(struct.unpack(f">{len(data) // 2}H", data))
        if self._trace:
            self._trace.sent(b"write %d " % address + data.hex().encode())
        self._asked(address, _WRITE, lambda: self._client.write_registers(address, words))

    def ask(self, address: int) -> None:
        """Request one number whose answer takes time; `answer` must fetch it before any other request.

        Raises
        ------
        DeviceError
            If there is no connection.
        """
        if self._asked_for >= 0:  # the last answer was not fetched: it must not be mistaken for this one
            self._client.close()
        self._number, self._asked_for = max(_OWN, (self._number + 1) % 0x10000), address
        if self._trace:
            self._trace.sent(b"read %d x 1" % address)
        request = struct.pack(">HHHBBHH", self._number, 0, 6, 1, _READ, address, 2)
        for last in (False, True):
            try:
                if not self._connect():
                    raise self._failure("no connection")
                self.sent = time.monotonic()
                self._client.send(request)
                return
            except (self._failure, OSError) as error:
                self._client.close()  # it has closed the connection since the last answer
                if last:
                    raise self._silent(error) from error

    def answer(self) -> tuple[float, bool]:
        """Return the number requested by `ask`, and whether that first request has delivered it.

        After a silence, or an answer that the device is busy, the number is requested again.

        Raises
        ------
        DeviceError
            If it does not come then either, or is refused.
        """
        address, self._asked_for = self._asked_for, -1
        try:
            data = self._fetched()
        except (self._failure, OSError):
            data = b""
        if len(data) == 1 and data[0] not in _BUSY:
            raise ModbusRefusal(f"the {self._name} at {self._host} refuses register {address}: exception {data[0]}")
        if len(data) != 4:
            if len(data) != 1:
                self._client.close()  # a late answer cannot come on a new connection
            return self.floats(address)[0], False
        if self._trace:
            self._trace.received(data)
        return float(struct.unpack(">f", data)[0]), True

    def _fetched(self) -> bytes:
        """Return the last answer's data: four bytes, an exception's one byte, or what has arrived of them."""
        limit = time.monotonic() + self._patience
        while True:
            head = self._client.recv(_HEAD)
            if len(head) != _HEAD or time.monotonic() > limit:  # never wait for ever
                return b""
            number, protocol, length, _, function, size = struct.unpack(">HHHBBB", head)
            if protocol or not 3 <= length <= 260:
                return b""
            rest: bytes = self._client.recv(length - 3) if length > 3 else b""
            if number == self._number:
                return bytes((size,)) if function == _READ | _REFUSED else rest if function == _READ else b""

    def _read(self, address: int, count: int) -> bytes:
        answer = self._asked(address, _READ, lambda: self._client.read_holding_registers(address, count=2 * count))
        if len(answer.registers) != 2 * count:
            raise DeviceError(f"the {self._name} at {self._host} answers register {address} with too little: {answer}")
        raw = struct.pack(f">{2 * count}H", *answer.registers)
        if self._trace:
            self._trace.sent(b"read %d x %d" % (address, count))
            self._trace.received(raw)
        return raw

    def _asked(self, address: int, function: int, ask: Callable[[], Any]) -> Any:
        """Return the answer to a request, repeating it if the answer is missing, is damaged, or says busy."""
        begin, busy, said = time.monotonic(), 0, ""
        for turn in range(TRIES):
            try:
                answer = self._once(ask, soon=turn < SOONER)
            except (self._failure, OSError) as error:
                said = str(error)
            else:
                if answer.isError() and (code := getattr(answer, "exception_code", 0)):
                    busy += code in _BUSY
                    if code in _BUSY and busy < _TRIES:
                        continue
                    raise ModbusRefusal(
                        f"the {self._name} at {self._host} refuses register {address}: exception {code}"
                    )
                if not answer.isError() and answer.function_code == function:
                    self.arrived = time.monotonic()
                    self.quickest = min(self.quickest, self.arrived - self.sent)
                    took = self.arrived - begin
                    self._usual = took if self._usual is None else self._usual + _NEWEST * (took - self._usual)
                    return answer
                said = f"it answers {answer}"
            self._client.close()  # a late answer cannot come on a new connection
            if time.monotonic() - begin >= SILENT * self._patience:
                break
        raise self._silent(said)

    def _once(self, ask: Callable[[], Any], *, soon: bool) -> Any:
        """Send a request once; if ``soon``, wait only a few times as long as answers usually take."""
        known = self._usual if soon else None
        settings = self._client.comm_params
        if not self._connect():
            raise self._failure("no connection")
        if known is not None:
            settings.timeout_connect = min(self._patience, max(QUICK * self._patience / PATIENCE, USUAL * known))
        self.sent = time.monotonic()
        try:
            return ask()
        finally:
            settings.timeout_connect = self._patience

    def _silent(self, error: object) -> DeviceError:
        return DeviceError(f"the {self._name} at {self._host} does not answer: {error}")
