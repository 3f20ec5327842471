"""The display's emulator: a virtual controller, rig or T7 at the parameters' addresses, with the display's twin."""

from __future__ import annotations

import contextlib
import math
import os
import socket
import struct
import tempfile
import time
from collections import deque
from dataclasses import replace
from typing import Any

from itouch.plugin import DeviceError, Emulator, Record, Terminal
from itouch_thermal.chip.line import SimulatedLine
from itouch_thermal.drivers.driver_params import FluxSensor, Infrared, LabJack, Mecom
from itouch_thermal.drivers.virtual import Plate, VirtualLine, VirtualMecom, VirtualT7

#: Longest age [s] of the sensors' readings, and with a simulated chip or an averaging T7.
_UNSEEN, _UNSEEN_BY_CHIP = 2e-3, 5e-4
#: A simulated chip drives from this current [A] on: its control loop never holds exactly zero.
_DRIVEN = 0.02


def _has_chip(params: Any) -> bool:
    return params.line is not None and params.line.firmware == "reference"


class ModbusServer:
    """A non-blocking Modbus-TCP server; one device answers all connections, one request after the other.

    Requests that take the device time are answered after that time, which runs ``speed`` times as fast as the host's.
    """

    def __init__(self, host: str, port: int, device: VirtualT7, speed: float = 1.0) -> None:
        try:
            self._listener = Emulator.listener((host, port))
        except OSError as error:
            raise DeviceError(f"no virtual T7 can listen on {host}:{port}: {error.strerror or error}") from error
        self._listener.setblocking(False)
        self._device, self._speed = device, speed
        self._lines: dict[socket.socket, bytes] = {}
        self._waiting: deque[tuple[float, socket.socket, bytes, bytes]] = deque()

    @property
    def port(self) -> int:
        """The port on which it listens."""
        port: int = self._listener.getsockname()[1]
        return port

    def file_descriptors(self) -> list[int]:
        """Return the file descriptors on which data may arrive."""
        return [self._listener.fileno(), *(line.fileno() for line in self._lines)]

    def serve(self) -> None:
        """Accept new connections and answer the requests that have arrived."""
        with contextlib.suppress(BlockingIOError):
            line, _ = self._listener.accept()
            line.setblocking(False)
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._lines[line] = b""
        for line in list(self._lines):
            try:
                data = line.recv(4096)
            except BlockingIOError:
                continue
            except OSError:
                data = b""
            if not data or not self._hear(line, data):
                del self._lines[line]
                line.close()
        self._answer()

    def service_interval(self) -> float:
        """Return the time until the next answer is due [s]."""
        return max(0.0, self._waiting[0][0] - time.monotonic()) if self._waiting else math.inf

    def _hear(self, line: socket.socket, data: bytes) -> bool:
        waiting = self._lines[line] + data
        while len(waiting) >= 8:
            number, protocol, length = struct.unpack(">HHH", waiting[:6])
            if protocol or not 2 <= length <= 260:
                return False
            if len(waiting) < 6 + length:
                break
            unit, request, waiting = waiting[6:7], waiting[7 : 6 + length], waiting[6 + length :]
            begin = max(time.monotonic(), self._waiting[-1][0] if self._waiting else 0.0)
            due = begin + self._device.takes(request) / self._speed
            self._waiting.append((due, line, struct.pack(">H", number) + unit, request))
        self._lines[line] = waiting
        return True

    def _answer(self) -> None:
        """Send the answers that are due."""
        while self._waiting and self._waiting[0][0] <= time.monotonic():
            _, line, head, request = self._waiting.popleft()
            answer = self._device.answer(request)
            if answer is not None and line in self._lines:
                with contextlib.suppress(OSError):
                    line.sendall(head[:2] + struct.pack(">HH", 0, len(answer) + 1) + head[2:] + answer)

    def close(self) -> None:
        """Close all connections."""
        for line in self._lines:
            line.close()
        self._listener.close()


