"""Measurements of the contact solvers: their error against a second inversion, and their run time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from contact_heat.batch import LockStep, solve_many
from contact_heat.contact import Contact
from contact_heat.contour import talbot
from contact_heat.differences import solve_differences
from contact_heat.energy import energy_balance
from contact_heat.exact import side_waves, solve_exactly, start_numbers
from contact_heat.layers import Initial, Layer
from contact_heat.modes import solved_modes
from contact_heat.packing import cached_side_model, pair_of
from contact_heat.peers import method_of_lines
from contact_heat.stack import Array
from contact_heat.stepper import Stepper

PERIOD = 1e-3

#: Integrator, first cell [m], growth of cells, rtol: the obvious mesh, a graded one, and the best one found.
_PEERS = (("BDF", 1e-4, 1.0, 1e-6), ("BDF", 1e-6, 1.1, 1e-3), ("Radau", 1e-7, 1.02, 1e-6))
#: Half the spacing takes eight times as long: it is skipped if the first takes longer than this [s].
_LONG = 1.0


@dataclass(frozen=True, slots=True)
class Row:
    """One measurement: errors relative to max(|j|, 1 W/m2) from 10 us and from 1 ms on, cost and its unit."""

    case: str
    method: str
    error_10us: float | None = None
    error_1ms: float | None = None
    cost: float | None = None
    unit: str = ""
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the row for a JSON file."""
        return asdict(self)


def best_of(work: Callable[[], object], passes: int = 5) -> float:
    """Return the shortest time of several passes [s]; the first call, which may compile, does not count."""
    work()
    times = []
    for _ in range(passes):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def second_opinion(contact: Contact, times: Array) -> Array:
    """Return the contact flux [W/m2] by other formulas on another contour: those of `fields`, with 34 nodes.

    ``times`` has shape (times,) [s], as has the flux.
    """
    z, weights = talbot(34)
    points = (z / times[:, None]).ravel()
    finger, body = side_waves(contact.finger, points), side_waves(contact.object, points)
    warm, cold, warm_flux, cold_flux, resistance = start_numbers(contact)
    gap = warm - cold + finger.surface - body.surface - finger.impedance * warm_flux + body.impedance * cold_flux
    flux = (gap / (finger.impedance + body.impedance + resistance)).reshape(len(times), len(z))
    return np.asarray((weights / z * flux).real.sum(axis=1))


def relative_error(flux: Array, reference: Array) -> Array:
    """Return errors relative to max(|j|, 1 W/m2).

    ``flux`` and ``reference`` [W/m2] have the same shape (...,), and so have the errors [1].
    """
    return np.abs(flux - reference) / np.maximum(np.abs(reference), 1.0)


def case_rows(name: str, contact: Contact, *, peers: bool) -> Iterator[Row]:
    """Measure every method on one case."""
    yield from _exact_rows(name, contact)
    yield from _live_rows(name, contact)
    yield from _paper_rows(name, contact)
    if peers:
        yield from _peer_rows(name, contact)


def _exact_rows(name: str, contact: Contact) -> Iterator[Row]:
    times = np.geomspace(1e-5, 100.0, 71)
    error = relative_error(solve_exactly(contact, times).flux, second_opinion(contact, times))
    cost = best_of(lambda: solve_exactly(contact, times)) / len(times) * 1e6
    note = "against a second contour and other formulas; to 100 s"
    yield Row(name, "exact", float(error.max()), float(error[times >= 1e-3].max()), cost, "us/point", note)
    found = solve_exactly(contact, times)
    try:
        residual = max(float(energy_balance(found, side).residual.max()) for side in ("finger", "object"))
    except ValueError as error_:
        yield Row(name, "exact: energy balance", note=str(error_))
    else:
        yield Row(name, "exact: energy balance", residual, note="stored - contact + back - blood, of the largest")


def _live_rows(name: str, contact: Contact) -> Iterator[Row]:
    steps = np.unique(np.round(np.geomspace(1, 10_000, 60)).astype(int))
    reference = solve_exactly(contact, steps * PERIOD).flux
    flux = Stepper(contact, PERIOD).advance(contact.resistance, 10_000)[steps - 1]
    error = float(relative_error(flux, reference).max())
    cost = _stepping(contact, np.full(100_000, contact.resistance))
    yield Row(name, "live, constant resistance", None, error, cost, "ns/step", "1 ms, compiled loop, 100 s")
    resistances = changing(max(contact.resistance, 1e-5), 1000)
    error_by_step = relative_error(Stepper(contact, PERIOD).advance(resistances), fine(contact, resistances, 10))
    parts = [float(error_by_step[part].max()) for part in (slice(0, None), slice(5, None), slice(20, None))]
    cost = _stepping(contact, np.tile(resistances, 10))
    note = f"20 Hz +-30 %; from 5 ms {parts[1]:.0e}, from 20 ms {parts[2]:.0e}; against 0.1 ms steps"
    yield Row(name, "live, changing resistance", None, parts[0], cost, "ns/step", note)
    stepper = Stepper(contact, PERIOD)
    values = iter(np.tile(resistances, 100).tolist())
    cost = best_of(lambda: [stepper.step(next(values)) for _ in range(1000)]) / 1000 * 1e6
    yield Row(name, "live, one step from Python", cost=cost, unit="us/step")
    yield build_row(name, contact)


def build_row(name: str, contact: Contact) -> Row:
    """Measure how long the live model of a contact takes to build."""
    note = f"{len(contact.finger.layers)} + {len(contact.object.layers)} layers"
    return Row(name, "live, model build", cost=_build_time(contact) * 1e3, unit="ms", note=note)


