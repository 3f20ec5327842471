"""Virtual counterparts of the drivers: a TEC controller, a self-built rig, and a T7, each without any transport.

Each holds the physical values that it would measure, set by the owner of the physics.  The faults are counts of answers
that go wrong.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from dataclasses import dataclass, field

from itouch_thermal.drivers import labjack, lineport, tec
from itouch_thermal.drivers.mecom import crc16


@dataclass(slots=True)
class Plate:
    """Values of a display's sensors [K, W/m2, A], and the commanded current."""

    plate: float = 296.15
    sink: float = 296.15
    flux: float = 0.0
    skin: float = math.nan
    current: float = 0.0


@dataclass(slots=True)
class InjectedErrors:
    """Numbers of answers to lose, to damage, to replace by "busy", or to send with the previous request's number."""

    lost: int = 0
    damaged: int = 0
    busy: int = 0
    late: int = 0

    def take(self, name: str) -> bool:
        """Tell whether this answer shall go wrong in this way, and count it down."""
        left: int = getattr(self, name)
        if left > 0:
            setattr(self, name, left - 1)
        return left > 0


#: Factory settings of a controller.
_FACTORY = {
    2020: 0.0, 2021: 0.0, 2030: 10.0, 2031: 19.0, 2032: 12.0, 2033: 22.8, 2060: 0.0, 4010: 13.0, 4011: 65.0,
    50001: 0.0, 50002: 0.0,
}  # fmt: skip


#: A raised speed lasts this long [s] after the last request.
SILENCE = 5.0


@dataclass(slots=True)
class VirtualMecom:
    """A TEC controller: parameters, status, live current; ``flash`` counts writes that would wear its flash.

    ``instance`` is the channel at which the module is, ``now`` [s] the time for its watchdog, ``resistance`` [ohm] its
    module's, ``bulk`` whether it knows ``?VX``.
    """

    plate: Plate
    address: int = 2
    instance: int = 1
    injected: InjectedErrors = field(default_factory=InjectedErrors)
    error: int = 0
    flash: int = 0
    integers: dict[int, int] = field(
        default_factory=lambda: {2000: 2, 2010: 0, 2051: 2, 50000: 0, 1200: 1, 6301: 0, 6302: 0}
    )
    floats: dict[int, float] = field(default_factory=lambda: dict(_FACTORY))
    now: float = 0.0
    resistance: float = 1.86
    bulk: bool = True
    #: The speed to which the host has raised the line, 0: not raised; and whether the controller can do that.
    raised: int = 0
    can_hasten: bool = True
    _heard: float = 0.0
    _text: bytes = b""

    def take(self, data: bytes) -> bytes:
        """Take bytes from the host and return the controller's answer."""
        self._text += data
        out = b""
        while b"\r" in self._text:
            message, _, self._text = self._text.partition(b"\r")
            out += self._message(message[message.rfind(b"#") :] if b"#" in message else b"")
        return out

    def driven(self) -> bool:
        """Tell whether the host drives the output; trip the watchdog if the host was silent for too long."""
        if self.floats[tec.WATCHDOG] > 0.0 and self.now - self._heard > self.floats[tec.WATCHDOG] and self._armed():
            self.error = 183
        return self._armed()

    def restart(self) -> None:
        """Restart, as after a loss of its supply."""
        self.error, self.integers[50000] = 0, 0
        self.floats[50001] = self.floats[50002] = 0.0
        self.raised = 0

    def fast(self) -> int:
        """Return the speed to which the line is raised; 0: its own, also after a long silence."""
        if self.now - self._heard > SILENCE:
            self.raised = 0
        return self.raised

    def _armed(self) -> bool:
        live = self.integers[2000] == tec.INPUT_LIVE and self.integers[2010] == tec.OUTPUT_LIVE
        return live and self.integers[50000] == 1 and not self.error

    def output(self) -> float:
        """Return the current that flows [A]: the commanded one, within the limits and the voltage."""
        if not self.driven():
            return 0.0
        most = min(self.floats[tec.CURRENT_LIMIT], self.floats[tec.LIVE_VOLTAGE] / self.resistance)
        return min(most, max(-most, self.floats[50001]))

    def _message(self, message: bytes) -> bytes:
        body, check = message[:-4], message[-4:]
        if len(message) < 11 or check != b"%04X" % crc16(body) or int(body[1:3], 16) not in (0, self.address):
            return b""
        if self.injected.take("lost"):
            return b""
        self._heard = self.now
        head = b"!" + body[1:7]
        if self.injected.take("late"):
            head = b"!" + body[1:3] + b"%04X" % (int(body[3:7], 16) - 1 & 0xFFFF)
        answer = b"+02" if self.injected.take("busy") else self._payload(body[7:].decode("ascii", "replace"))
        whole = head + answer + (b"%04X" % crc16(head + answer) if answer else check) + b"\r"
        if self.injected.take("damaged"):
            whole = whole[:7] + b"?" + whole[8:]
        return whole

    def _payload(self, text: str) -> bytes:
        if text[:3] == "?IF":
            return b"TEC-1091 virtual    "
        if text[:3] == "?VR" and len(text) == 9:
            return self._read(int(text[3:7], 16), int(text[7:9], 16))
        if text[:3] == "?VX" and self.bulk and len(text) == 5 + 6 * int(text[3:5], 16):
            parts = [text[at : at + 6] for at in range(5, len(text), 6)]
            answers = [self._read(int(part[:4], 16), int(part[4:], 16)) for part in parts]
            return next((answer for answer in answers if answer[:1] == b"+"), b"".join(answers))
        if text[:2] == "CS" and len(text) == 10 and self.can_hasten:
            self.raised = int(text[2:], 16)
            return b""
        if text[:2] == "VS" and len(text) == 16:
            return self._write(int(text[2:6], 16), int(text[6:8], 16), bytes.fromhex(text[8:]))
        return b"+01"

    def _read(self, parameter: int, instance: int) -> bytes:
        if instance != self.instance:
            return b"+08"
        plate = self.plate
        measured = {
            1000: plate.plate - tec.KELVIN, 1001: plate.sink - tec.KELVIN,
            1020: self.output(), 1021: 2.0 * self.output(),
        }  # fmt: skip
        if parameter in measured:
            return struct.pack(">f", measured[parameter]).hex().upper().encode()
        if parameter in self.floats:
            return struct.pack(">f", self.floats[parameter]).hex().upper().encode()
        whole = {104: 3 if self.error else 2, 105: self.error, **self.integers}
        return struct.pack(">i", whole[parameter]).hex().upper().encode() if parameter in whole else b"+05"

    def _write(self, parameter: int, instance: int, data: bytes) -> bytes:
        if instance != self.instance:
            return b"+08"
        if parameter in (104, 105, 1000, 1001, 1020, 1021, 1200):
            return b"+06"
        if parameter in self.floats:
            value = struct.unpack(">f", data)[0]
            if not math.isfinite(value) or abs(value) > 200.0 or (parameter == 50001 and abs(value) > 20.0):
                return b"+07"
            self.floats[parameter] = value
        elif parameter in self.integers:
            self.integers[parameter] = struct.unpack(">i", data)[0]
        else:
            return b"+05"
        self.flash += parameter < 50000
        return b""


