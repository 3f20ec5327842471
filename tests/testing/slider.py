"""A good plugin: a finger on a slider that pushes back, over a line of text; its twin, its emulator."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

import numpy as np

from itouch.plugin import (
    Device,
    DeviceError,
    Emulator,
    Field,
    Record,
    Terminal,
    Twin,
    TwinInputs,
    gaussian,
    pose,
    schema,
    wrench,
)

#: A line of the emulator: where the slider is [m].
_POSITION = re.compile(rb"P (-?\d+\.\d{9}) (-?\d+\.\d{9}) (-?\d+\.\d{9})")


@dataclass(frozen=True)
class SliderParams:
    """What <slider:hardware .../> may hold."""

    port: str = schema.text(default="loop://", doc="serial port, or loop:// for none")
    travel: float = schema.quantity("m", low=1e-3, high=0.5, default=0.1, doc="length of the rails")


class SliderTwin(Twin):
    """Follows the finger, with a little noise."""

    def fields(self) -> tuple[Field, ...]:
        """Return place and noise."""
        return (
            Field("place", "f8", 3, unit="m", doc="where the slider is"),
            Field("noise", "u8", unit="1", doc="word of the noise generator"),
        )

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Begin in the middle."""
        state["place"] = 0.0
        state["noise"] = rng.integers(1 << 62)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Go where the finger is."""
        if touch.finger_attached:
            state["place"] = touch.finger_pose[:3]

    def read(self, state: Record, reading: Record) -> bool:
        """Give the place."""
        reading["pose"][:3] = state["place"]
        reading["pose"][0] += 1e-7 * gaussian(state, "noise")
        reading["pose"][3:] = (1.0, 0.0, 0.0, 0.0)
        return True


class SliderEmulator(Emulator):
    """Says where it is, hears how hard it shall push."""

    def open(self) -> str:
        """Listen at the port."""
        self._terminal, self._rest, self._force = Terminal(self.params.port), b"", 0.0
        return self.params.port

    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Answer."""
        lines = (self._rest + self._terminal.receive()).split(b"\n")
        self._rest = lines.pop()
        for line in lines:
            self._force = float(line[1:])
        command["wrench"][:] = 0.0
        command["wrench"][2] = self._force
        x, y, z = reading["pose"][:3]
        self._terminal.send(f"P {x:.9f} {y:.9f} {z:.9f}\n".encode())
        return True

    def close(self) -> None:
        """Hang up."""
        self._terminal.close()


class Slider(Device):
    """A slider that tracks a finger and pushes it."""

    Params = SliderParams
    reads = (pose(locked=(3, 4, 5)),)
    commands = (wrench(force=5.0, locked=(0, 1, 3, 4, 5)),)
    Twin = SliderTwin
    Emulator = SliderEmulator
    watchdog = 0.1

    def open(self) -> None:
        """Open the port."""
        self._line = -1
        self._rest, self._place = b"", (0.0, 0.0, 0.0)
        if self.params.port == "loop://":
            return
        try:
            self._line = os.open(self.params.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise DeviceError(f"no slider at {self.params.port}: {error.strerror}; is it plugged in?") from error

    def close(self) -> None:
        """Close the port."""
        if self._line >= 0:
            os.close(self._line)
            self._line = -1

    def read(self, reading: Record) -> bool:
        """Take the newest line."""
        fresh = self._line < 0
        if self._line >= 0:
            fresh = self._receive()
        reading["pose"][:] = (*self._place, 1.0, 0.0, 0.0, 0.0)
        return fresh

    def _receive(self) -> bool:
        try:
            data = os.read(self._line, 1 << 16)
        except BlockingIOError:
            return False
        except OSError as error:
            raise DeviceError(f"the slider is gone: {error.strerror}") from error
        if not data:
            raise DeviceError("the slider is gone")
        lines, fresh = (self._rest + data).split(b"\n"), False
        self._rest = lines.pop()
        for line in lines:
            place = _POSITION.fullmatch(line)  # where nobody reads for long, the port is full, and lines are cut off
            if place is not None:
                x, y, z = map(float, place.groups())
                self._place = (x, y, z)
                fresh = True
        return fresh

    def write(self, command: Record) -> None:
        """Send the force."""
        if self._line >= 0:
            os.write(self._line, f"F {float(command['wrench'][2]):.3f}\n".encode())
