"""The simulated chip: input voltages and bytes in, current and bytes out, in periods of 50 microseconds."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from itouch.plugin import DeviceError
from itouch_thermal.chip.program import Built

#: Periods of the bridge in a millisecond; channels of the converter; kinds of reset.
SLOTS_PER_MS, CHANNELS, RESETS = 20, 8, ("brown-out", "reset", "power")


class Circuit(ctypes.Structure):
    """Bridge, filter and module at the pins: V, ohm, H, F, V/A; noise (rms) and ``volts`` of inputs; thermal voltage.

    NaN in ``volts`` marks the current amplifier's input, which the simulated circuit drives.
    """

    _fields_ = (
        ("supply", ctypes.c_double), ("resistance", ctypes.c_double), ("inductance", ctypes.c_double),
        ("capacitance", ctypes.c_double), ("sense", ctypes.c_double), ("noise", ctypes.c_double),
        ("thermal", ctypes.c_double), ("volts", ctypes.c_double * CHANNELS),
    )  # fmt: skip


class _Told(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_double) for name in ("current", "square", "duty", "enabled", "resets"))


class Run(NamedTuple):
    """Means over a run: current [A], its square [A2], duty, share of time with the bridge on; resets so far; bytes."""

    current: float
    square: float
    duty: float
    enabled: float
    resets: int
    said: bytes


class Chip:
    """A chip with the program loaded, at power-on.

    Parameters
    ----------
    built
        Program and simulator.
    seed
        Seed of the noise at the inputs.
    baud
        The host's baud rate.
    """

    def __init__(self, built: Built, *, seed: int = 0, baud: float = 250000.0) -> None:
        self._library = _library(str(built.chip))
        self._chip = self._library.chip_new(str(built.program).encode(), seed, baud)
        if not self._chip:
            raise DeviceError(f"the simulator cannot load {built.program}")
        self._told = _Told()

    def close(self) -> None:
        """Discard the chip."""
        chip, self._chip = self._chip, None
        if chip:
            self._library.chip_free(chip)

    def run(self, circuit: Circuit, heard: bytes = b"", *, slots: int = SLOTS_PER_MS) -> Run:
        """Run for some periods of the bridge (50 us each) with the bytes received.

        Raises
        ------
        RuntimeError
            If the chip has executed an invalid instruction.
        """
        told = self._told
        count = self._library.chip_run(self._chip, slots, circuit, heard, len(heard), told)
        if count < 0:
            raise RuntimeError("the simulated chip has crashed")
        said = b""
        if count:
            buffer = ctypes.create_string_buffer(count)
            self._library.chip_said(self._chip, buffer)
            said = buffer.raw
        return Run(told.current, told.square, told.duty, told.enabled, int(told.resets), said)

    def reset(self, how: str) -> None:
        """Reset the chip: "brown-out", "reset" or "power"; its EEPROM keeps its contents."""
        self._library.chip_reset(self._chip, RESETS.index(how))

    def hang(self, *, interrupts: bool) -> None:
        """Let its program hang, with or without interrupts."""
        self._library.chip_hang(self._chip, int(interrupts))

    def stop_converter(self) -> None:
        """Stop its analogue-to-digital converter."""
        self._library.chip_stop_converter(self._chip)


def circuit(volts: Sequence[float] = (), **values: float) -> Circuit:
    """Return a circuit; inputs that are not given are at half the reference, and the fourth is the current's."""
    made = Circuit(12.0, 1.95, 200e-6, 235e-6, 0.75, 2.4e-3, 0.0)
    for name, value in values.items():
        setattr(made, name, value)
    made.volts[:] = [*volts, *([2.5] * (CHANNELS - len(volts)))]
    made.volts[3] = math.nan
    return made


def _library(path: str) -> Any:
    library = ctypes.CDLL(path)
    library.chip_new.restype = ctypes.c_void_p
    library.chip_new.argtypes = (ctypes.c_char_p, ctypes.c_uint32, ctypes.c_double)
    library.chip_run.argtypes = (
        ctypes.c_void_p, ctypes.c_int, ctypes.POINTER(Circuit), ctypes.c_char_p, ctypes.c_int, ctypes.POINTER(_Told)
    )  # fmt: skip
    library.chip_said.argtypes = (ctypes.c_void_p, ctypes.c_char_p)
    library.chip_reset.argtypes = library.chip_hang.argtypes = (ctypes.c_void_p, ctypes.c_int)
    library.chip_free.argtypes = library.chip_stop_converter.argtypes = (ctypes.c_void_p,)
    return library
