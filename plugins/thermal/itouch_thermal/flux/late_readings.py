"""Readings that arrive late over a wire: the readings that were expected, kept for a while, and the corrections.

All that the estimator does not know is in its parameters, so a reading says the same about them whenever it arrives.
Therefore the expected readings and their derivatives are kept for each period.  The difference of a late reading from
the one expected at its time moves the parameters and, by its own present derivatives, the column.

In every function ``x``, ``theta``, ``cover``, ``memory``, ``past`` and ``kept`` are fields of a `law.Memory`, and
``basis`` is an `observer.Basis`.
"""

from __future__ import annotations

import math
from typing import Any

from itouch.plugin.kernels import kernel, linked
from itouch_thermal.flux import observer as at

#: Indices of ``kept``: the row to write next, how many rows still count, whether the plate is disturbed; its length.
NEXT, VALID, DISTURBED, KEPT = 0, 1, 2, 3


@kernel
def width(count: int) -> int:
    """Return how many numbers a row of ``past`` has, with ``count`` parameters.

    They are the expected reading of the flux sensor and its derivatives, the same of the film's temperature, and the
    parameters at that time.
    """
    return 2 * (1 + count) + count


@linked
def remember(x: Any, theta: Any, memory: Any, past: Any, kept: Any, column: int) -> None:
    """Keep the readings that are expected now; ``column`` is the number of modes, which precede them in a row of ``x``.

    When a disturbance of the plate begins or ends, the earlier rows no longer count: they say nothing about it now.
    """
    row, film = past[int(kept[NEXT])], x.shape[0]
    for k in range(film):
        row[k] = x[k, column + at.X_SEEN]
        row[film + k] = x[k, column + at.X_FILM]
    for k in range(theta.shape[0]):
        row[2 * film + k] = theta[k]
    kept[NEXT] = (kept[NEXT] + 1.0) % past.shape[0]
    disturbed = 1.0 if memory[at.M_TOUCHING] == 0.0 and memory[at.M_QUIET] > 0.0 else 0.0
    kept[VALID] = min(kept[VALID] + 1.0, past.shape[0]) if disturbed == kept[DISTURBED] else 1.0
    kept[DISTURBED] = disturbed


@linked
def expected(theta: Any, past: Any, kept: Any, back: int, first: int) -> Any:
    """Return the row of ``back`` periods ago, and the reading expected for then with the present parameters.

    ``first`` is where the reading stands in the row: 0 for the flux sensor, 1 + the number of parameters for the film.
    """
    row = past[(int(kept[NEXT]) - 1 - back) % past.shape[0]]
    found = row[first]
    parameters = 2 * (1 + theta.shape[0])
    for a in range(theta.shape[0]):
        found += row[first + 1 + a] * (theta[a] - row[parameters + a])
    return row, found


@kernel
def recall(
    basis: Any, learnt: Any, press: float, flux_back: int, flux: float, film_back: int, film: float, sink: float,
    since: float,
) -> None:  # fmt: skip
    """Take in readings that were measured some periods ago; those that are too old, or NaN, are left out.

    Parameters
    ----------
    basis, learnt
        The estimator as it is now, with the readings that were expected (`remember`): an `observer.Basis` and a
        `law.Memory`.
    press
        How strongly the finger is being pressed on, see `observer.observe`.
    flux_back, film_back
        How many periods ago ``flux`` [W/m2] and ``film`` [K] were measured.
    sink, since
        Reading of the sink [K], and seconds since the one before.
    """
    c, plate, past, kept = basis.c, basis.plate, learnt.past, learnt.kept
    x, theta, cover, gain, memory = learnt.x, learnt.theta, learnt.cover, learnt.gain, learnt.memory
    column = basis.tissue.shape[1] + plate.shape[1]  # modes, which precede the readings in a row of ``x``
    if sink == sink:
        memory[at.M_SINK] += min(1.0, at.SINK_RATE * since) * (sink - memory[at.M_SINK_SEEN])
    row, seen = expected(theta, past, kept, flux_back, 0)
    counts = flux_back < kept[VALID]
    if memory[at.M_TOUCHING] == 0.0:
        if counts and abs(flux - seen) > 6.0 * c[at.O_FLUX_NOISE] + 0.3 * abs(seen):
            memory[at.M_QUIET] = at.quiet(c)
        if memory[at.M_QUIET] > 0.0:
            _follow(c, plate, x, theta, memory, past, kept, film_back, film, column)
            return
    if counts and abs(flux) < c[at.O_CEILING] and abs(seen) < c[at.O_CEILING]:
        doubt = at.DOUBT * math.sqrt(min(1.0, press)) * abs(x[0, column + at.X_FLUX])
        way = c[at.O_LAGS] * (x[0, column + at.X_FLUX] - seen) if memory[at.M_TOUCHING] > 0.0 else 0.0
        noise = math.sqrt(c[at.O_FLUX_NOISE] ** 2 + doubt * doubt + way * way)
        at.correct(x, theta, cover, gain, row[1 : x.shape[0]], -1, flux - seen, noise)
    if film == film and film_back < kept[VALID]:
        row, seen = expected(theta, past, kept, film_back, x.shape[0])
        slopes = row[x.shape[0] + 1 : 2 * x.shape[0]]
        at.correct(x, theta, cover, gain, slopes, at.OFFSET, film - seen - theta[at.OFFSET], c[at.O_PLATE_NOISE])


@linked
def _follow(
    c: Any, plate: Any, x: Any, theta: Any, memory: Any, past: Any, kept: Any, back: int, film: float, column: int
) -> None:
    """Move a disturbed plate towards a late reading of its film, and all readings that were expected by as much."""
    if not (film == film and kept[DISTURBED] > 0.0 and back < kept[VALID]):
        return
    row = past[(int(kept[NEXT]) - 1 - back) % past.shape[0]]
    first = x.shape[0]
    for k in range(first):
        miss = at.missed(k, film, theta, row[first + k])
        past[:, first + k] += at.follow(c, plate, x[k], memory[at.M_UNSEEN], miss, column)
    memory[at.M_UNSEEN] = 0.0


@kernel
def estimate(x: Any, cover: Any, column: int) -> Any:
    """Return the estimated contact flux [W/m2], and its standard deviation by the parameters' covariance."""
    total = 0.0
    for a in range(cover.shape[0]):
        for b in range(cover.shape[0]):
            total += x[1 + a, column + at.X_FLUX] * cover[a, b] * x[1 + b, column + at.X_FLUX]
    return x[0, column + at.X_FLUX], math.sqrt(max(0.0, total))
