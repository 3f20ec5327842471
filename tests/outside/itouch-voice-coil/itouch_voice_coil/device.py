"""The device 'voice-coil': a mass on a spring that a current shakes, with an accelerometer, on a serial line."""

import math
from dataclasses import dataclass

from itouch.plugin import Channel, Device, Emulation, Field, Timing, Twin, current, schema
from itouch_voice_coil.emulator import VoiceCoilEmulator
from itouch_voice_coil.line import Line


@dataclass(frozen=True)
class VoiceCoilParams:
    """What <voice-coil:hardware .../> may hold."""

    port: str = schema.text(default="/dev/ttyUSB0", doc="serial port")
    mass: float = schema.quantity("kg", low=1e-4, high=1.0, default=8e-3, doc="moving mass")
    resonance: float = schema.quantity("Hz", low=5.0, high=400.0, default=80.0, doc="where it swings by itself")
    damping: float = schema.quantity("", low=0.01, high=0.99, default=0.3, doc="damping ratio of that swing")
    force_per_amp: float = schema.quantity("N/A", low=0.01, high=100.0, default=1.2, doc="force of one ampere")


class VoiceCoilTwin(Twin):
    """The mass on its spring; a period is solved exactly, since the current is constant within it."""

    def fields(self):
        """Return the State that the twin needs."""
        return (
            Field("place", unit="m", doc="place of the mass", show="no"),
            Field("speed", unit="m/s", doc="speed of the mass", show="no"),
            Field("acceleration", unit="m/s^2", doc="acceleration of the mass", show="no"),
        )

    def reset(self, state, rng):
        """Begin at rest."""
        for name in ("place", "speed", "acceleration"):
            state[name] = 0.0

    def step(self, state, command, touch, period):
        """Swing for a period about the place that the current holds."""
        params = self.params
        natural = 2.0 * math.pi * params.resonance
        push = params.force_per_amp / params.mass * float(command["current"][0])
        decay, turn = params.damping * natural, natural * math.sqrt(1.0 - params.damping**2)
        away, speed = float(state["place"]) - push / natural**2, float(state["speed"])
        side = (speed + decay * away) / turn
        c, s = math.cos(turn * period), math.sin(turn * period)
        fade = math.exp(-decay * period)
        place = fade * (away * c + side * s)
        speed = fade * ((side * turn - decay * away) * c - (away * turn + decay * side) * s)
        state["place"], state["speed"] = place + push / natural**2, speed
        state["acceleration"] = -2.0 * decay * speed - natural**2 * place

    def read(self, state, reading):
        """Fill every field of the reading."""
        reading["acceleration"] = state["acceleration"]
        return True


class VoiceCoil(Device):
    """A voice coil that shakes a fingertip."""

    Params, Twin = VoiceCoilParams, VoiceCoilTwin
    emulation = Emulation(Emulator=VoiceCoilEmulator)
    reads = (Channel("acceleration", 1, "m/s^2", low=(-1000.0,), high=(1000.0,), doc="acceleration of the housing"),)
    commands = (current(limit=0.5, harmless="it moves 8 g by less than a millimetre, and gives 20 mW"),)
    #: After so many seconds without a command the device lets go by itself.
    timing = Timing(watchdog=0.1)

    def open(self):
        """Open the line."""
        self._line = Line(self.params.port)
        self._acceleration = 0.0

    def close(self):
        """Close the line."""
        self._line.close()

    def read(self, reading):
        """Take the newest acceleration; False if none has come."""
        fresh = False
        for line in self._line.lines():
            if line.startswith("A "):
                self._acceleration, fresh = float(line[2:]), True
        reading["acceleration"] = self._acceleration
        return fresh

    def write(self, command):
        """Send the current, which is already limited."""
        self._line.send(f"I {float(command['current'][0]):.5f}")