@dataclass(slots=True)
class VirtualLine:
    """A rig of one's own, with its watchdog."""

    plate: Plate
    injected: InjectedErrors = field(default_factory=InjectedErrors)
    current: float = 0.0
    limit: float = 10.0
    _fed: float = -math.inf
    _text: bytes = b""

    def take(self, data: bytes, now: float) -> bytes:
        """Take bytes from the host and return the rig's answer."""
        self._text += data
        out = b""
        while b"\n" in self._text:
            line, _, self._text = self._text.partition(b"\n")
            body = lineport.unseal(line)
            if body is None or self.injected.take("lost"):
                continue
            answer = lineport.seal(self._answer(body, now))
            out += b"#" + answer[1:] if self.injected.take("damaged") else answer
        return out

    def output(self, now: float) -> float:
        """Return the current that flows [A]; zero if no command has come lately."""
        if now - self._fed > lineport.WATCHDOG:
            self.current = 0.0
        return self.current

    def _answer(self, body: str, now: float) -> str:
        if body == "?":
            return f"N {lineport.GREETING} virtual"
        if not body.startswith("I "):
            return "E unknown command"
        try:
            amps = float(body[2:])
        except ValueError:
            return "E not a number"
        if not abs(amps) <= self.limit:
            return "E out of range"
        self.current, self._fed = amps, now
        p = self.plate
        values = (p.plate - lineport.KELVIN, p.sink - lineport.KELVIN, p.flux, p.skin - lineport.KELVIN, amps)
        return "R " + " ".join(f"{value:.4f}" for value in values)


#: How long [s] an input's past voltages are stored: the longest burst of samples.
_REMEMBERED = 0.18


