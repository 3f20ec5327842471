"""MeCom, the protocol of Meerstetter's TEC controllers: frames of ASCII hexadecimal with a checksum.

A request is ``#``, address (2 digits), sequence number (4), payload, CRC-16 (4) and CR; an answer begins with ``!`` and
has the same sequence number.  A write is acknowledged without a payload, and with the request's own CRC.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Sequence
from time import monotonic, sleep

from itouch.plugin import DeviceError, Trace
from itouch_thermal.drivers.answer_times import TURNAROUND
from itouch_thermal.drivers.serialport import SerialLine

#: How long [s] an answer may take, and how often a request without an answer is sent; how often at most if answers come
#: damaged.
PATIENCE, TRIES, DAMAGED = 0.06, 3, 8
#: If a loop is waiting: how many repetitions come sooner, after how long [s] at the earliest, and after how many usual
#: answer times, so that a slow controller is not overrun.  (All have the same number: the first answer counts, the
#: others are late.)
SOONER, QUICK, USUAL = 4, 0.02, 2.0
#: How many bytes an answer has around its payload.
_AROUND = 12
#: Weight of a new answer time in the usual one.
_NEWEST = 0.25
#: The address to which every controller answers, stating its own.
ANY = 0
#: After this long a silence [s] a raised line is back at its own speed: 5 s, with a margin.
FALLEN = 5.5
ERRORS = {
    1: "command not available", 2: "device is busy", 3: "general communication error", 4: "format error",
    5: "no such parameter", 6: "parameter is read only", 7: "value out of range", 8: "no such instance",
    9: "parameter general failure",
}  # fmt: skip
#: Error codes: the controller is busy; it has no such channel.
BUSY, NO_INSTANCE = 2, 8
#: Temporary refusals: it is busy, or the request arrived damaged (a general communication error, a format error).  Such
#: a request is repeated.
_PASSING = (BUSY, 3, 4)
#: Refusals that mean that a parameter or a command does not exist.
UNKNOWN = (1, 5)


class MecomError(DeviceError):
    """The controller does not answer, or its answers are damaged."""


class MecomRefusal(MecomError):  # noqa: N818
    """The controller refuses a request, with its error code."""

    def __init__(self, code: int, request: str) -> None:
        super().__init__(
            f"the TEC controller refuses {_named(request)}: {ERRORS.get(code, 'unknown error')} (+{code:02d})"
        )
        self.code = code


def crc16(data: bytes) -> int:
    """Return the CRC-16 with polynomial 0x1021 and initial value 0."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


def _named(request: str) -> str:
    """Return a request with its parameter's number in decimal, as in the maker's documentation."""
    part = {"VS": request[2:6], "?V": request[3:7]}.get(request[:2], "")
    if not part or request.startswith("?VX"):
        return f"'{request}'"
    return f"'{request}' (parameter {int(part, 16)})"


