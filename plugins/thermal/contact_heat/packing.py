"""Flat models and states of the live solver: the arrays that the compiled steps work on.

A model is one read-only array: a head, then rows of ``size`` numbers (decay, port, stationary rise; memory and drive of
every stage; real and imaginary kernel of every node), then the matrix of the stages and the impedance at the nodes.  A
state has ``size`` numbers: the mode coordinates and, from ``model[TAIL]`` on, `TAIL_LENGTH` numbers that the steps of
the modes leave alone, since they take the place of modes that neither decay nor reach the contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from contact_heat import collocation
from contact_heat.blas import one_thread
from contact_heat.contour import Z
from contact_heat.dot_product import padded
from contact_heat.hosting import building
from contact_heat.layers import FINGER_FILM, ROOM, Film, Side
from contact_heat.modes import Modes, side_modes
from contact_heat.stack import Array, imbalance, stack_of
from contact_heat.steady import initial_profile, resting_profile

#: Indices in the head: state size, period [s], contact temperature [K] of the resting field, film coefficient [W/m2K],
#: ambient temperature [K], start of the tail.
SIZE, PERIOD, REST, FILM, AMBIENT, TAIL = range(6)
HEAD = 16

#: The tail of a state: phase (steps since a touch, negative apart), last resistance [K m2/W], and heat taken in
#: through the contact [J/m2].
PHASE, RESISTANCE, HEAT = range(3)
TAIL_LENGTH = 3

STAGES = collocation.STAGES
NODES = len(Z)
#: First row of each kind.
DECAY, PORT, RISE, MEMORY, DRIVE, KERNEL = 0, 1, 2, 3, 3 + STAGES, 3 + 2 * STAGES
ROWS = KERNEL + 2 * NODES


def side_pack(modes: Modes, period: float, *, rest: float, film: Film | None) -> Array:
    """Return the flat model of a side for steps of ``period`` [s].

    Parameters
    ----------
    modes
        The side's modes.
    rest
        Contact temperature [K] of the field from which the modes measure deviations.
    film
        Air on the bare surface; None for none.
    """
    return _joined(_side_rows(modes, period), period, rest=rest, film=film, tail=len(modes.rates))


def _joined(rows: Array, period: float, *, rest: float, film: Film | None, tail: int) -> Array:
    """Prepend the head to the rows."""
    size = (len(rows) - STAGES * STAGES - 2 * NODES) // ROWS
    ambient = (film.coefficient, film.ambient) if film else (0.0, 0.0)
    head = np.zeros(HEAD)
    head[: TAIL + 1] = (size, period, rest, *ambient, tail)
    model = np.concatenate((head, rows))
    model.setflags(write=False)
    return model


@lru_cache(maxsize=64)
def _side_rows(modes: Modes, period: float) -> Array:
    spare = (0, padded(len(modes.rates) + TAIL_LENGTH) - len(modes.rates))
    rates, port, rise = (np.pad(part, spare) for part in (modes.rates, modes.contact, modes.unit_rise))
    return model_rows(rates, port, rise, period)


def model_rows(rates: Array, port: Array, rise: Array, period: float) -> Array:
    """Return the part of a model after its head, for rates [1/s], port and stationary rise of shape (size,)."""
    with one_thread():
        return _model_rows(rates, port, rise, period)


def _model_rows(rates: Array, port: Array, rise: Array, period: float) -> Array:
    points = Z[:, None] / period
    kernel = port / (points + rates)
    gain = collocation.response(rates * period) * period
    rows = np.concatenate(
        (
            np.stack((np.exp(-rates * period), port, rise)),
            collocation.memory(rates * period) * port,
            gain[-1] * port,
            kernel.real,
            kernel.imag,
        )
    )
    # Numbers too small to matter would only become subnormal products, which are very slow.
    rows[np.abs(rows) < 1e-150] = 0.0
    impedance = kernel @ port
    return np.concatenate((rows.ravel(), (gain @ port**2).ravel(), impedance.real, impedance.imag))


def film_of(side: Side, *, finger: bool) -> Film | None:
    """Return the air on a bare surface: as given, else as before the touch, else a finger's default or none."""
    if side.air is not None:
        return side.air
    start = side.initial
    if start.coefficient is not None and start.ambient is not None:
        return Film(coefficient=start.coefficient, ambient=start.ambient)
    return Film(coefficient=FINGER_FILM, ambient=ROOM) if finger else None