@dataclass(slots=True)
class VirtualT7:
    """A LabJack T7: Modbus-TCP requests in, answers out; ``volts`` are the voltages at its inputs.

    ``averages``: whether it has the extended feature that averages a burst of samples of an input.  The input's past
    voltages are recorded with `see`.
    """

    volts: dict[int, float] = field(default_factory=dict)
    product: float = 7.0
    injected: InjectedErrors = field(default_factory=InjectedErrors)
    words: dict[int, int] = field(default_factory=dict)
    averages: bool = True
    _seen: dict[int, deque[tuple[float, float]]] = field(default_factory=dict)

    def see(self, now: float) -> None:
        """Record the present voltages of the inputs at a time [s]."""
        for channel, volts in self.volts.items():
            seen = self._seen.setdefault(channel, deque())
            if not seen or now > seen[-1][0]:
                seen.append((now, volts))
            while seen[0][0] < now - _REMEMBERED - 1e-9:
                seen.popleft()

    def restart(self) -> None:
        """Restart, as after a loss of its supply: all settings are lost."""
        self.words.clear()

    def takes(self, request: bytes) -> float:
        """Return how long it samples to answer a request [s]."""
        channel = self._averaged(request)
        count, rate = self._burst(channel) if channel is not None else (0, 1.0)
        return count / rate if rate > 0.0 and count / rate <= _REMEMBERED else 0.0

    def answer(self, request: bytes) -> bytes | None:
        """Answer one Modbus message without its header (function code and data); None: no answer."""
        if self.injected.take("lost"):
            return None
        function = request[0]
        if function in (3, 4) and len(request) == 5:
            address, count = struct.unpack(">HH", request[1:5])
            if not 1 <= count <= 120:
                return bytes((function | 0x80, 3))
            if self.injected.take("busy"):
                return bytes((function | 0x80, 6))
            if not self.averages and self._is_feature(address):
                return bytes((function | 0x80, 2))
            channel = self._averaged(request)
            if channel is not None:
                mean = self._mean(channel)
                return bytes((function | 0x80, 4)) if mean is None else bytes((function, 4)) + struct.pack(">f", mean)
            return bytes((function, 2 * count)) + struct.pack(f">{count}H", *self._read(address, count))
        if function == 16 and len(request) >= 6:
            address, count, size = struct.unpack(">HHB", request[1:6])
            if not self.averages and self._is_feature(address):
                return bytes((function | 0x80, 2))
            values = struct.unpack(f">{size // 2}H", request[6 : 6 + size])
            self.words.update(zip(range(address, address + count), values, strict=False))
            return request[:5]
        return bytes((function | 0x80, 1))

    @staticmethod
    def _is_feature(address: int) -> bool:
        return labjack.EF_RESULT <= address < labjack.EF_RATE + 2 * 150

    def _averaged(self, request: bytes) -> int | None:
        """Return the channel whose average a request reads; None if it reads something else."""
        if not self.averages or len(request) != 5 or request[0] not in (3, 4):
            return None
        address, count = (int(number) for number in struct.unpack(">HH", request[1:5]))
        channel, odd = divmod(address - labjack.EF_RESULT, 2)
        if count != 2 or odd or not 0 <= channel < 150 or self._word(labjack.EF_INDEX + 2 * channel) != labjack.AVERAGE:
            return None
        return channel

    def _word(self, address: int) -> int:
        return self.words.get(address, 0) << 16 | self.words.get(address + 1, 0)

    def _burst(self, channel: int) -> tuple[int, float]:
        """Return the number of samples of a burst, and their rate [1/s]."""
        count = self._word(labjack.EF_SAMPLES + 2 * channel) or 200
        rate: float = struct.unpack(">f", struct.pack(">I", self._word(labjack.EF_RATE + 2 * channel)))[0]
        return count, rate

    def _mean(self, channel: int) -> float | None:
        """Return the mean of the burst of samples that ends now [V]; None if there is no such burst."""
        count, rate = self._burst(channel)
        if not rate > 0.0 or count / rate > _REMEMBERED or channel not in self._seen:
            return None
        seen = self._seen[channel]
        now, at, samples = seen[-1][0], len(seen) - 1, []
        for number in range(count):
            while at > 0 and seen[at][0] > now - number / rate + 1e-9:
                at -= 1
            samples.append(seen[at][1])
        return sum(samples) / count

    def _read(self, address: int, count: int) -> list[int]:
        shown = dict(self.words)
        for start, value in ((labjack.PRODUCT, self.product), *((2 * c, v) for c, v in self.volts.items())):
            shown[start], shown[start + 1] = struct.unpack(">2H", struct.pack(">f", value))
        return [shown.get(at, 0) for at in range(address, address + count)]
