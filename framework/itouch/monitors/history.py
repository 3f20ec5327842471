"""The latest readings of a plate: temperature and flux, with the times of their measurement, as a ring in State."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from itouch.monitors.thresholds import READINGS
from itouch.plugin import Field, Record

if TYPE_CHECKING:
    from itouch.monitors import history_kernels


class History:
    """Keeps rows of time, temperature, and the integrals of temperature and |flux| so far, for looking back.

    The arithmetic is in ``history_kernels``.

    Parameters
    ----------
    windows
        How far to look back [s]; each window has a pointer of its own, so that looking back takes a step or two.
    """

    def __init__(self, windows: Sequence[float]) -> None:
        self._windows = tuple(windows)

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (
            Field("samples", "i8", low=0, unit="1", doc="readings taken since the device was away"),
            Field(
                "history",
                "f8",
                (READINGS, 4),
                unit="mixed",
                doc="time, temperature, and integrals of it and of the flux",
            ),  # fmt: skip
            Field("flux", unit="W/m^2", doc="the newest magnitude of the flux"),
            Field("tails", "i8", len(self._windows), low=0, unit="1", doc="where each window begins"),
        )

    def forget(self, state: Record) -> None:
        """Forget all readings."""
        state["samples"][...] = 0
        state["tails"][:] = 0

    def past(self, state: Record) -> history_kernels.Past:
        """Return the readings, for compiled code."""
        from itouch.monitors.history_kernels import Past  # here, so that the compiler is loaded only if a device runs

        samples, flux = state["samples"].reshape(1), state["flux"].reshape(1)
        return Past(samples, state["history"], flux, state["tails"], np.array(self._windows))