def side_model(side: Side, period: float, *, finger: bool, finest: float = 0.0) -> Array:
    """Return the packed model of a side; cached by content, except while a session may bring its own modes.

    ``finest`` [s]: its modes are those for steps of this length, so that a model for shorter steps can go on from its
    states; 0: for steps of ``period`` [s].
    """
    return (_side_model if building() else cached_side_model)(side, period, finger, finest or period)


def _side_model(side: Side, period: float, finger: bool, finest: float) -> Array:
    modes = side_modes(side, finest)
    return side_pack(modes, period, rest=start(side, modes)[1], film=film_of(side, finger=finger))


cached_side_model = lru_cache(maxsize=256)(_side_model)


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """Both sides as one: their states one after the other, and the difference of their ports.

    The flux is positive into the object, so that the finger's port is negative.  ``level`` is the temperature
    difference
    [K] across the open contact at rest, finger minus object; rates and port have shape (size,).
    """

    rates: Array
    port: Array
    level: float
    model: Array


@lru_cache(maxsize=256)
def pair_of(finger: Side, body: Side, period: float) -> Pair:
    """Return two sides as one; cached by content."""
    models = (side_model(finger, period, finger=True), side_model(body, period, finger=False))
    level = float(models[0][REST] - models[1][REST])
    rates, port, rows = _pair_rows(side_modes(finger, period), side_modes(body, period), period)
    return Pair(rates, port, level, _joined(rows, period, rest=-level, film=None, tail=0))


@lru_cache(maxsize=64)
def _pair_rows(finger: Modes, body: Modes, period: float) -> tuple[Array, Array, Array]:
    """Return rates and port of both sides one after the other, shape (size,), and the rows of their model."""
    spare = [(0, padded(len(side.rates) + TAIL_LENGTH) - len(side.rates)) for side in (finger, body)]
    rates = np.concatenate((np.pad(finger.rates, spare[0]), np.pad(body.rates, spare[1])))
    port = np.concatenate((np.pad(-finger.contact, spare[0]), np.pad(body.contact, spare[1])))
    return rates, port, model_rows(rates, port, np.zeros_like(port), period)


def state_size(model: Array) -> int:
    """Return the size [1] of the state of a model (n,), which the head of the model holds."""
    return int(model[SIZE])


def initial_state(side: Side, period: float, *, finger: bool, finest: float = 0.0) -> Array:
    """Return the state of a side before any touch, shape (state_size,); ``finest`` [s] as in `side_model`."""
    model = side_model(side, period, finger=finger, finest=finest)
    state = np.zeros(state_size(model))
    coordinates, _ = start(side, side_modes(side, finest or period))
    state[: len(coordinates)] = coordinates
    return state


def start(side: Side, modes: Modes) -> tuple[Array, float]:
    """Return a side's coordinates before the touch, shape (n,), and the contact temperature [K] of their zero.

    The modes' own stationary states are used where possible: a start that blood, or a flux lost at the surface,
    maintains deep inside an endless side is then as exact as its surface temperature and flux.
    """
    before = initial_profile(side)
    temperatures = imbalance(side)
    stack = stack_of(side)
    rates = np.maximum(modes.rates, 1e-18)
    if side.initial.kind == "steady" and stack.endless and stack.perfusion[-1] == 0.0:
        coordinates = modes.contact * before.flux / rates
        return coordinates, before.surface - float(modes.contact @ coordinates)
    if temperatures is not None and np.isfinite(stack.back):
        coordinates = -(modes.blood * temperatures[0] + stack.back * modes.back * temperatures[1]) / rates
        return coordinates, before.surface - float(modes.contact @ coordinates)
    rest = resting_profile(side)
    if side.initial.kind == "steady":
        return modes.unit_rise * (before.surface - rest.surface), rest.surface
    return modes.project(before.temperature(modes.depths) - rest.temperature(modes.depths)), rest.surface
