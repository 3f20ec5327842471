"""Many contacts at once: exact solutions that share impedances, and stepping in lock-step.

Contacts that differ only in temperatures and resistance share the impedances of their sides, which are most of the
work; a quotient per node remains for each.  In lock-step at constant resistance the amplitudes are stored with one row
per mode and one column per contact, and blocks of columns stay in the cache for all steps.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from contact_heat.casefile import check_times
from contact_heat.contact import Contact
from contact_heat.contour import Complex
from contact_heat.exact import NO_DRIVE, start_numbers
from contact_heat.hosting import nogil_kernel
from contact_heat.laplace import NODES, combine, side_table, warmed_table
from contact_heat.layers import Side
from contact_heat.stack import Array, imbalance, stack_of
from contact_heat.stepper import Stepper

Part = TypeVar("Part")

_BLOCK = 64


@dataclass(frozen=True, slots=True, eq=False)
class BatchSolution:
    """Exact solutions of many contacts; ``times`` [s] has shape (times,), the other arrays (contacts, times).

    ``flux`` [W/m2], ``skin_temperature`` and ``object_temperature`` [K], ``heat`` [J/m2].
    """

    times: Array
    flux: Array
    skin_temperature: Array
    object_temperature: Array
    heat: Array


def solve_many(contacts: Sequence[Contact], times: ArrayLike, *, workers: int | None = None) -> BatchSolution:
    """Evaluate many contacts exactly at the same times.

    Parameters
    ----------
    contacts
        The problems.
    times
        Times in ascending order, greater than 0 [s], shape (times,).
    workers
        Threads; by default one per core.

    Raises
    ------
    ValueError
        If times or workers are out of range.
    """
    moments = np.atleast_1d(np.array(times, dtype=np.float64))
    check_times(moments)
    threads = _threads(workers)
    out = np.empty((4, len(contacts), len(moments)))
    shared = _Tables(contacts, moments)
    chunks = [range(first, len(contacts), threads) for first in range(min(threads, len(contacts)))]

    def work(chunk: range) -> None:
        transforms = np.empty((len(moments), NODES), dtype=np.complex128)
        for n in chunk:
            contact = contacts[n]
            tables = [shared.table(side) for side in (contact.finger, contact.object)]
            drives = [shared.drive(side) for side in (contact.finger, contact.object)]
            numbers = start_numbers(contact)
            flux, heat, skin, face = out[:, n]
            combine(tables[0], tables[1], drives[0], drives[1], numbers, moments, flux, heat, skin, face, transforms)

    _run(work, chunks)
    return BatchSolution(moments, out[0], out[2], out[3], out[1])


class _Tables:
    """Impedances of sides, stored if more than one contact needs them."""

    def __init__(self, contacts: Sequence[Contact], times: Array) -> None:
        self._times = times
        counts = Counter((side.layers, side.back) for pair in contacts for side in (pair.finger, pair.object))
        self._shared = {key for key, count in counts.items() if count > 1}
        self._tables: dict[object, Complex] = {}
        self._drives: dict[object, tuple[Complex, Complex]] = {}

    def table(self, side: Side) -> Complex:
        key = (side.layers, side.back)
        if key not in self._shared:
            return side_table(stack_of(side), self._times)
        if key not in self._tables:
            self._tables[key] = side_table(stack_of(side), self._times)
        return self._tables[key]

    def drive(self, side: Side) -> Complex:
        temperatures = imbalance(side)
        if temperatures is None:
            return NO_DRIVE
        key = (side.layers, side.back)
        if key not in self._drives:
            if key not in self._shared:
                return warmed_table(stack_of(side), temperatures, self._times)
            units = ((1.0, 0.0), (0.0, 1.0))
            one, other = (warmed_table(stack_of(side), unit, self._times) for unit in units)
            self._drives[key] = (one, other)
        blood, back = self._drives[key]
        return np.asarray(temperatures[0] * blood + temperatures[1] * back)


class LockStep:
    """Steps many contacts together.

    Parameters
    ----------
    contacts
        The problems; their own resistances are ignored.
    period
        Step [s], 1 us to 1 s.
    workers
        Threads; by default one per core.
    """

    def __init__(self, contacts: Sequence[Contact], period: float, *, workers: int | None = None) -> None:
        self._threads = _threads(workers)
        self.steppers = [Stepper(contact, period) for contact in contacts]

    def advance(self, resistances: ArrayLike, steps: int | None = None, *, every: int = 1) -> Array:
        """Advance all contacts; return the flux [W/m2] after every ``every`` steps, shape (outputs, contacts).

        Parameters
        ----------
        resistances
            Shape (contacts,): constant over ``steps``, finite; or shape (steps, contacts): as for `Stepper.advance`.
        steps
            Number of steps, for constant resistances.
        every
            Steps per output; it must divide the number of steps.

        Raises
        ------
        ValueError
            If shapes or values do not match.
        """
        given = np.array(resistances, dtype=np.float64)
        if given.ndim not in (1, 2) or given.shape[-1] != len(self.steppers):
            raise ValueError(f"resistances: shape {given.shape} does not fit {len(self.steppers)} contacts")
        count = steps if given.ndim == 1 else len(given)
        if count is None or count < 1 or every < 1 or count % every:
            raise ValueError(f"steps = {count!r}: needs to be a positive multiple of every = {every}")
        if given.ndim == 2:
            return np.stack([s.advance(given[:, n])[every - 1 :: every] for n, s in enumerate(self.steppers)], axis=1)
        if not np.all((given >= 0.0) & (given < np.inf)):
            raise ValueError("resistances: constant ones must be 0 or more and finite")
        flux = np.empty((count // every, len(self.steppers)))
        starts = range(0, len(self.steppers), _BLOCK)
        _run(lambda first: self._block(first, given, count, every, flux), starts, self._threads)
        return flux

    def _block(self, first: int, resistances: Array, steps: int, every: int, flux: Array) -> None:
        """Step one block of contacts in the modes of their closed loops."""
        part = self.steppers[first : first + _BLOCK]
        loops = [s.settle(float(r)) for s, r in zip(part, resistances[first:], strict=False)]
        rows = max(len(loop.decay) for loop, _ in loops)
        decay, gain, amplitude = np.zeros((3, rows, len(part)))
        for n, (loop, modes) in enumerate(loops):
            decay[: len(modes), n], gain[: len(modes), n], amplitude[: len(modes), n] = loop.decay, loop.gain, modes
        steady = np.array([loop.flux for loop, _ in loops])
        out = np.empty((len(flux), len(part)))
        _lock_step(decay, gain, amplitude, steady, every, out)
        flux[:, first : first + len(part)] = out
        for n, (stepper, (_, modes)) in enumerate(zip(part, loops, strict=True)):
            stepper.resume(float(resistances[first + n]), amplitude[: len(modes), n].copy(), steps)


@nogil_kernel
def _lock_step(decay: Array, gain: Array, amplitude: Array, steady: Array, every: int, flux: Array) -> None:
    """Multiply amplitudes by their decay and sum the fluxes; all arrays of shape (modes, contacts)."""
    modes, contacts = decay.shape
    for out in range(len(flux)):
        row = flux[out]
        for _ in range(every):
            for n in range(contacts):
                row[n] = steady[n]
            for m in range(modes):
                d, g, a = decay[m], gain[m], amplitude[m]
                for n in range(contacts):
                    a[n] = (a[n] * d[n] + 1e-200) - 1e-200
                    row[n] += g[n] * a[n]


def _threads(workers: int | None) -> int:
    if workers is None:
        return os.cpu_count() or 1
    if workers < 1:
        raise ValueError(f"workers = {workers!r} is out of range: 1 or more")
    return workers


def _run(work: Callable[[Part], None], parts: Sequence[Part], threads: int | None = None) -> None:
    """Run the parts, in threads if there are several."""
    if len(parts) == 1 or threads == 1:
        for part in parts:
            work(part)
        return
    with ThreadPoolExecutor(threads or len(parts)) as pool:
        list(pool.map(work, parts))