class DisplayEmulator(Emulator):
    """The hardware named in the parameters; errors and delays can be injected into `tec`, `line` and `t7`."""

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        self.plate = Plate()
        tec = params.mecom
        self.tec = None if tec is None else VirtualMecom(self.plate, address=tec.address, instance=tec.instance)
        self.chip = SimulatedLine(params, self.plate) if _has_chip(params) else None
        self.line = VirtualLine(self.plate) if params.line is not None and self.chip is None else None
        self.t7 = VirtualT7() if params.labjack is not None else None
        #: In step with the host, a T7 that averages must sample in every period.
        self.free_running = self.chip is not None or (params.labjack is not None and params.labjack.samples > 1)
        self._terminal: Terminal | None = None
        self._server: ModbusServer | None = None

    @classmethod
    def with_default_address(cls, params: Any) -> Any:
        """Name a TEC controller and a T7 on this machine if no hardware is named."""
        if params.mecom is not None or params.line is not None:
            return params
        mecom = Mecom(port=f"{tempfile.gettempdir()}/itouch-tec-{os.getpid()}")
        sensors = LabJack(host=_free_port(), flux_sensor=FluxSensor(sensitivity=1e-6), infrared=Infrared())
        return replace(params, mecom=mecom, labjack=sensors)

    @classmethod
    def with_private_address(cls, params: Any, folder: str) -> Any:
        """Name serial ports in a folder, and a free port of this machine, for the instruments in the parameters."""
        moved: dict[str, Any] = {}
        for name in ("mecom", "line"):
            named = getattr(params, name)
            if named is not None:
                moved[name] = replace(named, port=f"{folder}/{name}")
        if params.labjack is not None:
            moved["labjack"] = replace(params.labjack, host=_free_port())
        return replace(params, **moved)

    def open(self) -> str:
        """Create the serial port and the server named in the parameters; return what is where."""
        named, words = self.params.mecom or self.params.line, []
        if named is not None:
            self._terminal = Terminal(named.port, baud=named.baud * self.speed)
            words.append(f"current source of the display on {named.port}")
        if self.chip is not None:
            self.chip.open()
            words.append("the reference display's program in a simulated chip")
        if self.t7 is not None:
            host, _, port = self.params.labjack.host.partition(":")
            self._server = ModbusServer(host, int(port or 502), self.t7, self.speed)
            words.append(f"LabJack on {host}:{self._server.port}")
        return ", ".join(words) or "nothing: no hardware is named"

    def close(self) -> None:
        """Remove them."""
        for part in (self._terminal, self._server):
            if part is not None:
                part.close()
        self._terminal = self._server = None
        if self.chip is not None:
            self.chip.close()

    def service_interval(self) -> float:
        """Return the time until the serial line or the server is due [s], at most the longest age of a reading."""
        longest = _UNSEEN_BY_CHIP if self.free_running else _UNSEEN
        served = self._server.service_interval() if self._server is not None else math.inf
        return min(longest, served, self._terminal.due() if self._terminal is not None else math.inf)

    def file_descriptors(self) -> list[int]:
        """Return the file descriptors of the serial port and the server."""
        served = self._server.file_descriptors() if self._server is not None else []
        return [*served, *([self._terminal.fileno()] if self._terminal is not None else [])]

    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Show the twin's sensors to the instruments, answer the host, and give the twin its current.

        Return whether the host drives the module.
        """
        p = self.plate
        p.plate, p.sink = reading["plate_temperature"].item(), reading["sink_temperature"].item()
        p.flux = reading["heat_flux"].item()
        valid = reading["skin_valid"].item() > 0.5
        p.skin = reading["skin_temperature"].item() if valid else float("nan")
        self._volts(valid)
        if self.t7 is not None:
            self.t7.see(now)
        data = self._terminal.receive() if self._terminal is not None else b""
        driven, current = False, 0.0
        if self.tec is not None:
            self.tec.now = now
            out = self.tec.take(data) if data and self._in_step_with_host() else b""
            driven, current = self.tec.driven(), self.tec.output()
        elif self.chip is not None:
            out, current = self.chip.take(data, now)
            driven = abs(current) > _DRIVEN
        elif self.line is not None:
            out = self.line.take(data, now) if data else b""
            current = self.line.output(now)
            driven = current != 0.0
        else:
            out = b""
        if out and self._terminal is not None:
            self._terminal.send(out)
        if self._server is not None:
            self._server.serve()
        command["current"] = current
        return driven

    def _in_step_with_host(self) -> bool:
        """Tell whether host and controller use the same baud rate: otherwise neither understands the other."""
        if self.tec is None or self._terminal is None:
            return False
        speed = self.tec.fast() or self.params.mecom.baud
        self._terminal.set_baud(speed * self.speed)
        return self._terminal.host_baud() in (0, speed)

    def _volts(self, valid: bool) -> None:
        if self.t7 is None:
            return
        flux, infrared = self.params.labjack.flux_sensor, self.params.labjack.infrared
        if flux is not None:
            self.t7.volts[flux.channel] = flux.voltage(self.plate.flux, self.plate.plate)
        if infrared is not None:
            self.t7.volts[infrared.channel] = (self.plate.skin - infrared.zero) / infrared.slope if valid else 0.0


def _free_port() -> str:
    """Return an address of this machine with a port that is free now."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        return f"127.0.0.1:{free.getsockname()[1]}"
