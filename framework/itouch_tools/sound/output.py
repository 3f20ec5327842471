"""Where sound goes: PulseAudio (or PipeWire in its place), ALSA, PortAudio where there is no ALSA, or nowhere.

The first two are called through their C libraries, with buffers of a length that we choose: sound played through the
window's library waits a third of a second or more in its buffers, and a tap must be heard when it happens.
PortAudio is for macOS and Windows, through the package ``sounddevice``, which includes it there.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from itouch_tools.sound.modal import RATE

#: Length [s] of the buffer asked of the sound server or card, which need not grant it exactly.
BUFFER = 0.030
_SAMPLE = 2  # bytes


class Output(Protocol):
    """What plays samples: 48 kHz, 16 bit little-endian, mono."""

    name: str

    def write(self, samples: bytes) -> None:
        """Queue samples behind those already written; wait while the buffer is full.  Raise OSError if it can't."""

    def latency(self) -> float:
        """Return how long [s] from now the next sample will be heard."""

    def close(self) -> None:
        """Play what was written, and end."""


class Silence:
    """Takes samples in real time and plays nothing."""

    name = "silent"

    def __init__(self) -> None:
        self._until = time.monotonic()

    def write(self, samples: bytes) -> None:
        """Wait as long as the samples last."""
        now = time.monotonic()
        self._until = max(self._until, now - BUFFER) + len(samples) / (_SAMPLE * RATE)
        time.sleep(max(0.0, self._until - now - BUFFER))

    def latency(self) -> float:
        """Return how far [s] the samples taken are ahead of real time."""
        return max(0.0, self._until - time.monotonic())

    def close(self) -> None:
        """Do nothing."""


class _Spec(ctypes.Structure):
    _fields_ = (("format", ctypes.c_int), ("rate", ctypes.c_uint32), ("channels", ctypes.c_uint8))


class _Buffering(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_uint32) for name in ("maxlength", "tlength", "prebuf", "minreq", "fragsize"))


