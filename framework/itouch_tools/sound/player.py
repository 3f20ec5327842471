"""Plays a session's sound through the machine's sound card; stays silent, without an error, where there is none.

Latency from a published State to the ear: the next frame of the window (17 ms at 60 Hz), the block being rendered
(10 ms), and the buffer of the sound server or card (30 ms): at most some 60 ms.  ``itouch-py bench sound`` measures it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.world import Model
from itouch_tools.sound.modal import RATE
from itouch_tools.sound.output import Output, Silence, open_output
from itouch_tools.sound.synth import Synth

#: Samples in a block: 10 ms, in which this thread must get its turn beside the window's.
BLOCK = RATE // 100
#: After how many blocks the output's latency is read again.
_LOOK = 8
#: How far ahead of real time [s] an output may be fed.
_AHEAD = 0.25
#: Seconds that ``close`` waits for the buffer to be played.
_PATIENCE = 1.0


class Speaker:
    """Is told States and plays their sound, in a thread of its own.

    Parameters
    ----------
    model
        The model to which the States belong.
    mute
        Play nothing, and open no device.
    output
        Opens the output; default: the machine's own.
    """

    def __init__(self, model: Model, *, mute: bool = False, output: Callable[[], Output] = open_output) -> None:
        self._synth, self._open = Synth(model), output
        self._lock, self._closing = threading.Lock(), threading.Event()
        #: Whether nothing can be heard: because it was started mute, or because there is no card.
        self.muted = mute
        #: Whether a person has muted the sound; it goes on silently, and is heard from its current point when unmuted.
        self.hushed = False
        self._gain = 1.0
        #: Name of the output that plays; empty until it is open.
        self.driver = ""
        #: Blocks played, and the output's latency [s] when it was last read.
        self.blocks, self.ahead = 0, 0.0
        #: Host time [s] of the last call of ``hear``, and at which its sound was rendered.
        self.heard = self.made = 0.0
        self._thread = threading.Thread(target=self._play, name="sound", daemon=True)
        if not mute:
            self._thread.start()

    def hear(self, state: Record) -> None:
        """Receive a State, so that its sound is played."""
        with self._lock:
            self._synth.hear(state)
            self.heard = time.perf_counter()

    def turn(self) -> str:
        """Turn the sound off, or on again; return a message that says which."""
        if self.muted:
            return "nothing is heard: it was started mute, or this machine has no sound"
        self.hushed = not self.hushed
        return "sound off; U turns it on again" if self.hushed else "sound on"

    def close(self) -> None:
        """Fade out and be silent."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(_PATIENCE)

    def _play(self) -> None:
        output = self._open()
        self._name(output)
        begin = time.monotonic()
        while not self._closing.is_set():
            output = self._put(output, self._block())
            early = self.blocks * BLOCK / RATE - (time.monotonic() - begin) - _AHEAD
            if early > 0.0:  # an output that never makes its caller wait, as a null device may do
                self._closing.wait(early)
        self._put(output, self._block() * np.linspace(1.0, 0.0, BLOCK))
        output.close()

    def _name(self, output: Output) -> None:
        self.driver, self.muted = output.name, output.name == Silence.name

    def _block(self) -> NDArray[np.float64]:
        with self._lock:
            heard, samples = self.heard, self._synth.render(BLOCK)
        gain, self._gain = self._gain, 0.0 if self.hushed else 1.0
        if gain != self._gain or gain == 0.0:  # no step: it fades within a block
            samples = samples * np.linspace(gain, self._gain, BLOCK)
        if heard > self.made:
            self.made = time.perf_counter()
        return samples

    def _put(self, output: Output, samples: NDArray[np.float64]) -> Output:
        """Play a block; where the output fails, go on in silence."""
        try:
            output.write(np.round(samples * 32767).astype("<i2").tobytes())
            if self.blocks % _LOOK == 0:
                self.ahead = output.latency()
        except OSError:
            output = Silence()
            self._name(output)
        self.blocks += 1
        return output
