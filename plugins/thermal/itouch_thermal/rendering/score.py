"""Figures of merit of a rendered contact, as the bench prints them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from itouch_thermal.display.column import Array
from itouch_thermal.rendering.closedloop import PERIOD, Run

#: Errors are relative to the desired flux, but at least to this [W/m2]: the finger's own loss at rest.
FLOOR = 200.0
#: Relative change of the flux that is noticed three times out of four, as `itouch_tools.study.observers` has it, too.
WEBER = 0.43


def errors(run: Run) -> Array:
    """Return the flux error relative to max(|desired|, FLOOR)."""
    return np.asarray((run.flux - run.desired) / np.maximum(np.abs(run.desired), FLOOR))


def rms(run: Run) -> float:
    """Return the rms error from 0.1 s on, in per cent."""
    return 100.0 * float(np.sqrt(np.mean(errors(run)[index(0.1) :] ** 2)))


def largest(run: Run, after: float) -> float:
    """Return the greatest error after a time [s], in per cent."""
    return 100.0 * float(np.abs(errors(run)[index(after) :]).max(initial=0.0))


def skin_error(run: Run, after: float = 0.0) -> float:
    """Return the greatest difference [K] of the skin from the ideal one after a time [s]."""
    return float(np.abs(run.skin - run.ideal_skin)[index(after) :].max(initial=0.0))


def told_apart(run: Run) -> float:
    """Return the probability that rendered is told from real in a two-alternative forced choice.

    Signal detection with the heat of the first second as the cue; 0.5 is chance.
    """
    first = index(1.0)
    real = abs(float(run.desired[:first].mean()))
    difference = abs(float(run.flux[:first].mean()) - float(run.desired[:first].mean())) / max(real, FLOOR)
    z = 0.6744897501960817 * difference / WEBER
    return 0.5 * (1.0 + math.erf(z / math.sqrt(2.0)))


def summary(runs: Sequence[Run]) -> dict[str, float]:
    """Return a row's figures: the worst of the runs, and the median of the rms error."""
    absolute = [float(np.sqrt(np.mean((r.flux - r.desired)[index(0.1) :] ** 2))) for r in runs]
    return {
        "rms_pct": max(rms(r) for r in runs),
        "rms_pct_median": float(np.median([rms(r) for r in runs])),
        "max_after_300ms_pct": max(largest(r, 0.3) for r in runs),
        "max_after_1s_pct": max(largest(r, 1.0) for r in runs),
        "rms_W_m2": max(absolute),
        "skin_error_max_K": max(skin_error(r) for r in runs),
        "skin_error_max_after_300ms_K": max(skin_error(r, 0.3) for r in runs),
        "skin_error_max_after_1s_K": max(skin_error(r, 1.0) for r in runs),
        "jnd_2afc": max(told_apart(r) for r in runs),
    }


def index(time: float) -> int:
    """Return the index of the first period that ends after a time [s]."""
    return round(time / PERIOD)
