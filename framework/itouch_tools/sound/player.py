"""Plays a session's sound through the machine's card; silent, and without a word, where there is none.

Latency, from a published State to the ear: the next frame of the window (17 ms at 60 Hz), the block that is being made
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

#: Samples that are made at once: 10 ms, in which this thread must get its turn beside the window's.
BLOCK = RATE // 100
#: Blocks between two looks at the output's latency.
_LOOK = 8
#: Most sound [s] that an output may have taken before its time.
_AHEAD = 0.25
#: Seconds that ``close`` waits for what is in the buffer.
_PATIENCE = 1.0


class Speaker:
    """Hears States and plays them, in a thread of its own.

    Parameters
    ----------
    model
        What the States are of.
    mute
        Play nothing, and open no device.
    output
        Opens what is played to; default: the machine's sound.
    """

    def __init__(self, model: Model, *, mute: bool = False, output: Callable[[], Output] = open_output) -> None:
        self._synth, self._open = Synth(model), output
        self._lock, self._closing = threading.Lock(), threading.Event()
        #: Whether nothing is to be heard: asked for, or there is no card.
        self.muted = mute
        #: Whether a person has turned it off; what plays goes on unheard, and comes back where it is then.
        self.hushed = False
        self._gain = 1.0
        #: What plays: empty until it is open.
        self.driver = ""
        #: Blocks played, and how long [s] before it is heard the last one was made.
        self.blocks, self.ahead = 0, 0.0
        #: Host time [s] at which the last State that had something new was told, and at which its sound was made.
        self.heard = self.made = 0.0
        self._thread = threading.Thread(target=self._play, name="sound", daemon=True)
        if not mute:
            self._thread.start()

    def hear(self, state: Record) -> None:
        """Take note of a State."""
        with self._lock:
            self._synth.hear(state)
            self.heard = time.perf_counter()

    def turn(self) -> str:
        """Turn it off or on again; return what to say of it."""
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
            if early > 0.0:  # it takes all that it is given, as a device that is none may
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
        """Play a block; where the sound goes away, go on in silence."""
        try:
            output.write(np.round(samples * 32767).astype("<i2").tobytes())
            if self.blocks % _LOOK == 0:
                self.ahead = output.latency()
        except OSError:
            output = Silence()
            self._name(output)
        self.blocks += 1
        return output