class MecomClient:
    """Requests to one controller; a request is repeated with the same number if its answer is missing or damaged."""

    def __init__(
        self, port: str, baud: int = 57600, address: int = 2, *, patience: float = 1.0, trace: Trace | None = None
    ) -> None:
        self._line = SerialLine(port, baud, end=b"\r", trace=trace, patience=max(1.0, patience))
        self._address, self._sequence, self._patience = address, 0, patience
        self._slow = baud
        #: The line's present speed [baud].
        self.baud = baud
        #: Whether a loop is waiting for the answers; and the usual time that they take [s], from the latest ones.
        self.hurry, self._usual = False, 0.0
        #: How old the newest answer may be besides its time on the line [s]: it may have waited anywhere, and be to the
        #: first sending of its request, whose number is that of the second.
        self.doubt = 0.0
        self._spoilt = False
        #: The address of another controller that has answered requests to this one; -1: none.
        self._other = -1

    def close(self) -> None:
        """Return the line to its own speed, and release it."""
        try:
            if self.baud != self._slow:
                with contextlib.suppress(DeviceError):  # even if the port is gone: an earlier error counts
                    self._ask(f"CS{self._slow:08X}")
        finally:
            self._line.close()

    def hasten(self, baud: int) -> bool:
        """Raise the line's speed, which falls back after 5 s of silence; tell whether the controller can do this.

        A controller that a dead program has left at this speed is found there.  If the line does not carry the speed,
        the controller is returned to its own.

        Raises
        ------
        DeviceError
            If it answers at neither speed, or the port does not support the speed.
        """
        if baud == self._slow:
            return False
        try:
            self._ask(f"CS{baud:08X}")
        except MecomRefusal as refusal:
            if refusal.code not in UNKNOWN:
                raise
            return False
        except MecomError:
            self._set(baud)
            self._ask("?IF")
            return True
        self._set(baud)
        try:
            self._ask("?IF")
        except MecomRefusal:
            pass
        except MecomError:
            self._slowed(baud)
        return self.baud == baud

    def _slowed(self, baud: int) -> None:
        """Reach a controller at its own speed again after raising it to one that the line does not carry.

        Raises
        ------
        MecomError
            If it does not come back.
        """
        with contextlib.suppress(MecomError):  # it may receive this although its answer is damaged
            self._ask(f"CS{self._slow:08X}", tries=1)
        self._set(self._slow)
        with contextlib.suppress(MecomError):
            self._ask("?IF", tries=1)
            return
        sleep(FALLEN)
        try:
            self._ask("?IF")
        except MecomRefusal:
            pass
        except MecomError as error:
            raise MecomError(
                f"the line on {self._line.port} does not carry {baud} baud, and after {FALLEN:g} s of silence the TEC "
                f"controller does not answer at {self._slow} baud either: write a smaller session-baud, or none"
            ) from error

    def _set(self, baud: int) -> None:
        self._line.set_baud(baud)
        self.baud = baud

    def identity(self) -> str:
        """Return the controller's identification string."""
        return self._ask("?IF").strip()

    def read_float(self, parameter: int, instance: int = 1) -> float:
        """Return a parameter's floating-point value."""
        value: float = struct.unpack(">f", self.read_raw(parameter, instance))[0]
        return value

    def read_int(self, parameter: int, instance: int = 1) -> int:
        """Return a parameter's whole number."""
        value: int = struct.unpack(">i", self.read_raw(parameter, instance))[0]
        return value

    def write_float(self, parameter: int, value: float, instance: int = 1) -> None:
        """Set a parameter to a floating-point value."""
        self._write(parameter, instance, struct.pack(">f", value))

    def write_int(self, parameter: int, value: int, instance: int = 1) -> None:
        """Set a parameter to a whole number."""
        self._write(parameter, instance, struct.pack(">i", value))

    def read_several(self, parameters: Sequence[int], instance: int = 1) -> list[bytes]:
        """Return several parameters of one instance in one request, 4 bytes each."""
        wanted = "".join(f"{parameter:04X}{instance:02X}" for parameter in parameters)
        payload = self._ask(f"?VX{len(parameters):02X}{wanted}")
        try:
            data = bytes.fromhex(payload)
        except ValueError:
            data = b""
        if len(data) != 4 * len(parameters):
            raise MecomError(f"the TEC controller answered {len(parameters)} parameters with '{payload}'")
        return [data[i : i + 4] for i in range(0, len(data), 4)]

    def read_raw(self, parameter: int, instance: int = 1) -> bytes:
        """Return a parameter's 4 bytes."""
        payload = self._ask(f"?VR{parameter:04X}{instance:02X}")
        try:
            data = bytes.fromhex(payload)
        except ValueError:
            data = b""
        if len(data) != 4:
            raise MecomError(f"the TEC controller answered parameter {parameter} with '{payload}', not with 4 bytes")
        return data

    def _write(self, parameter: int, instance: int, data: bytes) -> None:
        answer = self._ask(f"VS{parameter:04X}{instance:02X}{data.hex().upper()}")
        if answer:
            raise MecomError(f"the TEC controller answered a write of parameter {parameter} with '{answer}'")

    def _ask(self, payload: str, tries: int = TRIES) -> str:
        """Send a request and return the payload of its answer.

        If a loop is waiting, the line's own speed is tried, too: the controller may have fallen back to it.  If it does
        not answer there either, the raised speed is restored, at which a later request may be received.

        Raises
        ------
        MecomRefusal
            If the controller refuses.
        MecomError
            If no intact answer comes.
        """
        self._sequence = self._sequence + 1 & 0xFFFF
        body = f"#{self._address:02X}{self._sequence:04X}{payload}".encode()
        crc = crc16(body)
        request = body + b"%04X\r" % crc
        refusal: MecomRefusal | None = None
        raised = self.baud
        falls = raised != self._slow and self.hurry
        first = SOONER if falls else SOONER + tries - 1 if self.hurry else tries
        turns, turn, spoilt = first + tries if falls else first, 0, 0
        begin = monotonic()
        unanswered: list[float] = []  # when each request was sent that nothing has come to yet
        while turn < turns:
            if turn == first and refusal is not None:
                break  # it is at this speed
            if turn == first:  # after a restart or a long silence its line is slow again
                self._set(self._slow)
            self._line.clear()
            self._line.send(request)
            unanswered.append(monotonic())
            sooner = self.hurry and turn < SOONER
            quick = min(PATIENCE, max(QUICK, USUAL * self._usual))
            end = monotonic() + self._patience * (quick if sooner else PATIENCE)
            answer = self._answer(crc, end)
            earliest = unanswered.pop(0) if answer is not None or self._spoilt else 0.0
            if answer is None and self._spoilt and spoilt < DAMAGED - tries:
                spoilt += 1  # a damaged answer is not a silence
                continue
            turn += 1
            if answer is None:
                continue
            byte = 10.0 / self.baud
            waited = monotonic() - earliest - (len(answer) + _AROUND) * byte
            self.doubt = waited if unanswered or waited > TURNAROUND + len(request) * byte else 0.0
            self._usual += _NEWEST * ((monotonic() - begin) / self._patience - self._usual)
            if not answer.startswith("+"):
                return answer
            code = int(answer[1:]) if answer[1:].isdigit() else 0
            refusal = MecomRefusal(code, payload)
            if code not in _PASSING:
                break
            if code == BUSY and 1 < turn < turns:  # immediate repetitions would find it busy, too
                sleep(max(0.0, end - monotonic()))
        if refusal is not None:
            raise refusal
        if raised != self.baud:
            self._set(raised)
        found = self._other
        advice = f"; check its power, its cable, and that its line is set to {self._slow} baud"
        if found >= 0:
            advice = f'; one of address {found} did: if that is yours, write address="{found}"'
        raise MecomError(f"the TEC controller on {self._line.port} did not answer {turns} times{advice}")

    def _answer(self, sent: int, limit: float) -> str | None:
        """Return the payload of the next intact answer to this request before ``limit``, or None.

        Other traffic on the line is skipped, and does not extend the wait.
        """
        self._spoilt = False
        while True:
            message = self._line.receive(max(0.0, limit - monotonic()))
            if message is None:
                return None
            start = message.rfind(b"!")
            if start < 0:
                continue  # an adaptor's echo, or other traffic
            body, check = message[start:-4], message[-4:]
            try:
                address, number, crc = int(body[1:3], 16), int(body[3:7], 16), int(check, 16)
            except ValueError:
                self._spoilt = True
                return None
            if number != self._sequence:
                continue  # an answer that came too late
            if self._address not in (ANY, address):
                self._other = address
                continue  # another controller's, to another host with the same numbers
            payload = body[7:].decode("ascii", "replace")
            good = crc == crc16(body) or (
                not payload and crc == sent
            )  # some firmware acknowledges with a CRC of its own
            self._spoilt = not good
            return payload if good else None
