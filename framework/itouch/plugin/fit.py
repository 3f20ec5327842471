"""Calibrations that a device offers: from columns of measured numbers to values of its parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.moved import with_old_fields


@dataclass(frozen=True, slots=True)
class Fitted:
    """What a calibration found: parameters by their Python names (``part.name`` inside a child), and how well they fit.

    ``residual`` is the rms residual in ``unit``.  ``doubts`` are sentences on why the samples may be of something else;
    they are shown, and the result is kept all the same.
    """

    values: Mapping[str, float]
    residual: float
    unit: str
    doubts: tuple[str, ...] = ()


def _nothing(_: Any) -> str:
    return ""


@with_old_fields(lacks="missing_parameters", days="valid_days")
@dataclass(frozen=True, slots=True)
class Fit:
    """A calibration of one kind.

    Attributes
    ----------
    kind, doc
        Its name, and how the samples are taken.
    columns
        What the columns of the samples are, with their units.
    valid_days
        How long its result is valid [days].
    solve
        Takes the device's parameters and the samples, shape (n, columns), and returns the result; raises ``ValueError``
        if the samples are too few or determine nothing.
    missing_parameters
        Takes the device's parameters, and returns what they lack for this calibration; an empty string if nothing.
    """

    kind: str
    doc: str
    columns: tuple[str, ...]
    valid_days: float
    solve: Callable[[Any, NDArray[np.float64]], Fitted]
    missing_parameters: Callable[[Any], str] = _nothing


def line_through(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return slope, value at 0 and rms residual of the least-squares line y(x) through the samples x and y, both (n,).

    The slope is in the unit of y over that of x, the other two are in that of y.

    Raises
    ------
    ValueError
        If there are fewer than three samples or all have the same x.
    """
    if len(x) < 3 or np.ptp(x) <= 1e-12 * max(1.0, float(np.abs(x).max())):
        raise ValueError("a line needs three samples or more at different values")
    slope, zero = np.polyfit(x, y, 1)
    rest = y - (slope * x + zero)
    return float(slope), float(zero), float(np.sqrt(np.mean(rest * rest)))