def _stepping(contact: Contact, resistances: Array) -> float:
    stepper = Stepper(contact, PERIOD)
    start = stepper.state.copy()

    def work() -> None:
        stepper.state = start
        stepper.advance(resistances)

    return best_of(work) / len(resistances) * 1e9


def changing(resistance: float, steps: int) -> Array:
    """Return a resistance that oscillates by 30 % at 20 Hz, shape (steps,)."""
    return np.asarray(resistance * (1.0 + 0.3 * np.sin(2.0 * np.pi * 20.0 * PERIOD * np.arange(1, steps + 1))))


def fine(contact: Contact, resistances: Array, parts: int) -> Array:
    """Divide each step of a history into parts; return the flux at the ends of whole steps, shape (steps,).

    ``resistances`` has shape (steps,) [K m2/W]; the flux is in [W/m2].
    """
    before = np.concatenate((resistances[:1], resistances[:-1]))
    shares = np.arange(1, parts + 1) / parts
    history = before[:, None] + (resistances - before)[:, None] * shares
    return Stepper(contact, PERIOD / parts).advance(history.ravel())[parts - 1 :: parts]


def _build_time(contact: Contact) -> float:
    def build() -> None:
        for cached in (solved_modes, cached_side_model, pair_of):
            cached.cache_clear()
        Stepper(contact, PERIOD)

    return best_of(build, 9)


def _paper_rows(name: str, contact: Contact) -> Iterator[Row]:
    times = np.geomspace(1e-5, 10.0, 61)
    reference = solve_exactly(contact, times).flux
    for spacing in (1e-4, 5e-5):
        longest = 0.0
        for split in (True, False):
            begin = time.perf_counter()
            flux = solve_differences(contact, times, spacing=spacing, split=split).flux
            cost = time.perf_counter() - begin
            longest = max(longest, cost)
            method = f"paper, {spacing * 1e6:.0f} um" + ("" if split else ", not split")
            yield _timed_row(name, method, times, flux, reference, cost)
        if longest > _LONG:
            return


def order_rows(name: str, contact: Contact) -> Iterator[Row]:
    """Measure the scheme's orders of convergence from three meshes and three time steps, in the skin temperature."""
    meshes = [solve_differences(contact, [5.0], spacing=spacing, step=5e-4) for spacing in (1e-4, 5e-5, 2.5e-5)]
    steps = [solve_differences(contact, [5.0], spacing=1e-4, step=step) for step in (0.02, 0.01, 0.005)]
    for what, theory, found in (("space", 2, meshes), ("time", 1, steps)):
        first, second = np.diff([solution.skin_temperature[0] for solution in found])
        order = float(np.log2(abs(first / second)))
        yield Row(name, f"paper, observed order in {what}", cost=order, note=f"theory: {theory}")


def _peer_rows(name: str, contact: Contact) -> Iterator[Row]:
    times = np.geomspace(1e-5, 10.0, 61)
    reference = solve_exactly(contact, times).flux
    for integrator, first, growth, rtol in _PEERS:
        begin = time.perf_counter()
        flux = method_of_lines(contact, times, first=first, growth=growth, rtol=rtol, integrator=integrator)
        cost = time.perf_counter() - begin
        mesh = f"{first * 1e6:g} um" + (f" x{growth:g}" if growth > 1.0 else " equal")
        yield _timed_row(name, f"scipy {integrator} {rtol:g}, {mesh}", times, flux, reference, cost)


def _timed_row(name: str, method: str, times: Array, flux: Array, reference: Array, cost: float) -> Row:
    error = relative_error(flux, reference)
    return Row(name, method, float(error.max()), float(error[times >= 1e-3].max()), cost, "s", "10 s of contact")


def batch_rows(contact: Contact, count: int = 1000) -> Iterator[Row]:
    """Measure batches of variants of one case: with other temperatures and resistances, and with other materials."""
    rng = np.random.default_rng(1)
    times = np.linspace(0.1, 10.0, 100)
    batches = {"temperatures": _tempered(contact, rng, count), "materials": _made_of(contact, rng, count)}
    for what, batch in batches.items():
        rate = count / best_of(partial(solve_many, batch, times, workers=1), 3)
        yield Row("batch", f"exact, {count} {what}", cost=rate, unit="contacts/s/core", note="100 times in 10 s")
    contacts = _tempered(contact, rng, count)
    together = LockStep(contacts, PERIOD, workers=1)
    resistances = np.array([one.resistance for one in contacts])
    rate = count * 1e4 / best_of(partial(together.advance, resistances, 10_000, every=100), 2)
    yield Row("batch", f"lock-step, {count} contacts", cost=rate, unit="contact-steps/s/core", note="1 ms")


def _tempered(contact: Contact, rng: np.random.Generator, count: int) -> list[Contact]:
    found = []
    for _ in range(count):
        start = Initial(kind="uniform", temperature=float(rng.uniform(278.0, 318.0)))
        body = replace(contact.object, initial=start)
        found.append(replace(contact, object=body, resistance=float(rng.uniform(0.0, 5e-3))))
    return found


def _made_of(contact: Contact, rng: np.random.Generator, count: int) -> list[Contact]:
    found = []
    for _ in range(count):
        bulk = Layer(
            thickness=0.02,
            conductivity=float(np.exp(rng.uniform(np.log(0.03), np.log(300.0)))),
            density=float(rng.uniform(50.0, 8000.0)),
            specific_heat=float(rng.uniform(400.0, 3000.0)),
        )
        layers = (*contact.object.layers[:-1], bulk)
        found.append(replace(contact, object=replace(contact.object, layers=layers)))
    return found