class Pulse:
    """A stream to the user's PulseAudio, or to PipeWire in its place, through the library ``libpulse-simple``."""

    name = "PulseAudio"

    def __init__(self) -> None:
        library = ctypes.CDLL("libpulse-simple.so.0")
        library.pa_simple_new.restype = ctypes.c_void_p
        library.pa_simple_get_latency.restype = ctypes.c_uint64
        self._library, self._error = library, ctypes.c_int(0)
        spec = _Spec(3, RATE, 1)  # 16 bit little-endian
        unset, buffer = 0xFFFFFFFF, int(BUFFER * RATE) * _SAMPLE
        attributes = _Buffering(2 * buffer, buffer, _SAMPLE, buffer // 4, unset)
        self._stream = ctypes.c_void_p(
            library.pa_simple_new(
                None, b"itouch-py", 1, None, b"session", ctypes.byref(spec), None, ctypes.byref(attributes),
                ctypes.byref(self._error),
            )
        )  # fmt: skip
        if not self._stream:
            raise OSError(self._error.value, "there is no PulseAudio")

    def write(self, samples: bytes) -> None:
        """Play samples."""
        if self._library.pa_simple_write(
            self._stream, samples, ctypes.c_size_t(len(samples)), ctypes.byref(self._error)
        ):
            raise OSError(self._error.value, "PulseAudio has gone")

    def latency(self) -> float:
        """Return the latency [s] that the server reports."""
        return float(self._library.pa_simple_get_latency(self._stream, ctypes.byref(self._error))) * 1e-6

    def close(self) -> None:
        """Play what was written, and end."""
        self._library.pa_simple_drain(self._stream, ctypes.byref(self._error))
        self._library.pa_simple_free(self._stream)


class Alsa:
    """The card that ALSA calls ``default``, through the library ``libasound``."""

    name = "ALSA"

    def __init__(self) -> None:
        library = ctypes.CDLL("libasound.so.2")
        for function in ("snd_pcm_writei", "snd_pcm_recover", "snd_pcm_delay"):
            getattr(library, function).restype = ctypes.c_long
        self._library, self._stream = library, ctypes.c_void_p()
        with _quiet(library):
            code = library.snd_pcm_open(ctypes.byref(self._stream), b"default", 0, 0)
            if code < 0:
                raise OSError(-code, "there is no sound card")
            code = library.snd_pcm_set_params(
                self._stream, 2, 3, 1, RATE, 1, ctypes.c_uint(round(BUFFER * 1e6))
            )  # 16 bit little-endian, interleaved
        if code < 0:
            library.snd_pcm_close(self._stream)
            raise OSError(-code, "the sound card plays no 48 kHz")

    def write(self, samples: bytes) -> None:
        """Play samples."""
        count = len(samples) // _SAMPLE
        written = self._library.snd_pcm_writei(self._stream, samples, ctypes.c_ulong(count))
        if written < 0 and self._library.snd_pcm_recover(self._stream, ctypes.c_int(int(written)), 1) < 0:
            raise OSError(int(-written), "the sound card has gone")

    def latency(self) -> float:
        """Return how much sound [s] is waiting in the card's buffer."""
        waiting = ctypes.c_long(0)
        self._library.snd_pcm_delay(self._stream, ctypes.byref(waiting))
        return max(0.0, waiting.value / RATE)

    def close(self) -> None:
        """Play what was written, and end."""
        self._library.snd_pcm_drain(self._stream)
        self._library.snd_pcm_close(self._stream)


class PortAudio:
    """The system's default output, through PortAudio (Core Audio, WASAPI, JACK and others).

    Raises
    ------
    OSError
        If there is no ``sounddevice``, no PortAudio, no output, or none that plays 48 kHz.
    """

    name = "PortAudio"

    def __init__(self) -> None:
        try:
            import sounddevice
        except ImportError as error:
            raise OSError(errno.ENOENT, "there is no sounddevice") from error
        self._refused = sounddevice.PortAudioError  # which is not an OSError
        try:
            self._stream: Any = sounddevice.RawOutputStream(samplerate=RATE, channels=1, dtype="int16", latency=BUFFER)
            self._stream.start()
        except (sounddevice.PortAudioError, ValueError) as error:
            raise OSError(errno.ENODEV, f"there is no sound by PortAudio: {error}") from error

    def write(self, samples: bytes) -> None:
        """Play samples."""
        try:
            self._stream.write(samples)  # after an underrun the sound is late, as with the other outputs
        except self._refused as error:
            raise OSError(errno.EIO, f"PortAudio has gone: {error}") from error

    def latency(self) -> float:
        """Return the latency [s] that PortAudio reports for its buffers and the system's."""
        return float(self._stream.latency)

    def close(self) -> None:
        """Play what was written, and end."""
        with contextlib.suppress(self._refused):  # it may have gone meanwhile
            self._stream.stop()
            self._stream.close()


@contextlib.contextmanager
def _quiet(library: Any) -> Iterator[None]:
    """Keep the library from writing to the terminal that cards are missing."""
    handler = ctypes.CFUNCTYPE(None)(lambda: None)  # it is called with more arguments than it takes, which C allows
    library.snd_lib_error_set_handler(handler)
    try:
        yield
    finally:
        library.snd_lib_error_set_handler(None)


def backends() -> tuple[Callable[[], Output], ...]:
    """Return the outputs to try on this system, in this order.

    Where ALSA is installed PortAudio is not tried: it would use ALSA in turn, and V19.6 ends the whole program where
    ALSA's configuration is missing.
    """
    try:
        ctypes.CDLL("libasound.so.2")
    except OSError:
        return Pulse, PortAudio
    return Pulse, Alsa


def open_output(kinds: tuple[Callable[[], Output], ...] | None = None) -> Output:
    """Return the first of these outputs (default: those of ``backends``) that opens on this machine, or silence."""
    for kind in backends() if kinds is None else kinds:
        with contextlib.suppress(OSError, AttributeError):
            return kind()
    return Silence()
